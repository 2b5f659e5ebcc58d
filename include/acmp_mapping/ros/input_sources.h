#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <rosbag/message_instance.h>

#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/keyframe_intake.h"
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
    kLabels,
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
  std::string advice = {};     ///< what to set, where something like it is published; else empty
  size_t camera = 0;           ///< of kSourceImage and kSourceInfo, from 0
  bool is_named = false;       ///< by the user: it is not where it is by default
  std::string name = {};       ///< before it is resolved, and of the launch file's argument

  /// Whether the user has asked for it, and wants to know when nothing comes.
  bool is_wanted() const {
    return required || kind == Kind::kSourceImage || kind == Kind::kSourceInfo || (is_named && received == 0);
  }
};

/// "/camera/image" of "/camera/image/compressed".
std::string WithoutCompressed(const std::string& topic);

/// Adds advice to the inputs on which nothing has come: how to take the topic if it is published with another type, or
/// what is published whose name is like it; for a required one, whatever could be taken in its place. Outputs of
/// mappers, of this one or others, and of their maps are offered to none.
/// @param published types by name, of all topics
void AddAdvice(const std::map<std::string, std::string>& published, std::vector<InputStatus>* inputs);

/// What is done with the messages of a topic. The status may be asked for in any thread.
struct InputSource {
  InputStatus status() const;

  InputStatus fixed;  ///< what of the status does not change
  std::function<ros::Subscriber(const ros::NodeHandle&)> subscribe;
  std::function<void(const rosbag::MessageInstance&)> play;  ///< takes a recorded message, of any type
  std::atomic<uint64_t> received{0};
  std::atomic<double> last_received_s{SteadySeconds()};
  ros::Subscriber subscriber;  ///< last: its callback uses what is above
};

/// Where the samples go that are made of messages.
struct InputSink {
  /// Calls a function with the intake, and hands on what is complete then.
  std::function<void(const std::function<void(KeyframeIntake*)>&)> receive;
  std::function<bool()> is_paused;                    ///< images are dropped
  std::function<void(const RejectedInput&)> on_drop;  ///< told of messages that cannot be used
  std::function<double()> now_s = SteadySeconds;      ///< when they come
};

/// Where the inputs' names lead.
struct InputTopics {
  std::function<std::string(const std::string& name)> resolve;
  std::function<bool(const std::string& name)> is_remapped;
};
InputTopics TopicsOf(const ros::NodeHandle& nh);

using InputSources = std::vector<std::unique_ptr<InputSource>>;

/// The streams that the options ask for. Throws InvalidInputError where two cameras have the same topic.
InputSources MakeInputSources(const InputTopics& topics, const NodeOptions& options, const InputSink& sink);

/// Callbacks run in the node handle's callback queue. Throws InvalidInputError where inputs of different types have the
/// same topic.
void Subscribe(const ros::NodeHandle& nh, const InputSources* sources);

/// Images wait for what somebody publishes, or has: messages of a player that has ended may still be queued.
/// @param is_published or may be
void SetExpected(const InputSources& sources, const std::function<bool(const InputSource&)>& is_published,
                 KeyframeIntake* intake);

/// Images that have come on all streams, those in whole keyframes too.
uint64_t ImagesReceived(const std::vector<InputStatus>& inputs);
uint64_t ImagesReceived(const InputSources& sources);

}  // namespace acmp
