#include "acmp_mapping/ros/keyframe_outputs.h"

#include <algorithm>
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

/// None without a mask.
std::optional<PointCloud> FindNotMasked(const KeyframeDepth& maps) {
  const ImageView<const unsigned char> mask = maps.frame->mask;
  if (mask.empty()) return std::nullopt;
  const PinholeCamera& camera = maps.frame->camera;
  PointCloud kept;
  kept.reserve(maps.points_in_camera.size());
  for (const SurfacePoint& point : maps.points_in_camera) {
    const auto pixel = camera.PixelOf({point.position.x, point.position.y, point.position.z});
    if (pixel && mask(pixel->x(), pixel->y()) == 0) continue;
    kept.push_back(point);
  }
  return kept;
}

}  // namespace

std::string ReceivedFrame::name() const {
  return Concat("image ", FormatStamp(origin->stamp_ns), face.name.empty() ? "" : ", face " + face.name);
}

KeyframeOutput MakeKeyframeOutput(const KeyframeDepthPtr& maps, double min_depth_confidence) {
  return {maps, MakeKeepMask(*maps, min_depth_confidence), FindNotMasked(*maps)};
}

std::string DescribePixels(const KeyframeOutput& output) {
  const KeyframeDepth& maps = *output.maps;
  const Mask& mask = maps.frame->mask;
  constexpr float kNear = 1.01f;  // to an end of the range
  size_t masked = 0, without_depth = 0, guessed = 0, at_range_end = 0;
  for (int row = 0; row < maps.depth.height(); ++row) {
    for (int col = 0; col < maps.depth.width(); ++col) {
      const float depth = maps.depth(col, row);
      const bool has_depth = std::isfinite(depth) && depth > 0;
      if (!mask.empty() && mask(col, row) == 0) {
        ++masked;
      } else if (!has_depth) {
        ++without_depth;
      } else {
        guessed += maps.cost(col, row) >= kWorstCost ? 1 : 0;
        at_range_end += depth < kNear * maps.range.min || kNear * depth > maps.range.max ? 1 : 0;
      }
    }
  }
  const size_t others = output.points_in_camera().size() + masked + without_depth + guessed;
  const size_t not_confident = maps.depth.size() > others ? maps.depth.size() - others : 0;
  const auto share = [&](size_t pixels) {
    return Concat(std::lround(100 * static_cast<double>(pixels) / static_cast<double>(maps.depth.size())), " % ");
  };
  return Concat(output.frame().name(), ": ", share(output.points_in_camera().size()), "points, ", share(not_confident),
                "below min_confidence, ", share(guessed), "filled in where no view confirms it, ", share(without_depth),
                "without depth, ", share(masked), "masked; ", share(at_range_end), "at an end of the depth range, ",
                maps.range.min, " to ", maps.range.max);
}

LatencyWindow::Quantiles LatencyWindow::quantiles() const {
  if (latencies_ms_.empty()) return {};
  std::vector<double> sorted(latencies_ms_.begin(), latencies_ms_.end());
  std::sort(sorted.begin(), sorted.end());
  const size_t last = sorted.size() - 1;
  return {count_, sorted[last / 2], sorted[last * 99 / 100], sorted[last]};
}

void OutputStatus::CountRefined(const KeyframeDepth& maps) {
  ++refined;
  times = maps.times;
  consistency_ms = maps.consistency_ms;
  pose_fit = maps.pose_fit;
  pose_refined = maps.cam_from_world.matrix() != maps.frame->cam_from_world.matrix();
}

void OutputStatus::CountPoints(const KeyframeOutput& output) {
  pixels = DescribePixels(output);
  const bool has_points = !output.points_in_camera().empty();
  run_without_points = has_points ? 0 : run_without_points + 1;
  no_points_reason = "";
  if (has_points) return;
  no_points_reason =
      output.maps->no_points_reason.value_or(Concat("all ", output.maps->points_in_camera.size(), " are masked"));
}

std::string OutputStatus::DescribeRunWithoutPoints() const {
  if (run_without_points < kRunWithoutPoints) return "";
  return Concat("the last ", run_without_points,
                " refined keyframes have no points; these checks remove those of the last one: ", no_points_reason);
}

}  // namespace acmp
