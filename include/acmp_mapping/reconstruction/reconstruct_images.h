#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "acmp_mapping/reconstruction/stop_request.h"

namespace acmp {

/// A posed, undistorted image in memory.
struct InputImage {
  std::string name;  ///< for messages
  ColorImage color;
  PinholeCamera camera;  ///< of the image's size
  RigidTransform cam_from_world = RigidTransform::Identity();
  Mask mask;                                        ///< of the image's size; empty: all pixels count
  std::vector<Eigen::Vector3d> landmarks_in_world;  ///< sparse points that it observes; for its depth range
  std::optional<DepthRange> depth_range;            ///< to search; none: that of the options or of the landmarks
  std::vector<int> ranked_sources;                  ///< images to match against, best first; none: found by the poses
};

/// What became of one image. Maps have the size of `camera` and are in its frame.
struct ImageResult {
  PinholeCamera camera;  ///< at the size that was matched
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
  ConfidenceMap confidence;
  std::vector<int> sources;  ///< images that it was matched against, best first
  std::string no_map;        ///< why it has no maps; empty when it has
};

struct ImageReconstruction {
  std::vector<ImageResult> images;  ///< in the order of the input
  PointCloud cloud;                 ///< of all images, world's axes
  /// Of the cloud's coordinates in the world: zero unless float32 could not hold them there.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::vector<std::string> warnings;  ///< what was left aside, and that no or hardly any pixel became a point
  std::string device;                 ///< that did it
};

/// What the tool does with a scene's files, in memory and without files: depth, normal, cost and confidence of each
/// image by the offline schedule, and one cloud. The maps and points are those of the tool, bit by bit. Throws
/// InvalidInputError for bad input, ProcessingError, or Interrupted.
/// @param images at least one; given up
/// @param options those of matching and machine count; the poses are taken as they are
/// @param make_devices is called once
ImageReconstruction ReconstructImages(std::vector<InputImage> images, const ReconstructOptions& options,
                                      const DeviceMaker& make_devices, StopRequest* interrupt);

/// Reads all images of a scene as the tool does (ReadScene), undistorted, with their masks and, where the dataset names
/// ranges, those that the tool searches. Throws InvalidInputError as ReadScene, AddMasks and LoadFrame do, or
/// Interrupted.
/// @param options scene, format, pixel_centers and masks count
/// @param warnings gets what was left aside; not null
std::vector<InputImage> ReadInputImages(const ReconstructOptions& options, const StopRequest& interrupt,
                                        std::vector<std::string>* warnings);

}  // namespace acmp
