#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"

namespace acmp {

/// A GPU or the CPU with the engines that work on it side by side and share handles. The CPU has one engine, which uses
/// all cores itself.
struct ReconstructDevice {
  std::vector<std::unique_ptr<DepthEngine>> engines;  ///< at least one
  bool on_host = false;                               ///< the CPU; then there is no other device
};

/// Makes the devices, at least one. The online schedule uses the first engine of the first one.
using DeviceMaker = std::function<std::vector<ReconstructDevice>()>;

/// The devices that the options name: `jobs_per_gpu` engines on each GPU; where the CPU has to do, one, which uses all
/// cores itself. Throws InvalidInputError for an unknown device, and for one that is asked for and cannot be used.
/// @param log is told why "auto" settled for the CPU, unless the options are `quiet`; not null
std::vector<ReconstructDevice> MakeDevices(const ReconstructOptions& options, std::ostream* log);

/// What a run of the tool has around it. All outlive the run.
struct RunContext {
  const DeviceMaker&
      make_devices;  ///< called once, in another thread: a GPU takes as long to start as images to decode
  StopRequest& interrupt;
  std::ostream& out;     ///< results
  std::ostream& log;     ///< progress, warnings
  bool log_is_terminal;  ///< a progress bar instead of plain lines
};

/// One run of the tool: reads the scene, makes the output folder or goes on with an interrupted run in it (the online
/// schedule starts anew), writes all results. Throws InvalidInputError, ProcessingError or Interrupted.
void Reconstruct(const ReconstructOptions& options, const RunContext& context);

/// The next line without its end; nothing after the last one. May throw Interrupted.
using LineReader = std::function<std::optional<std::string>()>;

/// Does stages of a plan, one after the other, as far as they are not done. What a stage reads of other images and does
/// not find, or finds damaged, it makes itself. What they have in common is kept at hand: devices, the plan, images.
/// `context.out` is told of each, in one line: "LINE: done" or "LINE: exit code N: message", with the program's exit
/// codes.
/// @param next names them: "STAGE IMAGES", or "finish"
/// @return whether all were done. Throws InvalidInputError for options and Interrupted; a stage that fails ends nothing
bool ReconstructStages(const ReconstructOptions& options, const RunContext& context, const LineReader& next);

/// A posed, undistorted image in memory.
struct InputImage {
  std::string name;  ///< for messages
  ColorImage color;
  PinholeCamera camera;  ///< of the image's size
  RigidTransform cam_from_world = RigidTransform::Identity();
  Mask mask;             ///< of the image's size; empty: all pixels count
  DepthMap prior_depth;  ///< from outside, of the whole image at any size; 0: unknown; or empty
  std::vector<Eigen::Vector3d> landmarks_in_world;  ///< sparse points that it observes; for its depth range
  std::optional<DepthRange> depth_range;            ///< to search; none: that of the options or of the landmarks
  std::vector<int> ranked_sources;                  ///< images to match against, best first; none: found by the poses
};

/// Of one image, of the size and in the frame of the camera that was matched.
struct FinalMaps {
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
  ConfidenceMap confidence;  ///< empty where nobody asked for it
};

/// What became of one image.
struct ImageResult {
  PinholeCamera camera;  ///< at the size that was matched
  FinalMaps maps;
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

/// What the tool does with a scene's files, in memory: depth, normal, cost and confidence of each image by the offline
/// schedule, and one cloud. What a GPU has no room for waits in the host's memory. The maps and points are those of the
/// tool, bit by bit. Throws InvalidInputError for bad input, ProcessingError, or Interrupted.
/// @param images at least one; given up
/// @param options those of matching and machine count; the poses are taken as they are
/// @param make_devices is called once
ImageReconstruction ReconstructImages(std::vector<InputImage> images, const ReconstructOptions& options,
                                      const DeviceMaker& make_devices, StopRequest* interrupt);

/// Reads all images of a scene as the tool does (ReadScene), undistorted, with their masks and, where the dataset names
/// ranges, those that the tool searches. Throws InvalidInputError as ReadScene, AddMasks and LoadFrame do, or
/// Interrupted.
/// @param options scene, image_path, format, pixel_centers, masks and prior_depth count
/// @param warnings gets what was left aside; not null
std::vector<InputImage> ReadInputImages(const ReconstructOptions& options, const StopRequest& interrupt,
                                        std::vector<std::string>* warnings);

}  // namespace acmp
