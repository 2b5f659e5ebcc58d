#include "acmp_mapping/fusion/label_votes.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "acmp_mapping/geometry/vector_conversion.h"

namespace acmp {
namespace {

constexpr int kReach = 1;  ///< px: around a point's place in its own view other pixels vote, too

/// Of the pixels up to `reach` px around one that show a surface at a depth.
void AddVotes(const LabeledView& view, int at_col, int at_row, float depth, float max_relative_depth, int reach,
              LabelVotes* votes) {
  const ImageView<const float> depths = view.depth;
  for (int row = at_row - reach; row <= at_row + reach; ++row) {
    for (int col = at_col - reach; col <= at_col + reach; ++col) {
      if (!depths.Contains(col, row)) continue;
      const float error = std::abs(depths(col, row) - depth);
      if (error < max_relative_depth * depth) votes->Add((*view.labels)(col, row), 1);
    }
  }
}

}  // namespace

bool HasLabels(const PointCloud& points) {
  return std::any_of(points.begin(), points.end(), [](const SurfacePoint& point) { return point.label != 0; });
}

void LabelVotes::AddVote(Label label, double weight) {
  const auto known = std::find_if(votes_.begin(), votes_.end(), [&](const Votes& v) { return v.label == label; });
  if (known == votes_.end()) return votes_.push_back({label, weight});
  known->weight += weight;
}

Label LabelVotes::Winner() const {
  const auto most = std::max_element(votes_.begin(), votes_.end(),
                                     [](const Votes& a, const Votes& b) { return a.weight < b.weight; });
  return most == votes_.end() ? Label{0} : most->label;
}

void VoteForLabels(const std::vector<LabeledView>& views, const PosedCamera& reference, double max_relative_depth,
                   PointCloud* points_in_camera) {
  if (views.empty()) return;
  using Projection = Eigen::Matrix<double, 3, 4>;  // to z (u + 0.5, v + 0.5, 1), whose whole parts are the pixel
  std::vector<Projection> view_from_reference;
  for (const LabeledView& view : views) {
    PinholeCamera camera = view.camera.camera;
    camera.cx += 0.5, camera.cy += 0.5;
    const RigidTransform transform = view.camera.cam_from_world * reference.cam_from_world.inverse();
    view_from_reference.emplace_back(camera.K() * transform.matrix().topRows<3>());
  }
  tbb::parallel_for(tbb::blocked_range<size_t>(0, points_in_camera->size()), [&](const auto& range) {
    LabelVotes votes;
    for (size_t i = range.begin(); i < range.end(); ++i) {
      SurfacePoint& point = (*points_in_camera)[i];
      votes.Clear();
      for (size_t v = 0; v < views.size(); ++v) {
        const Eigen::Vector3d place = view_from_reference[v] * ToEigen(point.position).homogeneous();
        const double u = place.x() / place.z(), w = place.y() / place.z();
        const bool is_inside =
            place.z() > 0 && u >= 0 && w >= 0 && u < views[v].depth.width() && w < views[v].depth.height();
        if (!is_inside) continue;
        AddVotes(views[v], static_cast<int>(u), static_cast<int>(w), static_cast<float>(place.z()),
                 static_cast<float>(max_relative_depth), views[v].is_own ? kReach : 0, &votes);
      }
      point.label = votes.Winner();
    }
  });
}

}  // namespace acmp
