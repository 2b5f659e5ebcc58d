#include "acmp_mapping/ros/input_sources.h"

#include <algorithm>
#include <cstring>
#include <functional>
#include <iterator>
#include <utility>

#include <acmp_mapping/KeyframeDepth.h>
#include <tf2_msgs/TFMessage.h>
#include <boost/algorithm/string/predicate.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/option.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using Kind = InputStatus::Kind;

constexpr char kCompressedDepth[] = "/compressedDepth";  ///< after the name of a depth image's topic
constexpr uint32_t kImageQueue = 30;
constexpr uint32_t kCameraInfoQueue = 5;
constexpr uint32_t kPoseQueue = 100;
constexpr uint32_t kCloudQueue = 10;

template <class Message>
std::string TypeOf() {
  return ros::message_traits::DataType<Message>::value();
}

bool BringsImages(Kind kind) { return kind == Kind::kImage || kind == Kind::kKeyframe; }
bool EndsWhilePaused(Kind kind) { return BringsImages(kind) || kind == Kind::kSourceImage; }

/// What to subscribe to.
struct InputStream {
  Kind kind;
  std::string name;  ///< relative
  uint32_t queue;
  std::string reason;  ///< of drops, when a message cannot be used
  bool required;
  size_t camera = 0;       ///< of source cameras
  std::string topic = {};  ///< where it is another than the name is remapped to
};

/// What belongs to images and is one itself, but for the images of source cameras.
struct CompanionRow {
  Kind kind;
  CompanionStream stream;
  const char* name;
  const char* reason;  ///< of drops
  ImageSample (*convert)(const sensor_msgs::ImageConstPtr& message);
};
constexpr CompanionRow kCompanionRows[] = {
    {Kind::kMask, kMaskStream, names::kMask, "bad_mask", &ToMaskSample},
    {Kind::kPriorDepth, kPriorDepthStream, names::kPriorDepth, "bad_prior_depth", &ToPriorDepthSample},
    {Kind::kLabels, kLabelStream, names::kLabels, "bad_labels", &ToLabelSample}};

/// Null: none.
const CompanionRow* CompanionRowOf(Kind kind) {
  const auto row = std::find_if(std::begin(kCompanionRows), std::end(kCompanionRows),
                                [&](const CompanionRow& known) { return known.kind == kind; });
  return row == std::end(kCompanionRows) ? nullptr : row;
}

/// Where a name is that the user has chosen; our launch files remap all names.
bool IsNamed(const InputTopics& topics, const std::string& name) {
  return topics.is_remapped(name) && topics.resolve(name) != names::kDefaultTopics + name;
}

/// "image/compressed" if that name is remapped, else beside the image as image_transport's publishers put it. A name
/// that ends so is the whole one.
std::string CompressedTopic(const InputTopics& topics, const std::string& image) {
  const std::string name = image + names::kCompressed;
  if (topics.is_remapped(name)) return topics.resolve(name);
  return WithoutCompressed(topics.resolve(image)) + names::kCompressed;
}

/// What makes the mapper take a topic of this type for an input; empty: nothing does. The names of arguments and
/// parameters are those of our launch files.
std::string HowToTake(const InputStatus& input, const std::string& type, const std::string& topic) {
  for (const PoseInput& pose : PoseInputs()) {
    if (input.kind == Kind::kPose && type == pose.type)
      return Concat("set pose_source:=", pose.name, " ", pose.name, ":=", topic);
  }
  const struct {
    Kind kind;
    std::string type;
    const char* arguments;
  } ways[] = {{Kind::kCloud, TypeOf<sensor_msgs::PointCloud2>(), "sparse_points:="},
              {Kind::kCloud, TypeOf<sensor_msgs::PointCloud>(), "sparse_points_v1:="},
              {Kind::kImage, TypeOf<sensor_msgs::Image>(), "image_transport:=raw image:="}};
  for (const auto& way : ways) {
    if (input.kind == way.kind && type == way.type) return Concat("set ", way.arguments, topic);
  }
  if (type != TypeOf<sensor_msgs::CompressedImage>()) return "";
  const bool is_depth = boost::algorithm::ends_with(topic, kCompressedDepth);
  if (CompanionRowOf(input.kind)) {
    return Concat(
        "it must be raw: rosrun image_transport republish ", is_depth ? "compressedDepth" : "compressed",
        " in:=", is_depth ? topic.substr(0, topic.size() - std::strlen(kCompressedDepth)) : WithoutCompressed(topic),
        " raw out:=/raw, and ", input.name, ":=/raw");
  }
  if (input.kind != Kind::kImage || is_depth) return "";
  const std::string image = WithoutCompressed(topic);
  return image != topic ? Concat("set image_transport:=compressed image:=", image)
                        : Concat("set image_transport:=compressed and remap image/compressed to ", topic);
}

