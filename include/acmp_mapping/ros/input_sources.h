#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <acmp_mapping/Keyframe.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>

#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/options.h"

namespace acmp {

/// What diagnostics tell about one input stream.
struct InputStatus {
  enum class Kind {
    kImage,
    kCameraInfo,
    kPose,
    kCloud,
    kKeyframe,
    kExtrinsic,
    kMask,
    kPriorDepth,
    kSourceImage,
    kSourceInfo
  };
  Kind kind = Kind::kImage;
  std::string topic;  ///< resolved name
  uint32_t publishers = 0;
  uint64_t received = 0;
  double last_received_s = 0;  ///< steady clock; of the start while nothing was received
  bool required = true;        ///< nothing is mapped without it
  std::string type = {};       ///< of messages that are subscribed to
  std::string advice = {};     ///< what to set, where the topic is published with another type; else empty
  size_t camera = 0;           ///< of kSourceImage and kSourceInfo, from 0

  /// Whether the user has asked for it, and wants to know when nothing comes.
  bool is_wanted() const { return required || kind == Kind::kSourceImage || kind == Kind::kSourceInfo; }
};

/// Adds advice to the inputs on which nothing has come.
/// @param published types by name, of all topics that somebody publishes
void AddAdvice(const std::map<std::string, std::string>& published, std::vector<InputStatus>* inputs);

/// A subscription that converts messages to samples. Each kind of message is one implementation; all else knows samples
/// only.
class InputSource {
 public:
  virtual ~InputSource() = default;
  virtual InputStatus status() const = 0;
};

/// What becomes of the messages. Handlers may throw InvalidInputError for a message that cannot be used; it then goes
/// to on_drop.
struct InputHandlers {
  std::function<void(std::shared_ptr<const EncodedImage>)> on_image;
  std::function<void(const sensor_msgs::CameraInfo&)> on_camera_info;
  std::function<void(PoseSample)> on_pose;
  std::function<void()> on_tf;  ///< new transforms have come
  std::function<void(SparseCloudPtr)> on_cloud;
  std::function<void(CompanionSample)> on_mask;
  std::function<void(CompanionSample)> on_prior_depth;
  std::function<void(size_t camera, std::shared_ptr<const EncodedImage>)> on_source_image;
  std::function<void(size_t camera, const sensor_msgs::CameraInfo&)> on_source_camera_info;
  std::function<void(const RigidTransform&)> on_extrinsic;
  std::function<void(const acmp_mapping::KeyframeConstPtr&)> on_keyframe;
  std::function<void(const RejectedInput&)> on_drop;
};

/// Subscribes to the streams that the options ask for. Callbacks run in the node handle's callback queue. Throws
/// InvalidInputError where two cameras have the same topic.
std::vector<std::unique_ptr<InputSource>> MakeInputSources(const ros::NodeHandle& nh, const NodeOptions& options,
                                                           const InputHandlers& handlers);

/// Images that have come on all streams, those in whole keyframes too.
uint64_t ImagesReceived(const std::vector<InputStatus>& inputs);

/// Seconds of a clock that never goes back, whatever ROS time does.
double SteadySeconds();

}  // namespace acmp
