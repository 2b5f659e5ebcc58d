#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "acmp_mapping/keyframe/source_view_selection.h"
#include "plan.h"

namespace acmp {
namespace {

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

std::vector<std::vector<int>> ChooseSourceViews(const Scene& scene, const std::vector<int>& indices,
                                                const std::vector<double>& typical_depths, int max_sources) {
  std::vector<PosedCamera> cameras;
  std::vector<Eigen::Vector3d> centres;
  double most_focal_length = 0, longest_ray = 1;  // of any image
  for (int index : indices) {
    const SceneImage& image = scene.images[static_cast<size_t>(index)];
    cameras.push_back({image.camera, image.cam_from_world});
    centres.push_back(image.cam_from_world.inverse().translation());
    most_focal_length = std::max(most_focal_length, FocalLength(image.camera));
    longest_ray = std::max(longest_ray, LongestRay(image.camera));
  }
  // No view farther away can gain as much (SelectedSourceView::gain, 0..1): from there a surface is seen so small that
  // its weight is (kFreeRatio * ratio of resolutions)^2 at most.
  const auto distance_of_gain = [&](const PinholeCamera& camera, double depth, double gain) {
    constexpr double kFreeRatio = 1.5, kMargin = 1.01;  // of SelectSourceViews; for rounding
    const double ratio = std::sqrt(gain / kMargin) / kFreeRatio;
    return most_focal_length / FocalLength(camera) * depth / ratio * longest_ray + depth * LongestRay(camera);
  };
  SourceViewOptions options;
  options.max_source_views = max_sources;
  std::vector<std::vector<int>> sources(indices.size());
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    constexpr double kFirstDistance = 4;  // depths
    const double depth = typical_depths.at(i);
    for (double distance = kFirstDistance * depth; depth > 0;) {
      std::vector<int> around;
      std::vector<SourceViewCandidate> candidates;
      for (size_t other = 0; other < indices.size(); ++other) {
        if (other == i || (centres[other] - centres[i]).squaredNorm() > distance * distance) continue;
        around.push_back(indices[other]);
        candidates.push_back({cameras[other]});
      }
      const auto views = SelectSourceViews(cameras[i], depth, candidates, options).views;
      if (around.size() + 1 < indices.size()) {
        const bool is_full = static_cast<int>(views.size()) == max_sources;
        const double needed = is_full ? distance_of_gain(cameras[i].camera, depth, views.back().gain) : 2 * distance;
        if (needed > distance) {
          distance = needed;
          continue;
        }
      }
      for (const SelectedSourceView& view : views) sources[i].push_back(around[view.index]);
      return;
    }
  });
  return sources;
}

}  // namespace acmp