/// What takes a topic that could be meant by a silent input; empty: it could not.
std::string HowToTakeInstead(const InputStatus& input, const std::string& type, const std::string& topic) {
  const std::string how = HowToTake(input, type, topic);
  const bool is_told = !how.empty() || input.kind == Kind::kImage || input.kind == Kind::kPose;
  return is_told || type != input.type ? how : Concat("set ", input.name, ":=", topic);
}

/// What is published and could be meant by an input of this name that nobody publishes.
std::string OthersLike(const InputStatus& input, const std::map<std::string, std::string>& published) {
  constexpr size_t kFewNames = 3;  // more would be no help
  std::vector<std::string> topics;
  for (const auto& [topic, type] : published) {
    if (!HowToTakeInstead(input, type, topic).empty()) topics.push_back(topic);
  }
  const auto describe = [&](const std::string& topic) {
    return Concat(topic, ": ", HowToTakeInstead(input, published.at(topic), topic));
  };
  if (const auto similar = MostSimilar(input.topic, topics)) return "nobody publishes it, but " + describe(*similar);
  if (!input.required || topics.empty() || topics.size() > kFewNames) return "";
  std::string text = "nobody publishes it; what could be taken is ";
  for (size_t i = 0; i < topics.size(); ++i) text += (i > 0 ? "; or " : "") + describe(topics[i]);
  return text;
}

std::string AdviceOn(const InputStatus& input, const std::map<std::string, std::string>& published) {
  const auto found = published.find(input.topic);
  if (found != published.end() && found->second != input.type) {
    const std::string how = HowToTake(input, found->second, input.topic);
    return Concat("it is published as ", found->second, ", and must be ", input.type, how.empty() ? "" : ": " + how);
  }
  if (found != published.end()) return "";
  // Beside the name that was given: image_transport's other topics, or a name that has its suffix already.
  for (const std::string& other :
       {input.topic + names::kCompressed, input.topic + kCompressedDepth, WithoutCompressed(input.topic)}) {
    const auto beside = published.find(other);
    if (beside == published.end()) continue;
    const std::string how = HowToTakeInstead(input, beside->second, other);
    if (!how.empty()) return Concat("nobody publishes it, but ", other, ": ", how);
  }
  return input.is_wanted() ? OthersLike(input, published) : "";
}

/// "/acmp/" of "/acmp/points" where the topic has that name; else empty.
std::string NamespaceOf(const std::string& topic, const char* name) {
  return boost::algorithm::ends_with(topic, std::string("/") + name) ? topic.substr(0, topic.size() - std::strlen(name))
                                                                     : "";
}

/// The namespaces in which a mapper or a map server publishes.
std::vector<std::string> FindMappers(const std::map<std::string, std::string>& published) {
  std::vector<std::string> found;
  for (const auto& [topic, type] : published) {
    const std::string mapper =
        type == TypeOf<acmp_mapping::KeyframeDepth>() ? NamespaceOf(topic, names::kKeyframeDepth) : "";
    const std::string map = NamespaceOf(topic, names::kMapPoints);
    if (!mapper.empty()) found.push_back(mapper);
    if (!map.empty() && published.count(map + names::kKeyframePath) > 0) found.push_back(map);
  }
  return found;
}

