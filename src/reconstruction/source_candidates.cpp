#include "plan.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "acmp_mapping/keyframe/source_view_selection.h"

namespace acmp {
namespace {

Eigen::Vector3d CandidateCentre(const SceneImage& image) { return image.cam_from_world.inverse().translation(); }

PosedCamera CameraOf(const SceneImage& image) { return {image.camera, image.cam_from_world}; }

double FocalLength(const PinholeCamera& camera) { return 0.5 * (camera.fx + camera.fy); }

/// Length of the longest ray of the image to depth 1.
double LongestRay(const PinholeCamera& camera) {
  double longest = 1;
  for (double u : {-0.5, camera.width - 0.5}) {
    for (double v : {-0.5, camera.height - 0.5}) longest = std::max(longest, camera.Unproject({u, v}).norm());
  }
  return longest;
}

}  // namespace

SourceCandidates::SourceCandidates(const Scene& scene, std::vector<int> indices)
    : scene_(scene), indices_(std::move(indices)) {
  Eigen::AlignedBox3d box;
  for (int index : indices_) {
    const SceneImage& image = scene_.images[static_cast<size_t>(index)];
    box.extend(CandidateCentre(image));
    most_focal_length_ = std::max(most_focal_length_, FocalLength(image.camera));
    least_cosine_ = std::min(least_cosine_, 1 / LongestRay(image.camera));
  }
  // Some ten images a cell where they stand along a line, fewer where they are spread over an area.
  constexpr double kImagesPerCell = 10;
  extent_ = box.isEmpty() ? 0 : box.sizes().sum();
  if (extent_ > 0)
    cell_size_ = box.sizes().maxCoeff() * std::min(1.0, kImagesPerCell / static_cast<double>(indices_.size()));
  for (int index : indices_)
    cells_[CellOf(CandidateCentre(scene_.images[static_cast<size_t>(index)]))].push_back(index);
}

SourceCandidates::Cell SourceCandidates::CellOf(const Eigen::Vector3d& point) const {
  Cell cell;
  for (int axis = 0; axis < 3; ++axis) cell[axis] = static_cast<int64_t>(std::floor(point[axis] / cell_size_));
  return cell;
}

std::vector<int> SourceCandidates::Around(int index, double distance) const {
  std::vector<int> around;
  if (!(distance < extent_)) {
    std::remove_copy(indices_.begin(), indices_.end(), std::back_inserter(around), index);
    return around;
  }
  const Eigen::Vector3d centre = CandidateCentre(scene_.images[static_cast<size_t>(index)]);
  const Cell first = CellOf(centre - Eigen::Vector3d::Constant(distance));
  const Cell last = CellOf(centre + Eigen::Vector3d::Constant(distance));
  const auto add = [&](const std::vector<int>& images) { around.insert(around.end(), images.begin(), images.end()); };
  for (int64_t x = first[0]; x <= last[0]; ++x) {
    // Cells of one x lie side by side in the map.
    for (auto cell = cells_.lower_bound({x, first[1], first[2]}); cell != cells_.end() && cell->first[0] == x; ++cell) {
      if (cell->first[1] > last[1]) break;
      if (cell->first[2] >= first[2] && cell->first[2] <= last[2]) add(cell->second);
    }
  }
  around.erase(std::remove(around.begin(), around.end(), index), around.end());
  std::sort(around.begin(), around.end());
  return around;
}

double SourceCandidates::DistanceOfGain(int index, double typical_depth, double gain) const {
  // From far away a surface is seen so small that its weight is (kFreeRatio * ratio of resolutions)^2 at most.
  constexpr double kFreeRatio = 1.5, kMargin = 1.01;  // of SelectSourceViews; for rounding
  const PinholeCamera& camera = scene_.images[static_cast<size_t>(index)].camera;
  const double ratio = std::sqrt(gain / kMargin) / kFreeRatio;
  const double depth_there = most_focal_length_ / FocalLength(camera) * typical_depth / ratio;
  return depth_there / least_cosine_ + typical_depth * LongestRay(camera);
}

std::vector<int> SourceCandidates::Select(int index, double typical_depth, int max_sources) const {
  SourceViewOptions options;
  options.max_source_views = max_sources;
  constexpr double kFirstDistance = 4;  // depths
  for (double distance = kFirstDistance * typical_depth;;) {
    const std::vector<int> around = Around(index, distance);
    std::vector<SourceViewCandidate> candidates;
    candidates.reserve(around.size());
    for (int other : around) candidates.push_back({CameraOf(scene_.images[static_cast<size_t>(other)])});
    const SourceViewSelection selection =
        SelectSourceViews(CameraOf(scene_.images[static_cast<size_t>(index)]), typical_depth, candidates, options);
    if (around.size() + 1 < indices_.size()) {
      const bool is_full = static_cast<int>(selection.views.size()) == max_sources;
      const double needed = is_full ? DistanceOfGain(index, typical_depth, selection.views.back().gain) : 2 * distance;
      if (needed > distance) {
        distance = needed;
        continue;
      }
    }
    std::vector<int> sources;
    for (const SelectedSourceView& view : selection.views) sources.push_back(around[view.index]);
    return sources;
  }
}

}  // namespace acmp
