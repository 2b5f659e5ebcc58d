#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <boost/circular_buffer.hpp>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/keyframe_intake.h"

namespace acmp {

/// A frame that knows where it comes from. All frames that the nodelet gives to its mapper are such, so that whatever
/// the mapper tells of one can be published.
struct ReceivedFrame : Frame {
  std::shared_ptr<const CaptureOrigin> origin;  ///< one for all frames of a capture
  PinholeFace face;                             ///< of the image as sent
  std::shared_ptr<const std::string> jpeg;      ///< file of the undistorted image (keep_images); null: not kept

  /// It stands for its capture: in counts, latencies, poses. (Of a wide image, the face ahead.)
  bool is_first() const { return id == origin->id; }
  /// frame_id of what is published of it.
  std::string frame_id() const { return origin->camera_frame + (face.name.empty() ? "" : "_" + face.name); }
  std::string name() const;  ///< "image STAMP, face left", for messages
  /// As received.
  RigidTransform world_from_cam() const { return origin->world_from_cam * RigidTransform(face.lens_from_face); }
};

/// A keyframe's maps ready to be published.
struct KeyframeOutput {
  KeyframeDepthPtr maps;                 ///< of a ReceivedFrame
  Image<unsigned char> keep;             ///< 1 where depth is to be published
  std::optional<PointCloud> not_masked;  ///< points that a mask leaves; without a mask none

  /// In the camera of maps->cam_from_world.
  const PointCloud& points_in_camera() const { return not_masked ? *not_masked : maps->points_in_camera; }
  const ReceivedFrame& frame() const { return static_cast<const ReceivedFrame&>(*maps->frame); }
  const CaptureOrigin& origin() const { return *frame().origin; }
};

/// Leaves out what is masked, and depth below a confidence of 0..1.
/// @param maps of a ReceivedFrame
KeyframeOutput MakeKeyframeOutput(const KeyframeDepthPtr& maps, double min_depth_confidence);

/// Which share of a refined keyframe's pixels became points, and what the others lack: "image STAMP: 61 % points,
/// ...". Each pixel counts once, but for those at an end of the depth range, beyond which nothing was searched.
std::string DescribePixels(const KeyframeOutput& output);

/// Latencies of the last outputs. Not thread-safe.
class LatencyWindow {
 public:
  static constexpr size_t kCapacity = 1000;

  struct Quantiles {
    size_t count = 0;  ///< outputs since the start, not only those in the window
    double median_ms = 0, p99_ms = 0, max_ms = 0;
  };

  void Add(double latency_ms) {
    latencies_ms_.push_back(latency_ms);
    ++count_;
  }
  Quantiles quantiles() const;

 private:
  boost::circular_buffer<double> latencies_ms_{kCapacity};
  size_t count_ = 0;
};

/// What has been made of the keyframes.
struct OutputStatus {
  static constexpr uint64_t kRunWithoutPoints = 3;  ///< refined keyframes without points that are worth a word

  // Of captures, each by its first keyframe:
  uint64_t fast = 0;
  uint64_t refined = 0;
  uint64_t refined_again = 0;
  uint64_t withdrawn = 0;  ///< refined ones whose points left the map, since poses contradict the images
  StageTimes times;        ///< of the last refined keyframe
  double consistency_ms = 0;
  PoseFit pose_fit;                             ///< of the last refined keyframe
  bool pose_refined = false;                    ///< and whether it was matched with another pose than received
  std::string pixels;                           ///< DescribePixels of the last refined keyframe; empty: none
  uint64_t run_without_points = 0;              ///< the newest refined keyframes, so many, have no points ...
  std::string no_points_reason;                 ///< ... and which check removes those of the last one
  LatencyWindow fast_latency, refined_latency;  ///< from the image's callback until its map was published

  void CountRefined(const KeyframeDepth& maps);
  /// Of a refined keyframe.
  void CountPoints(const KeyframeOutput& output);
  /// Of the run of keyframes without points; empty: not long enough.
  std::string DescribeRunWithoutPoints() const;
};

}  // namespace acmp