/// @param name within the namespace; image_transport publishes beside the names of images
bool IsOutput(const std::string& name) {
  constexpr const char* kNames[] = {names::kDepthFast,
                                    "depth_fast/camera_info",
                                    names::kDepth,
                                    names::kDepthCameraInfo,
                                    names::kDepthMillimetres,
                                    names::kDepthPicture,
                                    names::kColor,
                                    "rgb/camera_info",
                                    names::kConfidence,
                                    names::kConfidencePicture,
                                    names::kNormal,
                                    names::kNormalPicture,
                                    names::kPoints,
                                    names::kMapPoints,
                                    names::kMapLabels,
                                    names::kOccupancy,
                                    names::kMesh,
                                    names::kDistanceSlice,
                                    names::kKeyframePose,
                                    names::kKeyframePath,
                                    names::kKeyframeDepth,
                                    names::kKeyframePoints,
                                    "viewer/image",
                                    "viewer/camera_info",
                                    "viewer/keyframes"};
  const bool is_of_face = boost::algorithm::starts_with(name, names::kFacePrefix);
  const std::string own = is_of_face ? name.substr(name.find('/') + 1) : name;
  return std::any_of(std::begin(kNames), std::end(kNames), [&](const std::string& output) {
    return own == output || boost::algorithm::starts_with(own, output + "/");
  });
}

/// Makes the sources of one node.
class SourceFactory {
 public:
  SourceFactory(InputTopics topics, const NodeOptions& options, InputSink sink)
      : topics_(std::move(topics)), options_(options), sink_(std::move(sink)) {}

  InputSources Make() {
    if (options_.keyframe_mode == KeyframeMode::kExternal) {
      Add<acmp_mapping::Keyframe>(
          {Kind::kKeyframe, names::kKeyframe, kCloudQueue, "bad_keyframe", true}, kAsItIs,
          [now = sink_.now_s](auto* intake, const auto& keyframe) { intake->AddKeyframe(keyframe, now()); });
    } else {
      AddCloud<sensor_msgs::PointCloud2>(names::kSparsePoints);
      AddCloud<sensor_msgs::PointCloud>(names::kSparsePointsV1);
      AddPoses();
      if (options_.calibration_file.empty()) {
        Add<sensor_msgs::CameraInfo>({Kind::kCameraInfo, names::kCameraInfo, kCameraInfoQueue, "bad_camera_info", true},
                                     kAsItIs, [](auto* intake, const auto& info) { intake->AddCameraInfo(*info); });
      }
      AddImages({Kind::kImage, names::kImage, kImageQueue, "bad_image", true},
                [now = sink_.now_s](auto* intake, const auto& image) { intake->AddImage(image, now()); });
    }
    for (size_t camera = 0; camera < static_cast<size_t>(options_.matcher.source_cameras); ++camera) {
      if (options_.source_calibration_file.empty()) {
        Add<sensor_msgs::CameraInfo>(
            {Kind::kSourceInfo, names::kSourceCameraInfos[camera], kCameraInfoQueue, "bad_camera_info", false, camera},
            kAsItIs, [camera](auto* intake, const auto& info) { intake->AddSourceCameraInfo(camera, *info); });
      }
      AddImages({Kind::kSourceImage, names::kSourceImages[camera], kImageQueue, "bad_source_image", false, camera},
                [camera](auto* intake, const auto& image) {
                  intake->AddCompanion(kSourceStream + camera, {ToStampNs(image->header().stamp), image});
                });
    }
    for (const CompanionRow& row : kCompanionRows) {
      Add<sensor_msgs::Image>(
          {row.kind, row.name, kImageQueue, row.reason, false}, row.convert,
          [stream = row.stream](auto* intake, ImageSample sample) { intake->AddCompanion(stream, std::move(sample)); });
    }
    if (NeedsExtrinsic(options_)) {
      Add<nav_msgs::Odometry>(
          {Kind::kExtrinsic, names::kExtrinsic, 1, "bad_extrinsic", false},
          [](const auto& message) { return ToTransform(message->pose.pose); }, &KeyframeIntake::SetExtrinsic);
    }
    CheckCameras();
    return std::move(sources_);
  }

 private:
  static constexpr auto kAsItIs = [](const auto& message) { return message; };

  void CheckCameras() const {
    std::map<std::string, std::string> cameras;
    for (const auto& source : sources_) {
      const InputStatus status = source->status();
      if (status.kind != Kind::kImage && status.kind != Kind::kSourceImage) continue;
      const auto [other, is_new] = cameras.emplace(status.topic, status.name);
      if (is_new) continue;
      throw InvalidInputError(
          Concat("the topics ", other->second, " and ", status.name, " are both ", status.topic,
                 ": each camera must have its own (~source_cameras = ", options_.matcher.source_cameras, ")"));
    }
  }

