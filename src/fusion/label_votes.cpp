#include "acmp_mapping/fusion/label_votes.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "acmp_mapping/geometry/vector_conversion.h"

namespace acmp {
namespace {

constexpr int kReach = 1;  ///< px: around a point's place in the first view other pixels vote, too

/// Of the pixels up to `reach` px around one that show a surface at a depth.
void AddVotes(const LabeledView& view, const Eigen::Vector2i& pixel, double depth, double max_relative_depth, int reach,
              LabelVotes* votes) {
  const ImageView<const float> depths = view.depth;
  for (int row = pixel.y() - reach; row <= pixel.y() + reach; ++row) {
    for (int col = pixel.x() - reach; col <= pixel.x() + reach; ++col) {
      if (!depths.Contains(col, row)) continue;
      const double error = std::abs(depths(col, row) - depth);
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
  std::vector<RigidTransform> view_from_reference;
  for (const LabeledView& view : views) {
    view_from_reference.push_back(view.camera.cam_from_world * reference.cam_from_world.inverse());
  }
  tbb::parallel_for(tbb::blocked_range<size_t>(0, points_in_camera->size()), [&](const auto& range) {
    LabelVotes votes;
    for (size_t i = range.begin(); i < range.end(); ++i) {
      SurfacePoint& point = (*points_in_camera)[i];
      votes.Clear();
      for (size_t v = 0; v < views.size(); ++v) {
        const Eigen::Vector3d in_view = view_from_reference[v] * ToEigen(point.position);
        const auto pixel = views[v].camera.camera.PixelOf(in_view);
        if (pixel) AddVotes(views[v], *pixel, in_view.z(), max_relative_depth, v == 0 ? kReach : 0, &votes);
      }
      point.label = votes.Winner();
    }
  });
}

}  // namespace acmp
