#pragma once

#include <functional>
#include <memory>
#include <string>

#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>

#include "acmp_mapping/ros/drop.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/node_options.h"
#include "acmp_mapping/ros/sensor_samples.h"

namespace acmp {

/// What diagnostics tell about one input stream.
struct InputStatus {
  std::string topic;  ///< resolved name
  uint32_t publishers = 0;
  uint64_t received = 0;
  double last_received_s = 0;  ///< steady clock; of the start while nothing was received
};

/// A subscription that converts messages to samples. Each kind of pose or cloud message is one implementation; all else
/// knows samples only.
class InputSource {
 public:
  virtual ~InputSource() = default;
  virtual InputStatus status() const = 0;
};

using DropHandler = std::function<void(const Drop&)>;

/// Callbacks run in the node handle's callback queue. Messages that cannot be used go to `on_drop`.
std::unique_ptr<InputSource> MakeImageSource(const ros::NodeHandle& nh, const NodeOptions& options,
                                             const std::function<void(std::shared_ptr<const EncodedImage>)>& on_image,
                                             DropHandler on_drop);
std::unique_ptr<InputSource> MakeCameraInfoSource(const ros::NodeHandle& nh,
                                                  const std::function<void(const sensor_msgs::CameraInfo&)>& on_info,
                                                  DropHandler on_drop);
std::unique_ptr<InputSource> MakePoseSource(const ros::NodeHandle& nh, const NodeOptions& options,
                                            const std::function<void(PoseSample)>& on_pose, DropHandler on_drop);
std::unique_ptr<InputSource> MakeCloudSource(const ros::NodeHandle& nh, const NodeOptions& options,
                                             const std::function<void(SparseCloudPtr)>& on_cloud, DropHandler on_drop);

/// Seconds of a clock that never goes back, whatever ROS time does.
double SteadySeconds();

}  // namespace acmp