  /// @param convert makes of a message what take(intake, sample) gets; the intake is not locked meanwhile. What either
  /// throws becomes a drop with the stream's reason
  template <class Message, class Convert, class Take>
  void Add(InputStream stream, Convert convert, Take take) {
    // With overload: block the messages of a recording wait here, all of them (0: no limit).
    if (options_.overload == OverloadPolicy::kBlock && stream.queue > 1) stream.queue = 0;
    InputSource& source = *sources_.emplace_back(std::make_unique<InputSource>());
    source.fixed.kind = stream.kind;
    if (stream.topic.empty()) stream.topic = stream.name;
    source.fixed.name = stream.name;
    source.fixed.topic = topics_.resolve(stream.topic);
    source.fixed.is_named = IsNamed(topics_, stream.name);
    source.fixed.required = stream.required;
    source.fixed.type = TypeOf<Message>();
    source.fixed.camera = stream.camera;
    const auto receive = [&source, reason = stream.reason, sink = sink_, convert,
                          take](const boost::shared_ptr<const Message>& message) {
      const Kind kind = source.fixed.kind;
      ++source.received;
      source.last_received_s = sink.now_s();
      try {
        if (EndsWhilePaused(kind) && sink.is_paused()) {
          const std::string stamp = FormatStamp(ToStampNs(ros::message_traits::header(*message)->stamp));
          if (BringsImages(kind)) sink.on_drop({"paused", Concat("image ", stamp, " (~pause)"), true});
          return;
        }
        auto sample = convert(message);
        sink.receive([&](KeyframeIntake* intake) { std::invoke(take, intake, std::move(sample)); });
      } catch (const std::exception& error) {  // one that leaves a callback would end the whole manager
        sink.on_drop({reason, Concat(source.fixed.topic, ": ", error.what()), BringsImages(kind)});
      }
    };
    source.last_received_s = sink_.now_s();
    source.subscribe = [topic = stream.topic, queue = stream.queue, receive](const ros::NodeHandle& nh) {
      return SubscribeChecked<Message>(nh, topic, queue, receive);
    };
    source.play = [&source, receive, sink = sink_, reason = stream.reason](const rosbag::MessageInstance& record) {
      if (record.getDataType() != source.fixed.type) return;
      try {
        if (const auto message = InstantiateChecked<Message>(record)) return receive(message);
        throw InvalidInputError(Concat("recorded with another definition of ", source.fixed.type,
                                       "; convert it with: rosbag fix, or, if it was of ROS 2, "
                                       "rosbags-convert ... --dst-typestore ros1_noetic"));
      } catch (const InvalidInputError& error) {
        ++source.received;
        sink.on_drop({reason, Concat(source.fixed.topic, ": ", error.what()), BringsImages(source.fixed.kind)});
      }
    };
  }

  void AddPoses() {
    const InputStream stream = {Kind::kPose, options_.pose_source, kPoseQueue, "bad_pose", true};
    ForEachPoseSource([&](const auto& source) {
      if (source.name != options_.pose_source) return;
      Add<typename std::decay_t<decltype(source)>::MessageType>(
          stream, [&source](const auto& message) { return source.convert(*message); }, &KeyframeIntake::AddPose);
    });
    if (options_.pose_source != kTfPoses) return;
    // TfLookup has the transforms, too: here they tell that poses may have come.
    Add<tf2_msgs::TFMessage>({Kind::kPose, names::kTf, kPoseQueue, "bad_pose", true}, kAsItIs, [](const auto&...) {});
  }

  template <class Message>
  void AddCloud(const char* topic) {
    Add<Message>(
        {Kind::kCloud, topic, kCloudQueue, "bad_sparse_points", false},
        [](const auto& message) { return std::make_shared<const SparseCloud>(ToSparseCloud(*message)); },
        &KeyframeIntake::AddCloud);
  }

