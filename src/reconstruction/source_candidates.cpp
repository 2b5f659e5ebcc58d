#include "plan.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "acmp_mapping/keyframe/source_view_selection.h"

namespace acmp {
namespace {

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
  for (int index : indices_) {
    const SceneImage& image = scene_.images[static_cast<size_t>(index)];
    centres_.push_back(image.cam_from_world.inverse().translation());
    most_focal_length_ = std::max(most_focal_length_, FocalLength(image.camera));
    least_cosine_ = std::min(least_cosine_, 1 / LongestRay(image.camera));
  }
}

std::vector<int> SourceCandidates::Around(int index, double distance) const {
  const Eigen::Vector3d centre = scene_.images[static_cast<size_t>(index)].cam_from_world.inverse().translation();
  std::vector<int> around;
  for (size_t i = 0; i < indices_.size(); ++i) {
    if (indices_[i] == index) continue;
    if ((centres_[i] - centre).squaredNorm() <= distance * distance) around.push_back(indices_[i]);
  }
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
