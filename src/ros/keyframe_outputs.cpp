#include "acmp_mapping/ros/keyframe_outputs.h"

#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// Pixels whose depth is published: not masked, and confident enough.
Image<unsigned char> MakeKeepMask(const KeyframeDepth& maps, double min_confidence) {
  Image<unsigned char> keep(maps.depth.width(), maps.depth.height(), 1);
  for (int row = 0; row < keep.height(); ++row) {
    for (int col = 0; col < keep.width(); ++col) {
      const bool used = maps.frame->mask.empty() || maps.frame->mask(col, row) != 0;
      const bool confident = maps.confidence.empty() || maps.confidence(col, row) >= min_confidence;
      keep(col, row) = used && confident ? 1 : 0;
    }
  }
  return keep;
}

/// Points that are not masked.
PointCloud KeptPoints(const KeyframeDepth& maps) {
  const ImageView<const unsigned char> mask = maps.frame->mask;
  if (mask.empty()) return maps.points_in_camera;
  const PinholeCamera& camera = maps.frame->camera;
  PointCloud kept;
  kept.reserve(maps.points_in_camera.size());
  for (const SurfacePoint& point : maps.points_in_camera) {
    const Eigen::Vector2d pixel = camera.Project({point.position.x, point.position.y, point.position.z});
    // Rounded as Contains does: -0.5 belongs to pixel 0.
    const int col = static_cast<int>(std::floor(pixel.x() + 0.5));
    const int row = static_cast<int>(std::floor(pixel.y() + 0.5));
    if (camera.Contains(pixel) && mask(col, row) == 0) continue;
    kept.push_back(point);
  }
  return kept;
}

}  // namespace

KeyframeOutput MakeKeyframeOutput(const KeyframeDepthPtr& maps, double min_depth_confidence) {
  const auto& frame = static_cast<const ReceivedFrame&>(*maps->frame);
  return {frame.origin, frame.run, maps, MakeKeepMask(*maps, min_depth_confidence), KeptPoints(*maps)};
}

void OutputStatus::CountRefined(const KeyframeDepth& maps) {
  ++refined;
  times = maps.times;
  consistency_ms = maps.consistency_ms;
  pose_fit = maps.pose_fit;
  pose_refined = maps.cam_from_world.matrix() != maps.frame->cam_from_world.matrix();
}

void OutputStatus::CountPoints(const KeyframeOutput& output) {
  const bool has_points = !output.points_in_camera.empty();
  run_without_points = has_points ? 0 : run_without_points + 1;
  no_points_reason = "";
  if (has_points) return;
  no_points_reason =
      output.maps->no_points_reason.value_or(Concat("all ", output.maps->points_in_camera.size(), " are masked"));
}

std::string OutputStatus::DescribeRunWithoutPoints(int64_t stamp_ns) const {
  if (run_without_points < kRunWithoutPoints) return "";
  return Concat("the last ", run_without_points, " refined keyframes have no points; of image ", FormatStamp(stamp_ns),
                " these checks remove them: ", no_points_reason);
}

}  // namespace acmp