  template <class Take>
  void AddImages(InputStream stream, Take take) {
    if (options_.image_transport == ImageTransport::kRaw) {
      const auto convert = [topic = topics_.resolve(stream.name)](const sensor_msgs::ImageConstPtr& message) {
        return std::make_shared<const EncodedImage>(EncodedImage{message, nullptr, topic});
      };
      return Add<sensor_msgs::Image>(stream, convert, take);
    }
    stream.topic = CompressedTopic(topics_, stream.name);
    const auto convert = [topic = stream.topic](const sensor_msgs::CompressedImageConstPtr& message) {
      return std::make_shared<const EncodedImage>(EncodedImage{nullptr, message, topic});
    };
    Add<sensor_msgs::CompressedImage>(stream, convert, take);
  }

  const InputTopics topics_;
  const NodeOptions& options_;
  const InputSink sink_;
  InputSources sources_;
};

}  // namespace

InputStatus InputSource::status() const {
  InputStatus status = fixed;
  status.publishers = subscriber.getNumPublishers();
  status.received = received;
  status.last_received_s = last_received_s;
  return status;
}

InputTopics TopicsOf(const ros::NodeHandle& nh) {
  return {[nh](const std::string& name) { return nh.resolveName(name); },
          [nh](const std::string& name) { return nh.resolveName(name, true) != nh.resolveName(name, false); }};
}

InputSources MakeInputSources(const InputTopics& topics, const NodeOptions& options, const InputSink& sink) {
  return SourceFactory(topics, options, sink).Make();
}

void Subscribe(const ros::NodeHandle& nh, const InputSources* sources) {
  std::map<std::string, const InputSource*> first;  // of each topic
  for (const auto& source : *sources) {
    const InputStatus& input = source->fixed;
    const auto [other, is_new] = first.emplace(input.topic, source.get());
    try {
      source->subscriber = source->subscribe(nh);
    } catch (const ros::ConflictingSubscriptionException&) {
      throw InvalidInputError(Concat("the input ", input.name, " (", input.type, ") is ", input.topic, ", to which ",
                                     is_new ? "another nodelet of this process subscribes with another type"
                                            : Concat("the input ", other->second->fixed.name, " (",
                                                     other->second->fixed.type, ") subscribes, too"),
                                     ": each must have the topic of its own type"));
    }
  }
}

void SetExpected(const InputSources& sources, const std::function<bool(const InputSource&)>& is_published,
                 KeyframeIntake* intake) {
  bool clouds = false;  // of two topics
  for (const auto& source : sources) {
    const InputStatus& input = source->fixed;
    const bool is_there = source->received > 0 || is_published(*source);
    if (input.kind == Kind::kCloud) clouds = clouds || is_there;
    if (const CompanionRow* row = CompanionRowOf(input.kind)) intake->set_companion_expected(row->stream, is_there);
    if (input.kind == Kind::kSourceImage) intake->set_companion_expected(kSourceStream + input.camera, is_there);
  }
  intake->set_clouds_expected(clouds);
}

std::string WithoutCompressed(const std::string& topic) {
  if (!boost::algorithm::ends_with(topic, names::kCompressed) || topic == names::kCompressed) return topic;
  return topic.substr(0, topic.size() - std::strlen(names::kCompressed));
}

void AddAdvice(const std::map<std::string, std::string>& published, std::vector<InputStatus>* inputs) {
  std::map<std::string, std::string> unused = published;
  for (const std::string& mapper : FindMappers(published)) {
    for (const auto& [topic, type] : published) {
      if (boost::algorithm::starts_with(topic, mapper) && IsOutput(topic.substr(mapper.size()))) unused.erase(topic);
    }
  }
  for (const InputStatus& input : *inputs) {
    if (const auto named = published.find(input.topic); named != published.end()) unused.insert(*named);
  }
  for (const InputStatus& input : *inputs) {
    if (input.received > 0) unused.erase(input.topic);
  }
  for (InputStatus& input : *inputs) {
    if (input.received == 0) input.advice = AdviceOn(input, unused);
  }
}

uint64_t ImagesReceived(const InputSources& sources) {
  uint64_t received = 0;
  for (const auto& source : sources) received += BringsImages(source->fixed.kind) ? source->received.load() : 0;
  return received;
}

uint64_t ImagesReceived(const std::vector<InputStatus>& inputs) {
  uint64_t received = 0;
  for (const InputStatus& input : inputs) {
    if (BringsImages(input.kind)) received += input.received;
  }
  return received;
}

}  // namespace acmp
