#include "acmp_mapping/ros/session_bag.h"

#include <algorithm>
#include <vector>

#include <rosbag/view.h>
#include <std_msgs/Float64.h>
#include <std_msgs/UInt32.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/mesh/splat_points.h"
#include "acmp_mapping/ros/bag_file.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using acmp_mapping::KeyframePoints;

constexpr char kVersionTopic[] = "/session_version";
constexpr char kKeyframesTopic[] = "/session_keyframes";
constexpr char kEarlierTopic[] = "/session_earlier_keyframes";
constexpr char kVoxelSizeTopic[] = "/session_voxel_size";
constexpr char kWhenCutOff[] = "save the session again, or take an earlier file";

std::string Topic(const char* name) { return Concat("/", name); }

template <class Message, class Value>
void WriteValue(const char* topic, const ros::Time& time, Value value, BagWriter* bag) {
  Message message;
  message.data = value;
  bag->Write(topic, time, message);
}

/// What the camera of a keyframe sees of its points.
void WriteImages(const SessionKeyframe& keyframe, double voxel_size, const ros::Time& time,
                 const std_msgs::Header& header, BagWriter* bag) {
  const PointCloud points = keyframe.points_in_camera->Unpack();
  const SurfaceMaps maps =
      SplatPoints(points, PosedCamera{keyframe.pose.camera, keyframe.pose.world_from_cam().inverse()},
                  PointSpacing(points, voxel_size));
  const Image<unsigned char> all(maps.depth.width(), maps.depth.height(), 1);
  bag->Write(Topic(names::kDepth), time, *ToDepthMessage(maps.depth, all.View(), header));
  bag->Write(Topic(names::kDepthCameraInfo), time, *ToCameraInfo(maps.camera.camera, header));
  bag->Write(Topic(names::kConfidence), time, *ToFloatMessage(maps.confidence, header));
  bag->Write(Topic(names::kColor), time, *ToColorMessage(maps.color, header));
}

/// Messages of a topic, which must have this package's definition of their type.
template <class Message, class Handle>
void ForEach(const rosbag::Bag& bag, const std::string& topic, const Handle& handle) {
  for (const rosbag::MessageInstance& record : rosbag::View(bag, rosbag::TopicQuery(topic))) {
    const boost::shared_ptr<Message> message = InstantiateChecked<Message>(record);
    if (!message) {
      throw InvalidInputError(
          Concat(topic, " is a ", record.getDataType(), " of another definition than this program's ",
                 ros::message_traits::DataType<Message>::value(), ": use the program that saved the session"));
    }
    handle(*message);
  }
}

/// The only message of a topic.
template <class Message>
auto ReadValue(const rosbag::Bag& bag, const char* topic) {
  std::vector<decltype(Message::data)> values;
  ForEach<Message>(bag, topic, [&](const Message& message) { values.push_back(message.data); });
  if (values.size() == 1) return values.front();
  throw InvalidInputError(
      Concat("has ", values.size(), " messages on ", topic, " instead of one: not written by save_session"));
}

Session ReadOpened(const rosbag::Bag& bag, size_t max_bytes, const KeepImage& keep_image) {
  const uint32_t version = ReadValue<std_msgs::UInt32>(bag, kVersionTopic);
  if (version != kSessionVersion) {
    throw InvalidInputError(Concat("is a session of version ", version, ", this program reads version ",
                                   kSessionVersion, ": use the program that saved it"));
  }
  const std::string topic = Topic(names::kKeyframePoints);
  const uint32_t expected = ReadValue<std_msgs::UInt32>(bag, kKeyframesTopic);
  const uint32_t present = rosbag::View(bag, rosbag::TopicQuery(topic)).size();
  if (present != expected || expected == 0) {
    throw InvalidInputError(Concat("has ", present, " of ", expected, " keyframes; ", kWhenCutOff));
  }
  Session session;
  session.map.earlier = ReadValue<std_msgs::UInt32>(bag, kEarlierTopic);
  session.map.voxel_size = ReadValue<std_msgs::Float64>(bag, kVoxelSizeTopic);
  session.map.keyframes.resize(expected);
  ForEach<KeyframePoints>(bag, topic, [&](const KeyframePoints& message) {
    try {
      CheckRange<uint64_t>("count", message.count, 1, expected);
      SessionKeyframe& keyframe = session.map.keyframes[message.count - 1];
      if (keyframe.points_in_camera) throw InvalidInputError(Concat("count = ", message.count, " comes twice"));
      KeyframePointsHead head = ReadHead(message, max_bytes);
      keyframe = {std::move(head.key), std::move(head.pose),
                  std::make_shared<const PackedCloud>(ToPointCloud(message.points))};
      if (keep_image) keyframe.image = keep_image(message);
      session.world_frame = head.world_frame;
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat(NameOf(message), ": ", error.what()));
    }
  });
  return session;
}

}  // namespace

void WriteSession(const std::filesystem::path& path, const Session& session, const std::function<void()>& check) {
  const std::vector<SessionKeyframe>& keyframes = session.map.keyframes;
  if (keyframes.empty()) throw InvalidInputError("the map is empty: nothing was written");
  CheckMapPath(path);
  BagWriter bag(path, Durability::kPowerCut, rosbag::compression::LZ4);
  uint64_t count = 0;
  for (const SessionKeyframe& keyframe : keyframes) {
    check();
    const KeyframePointsHead head = {keyframe.key, keyframe.pose, session.world_frame};
    const acmp_mapping::KeyframePointsPtr message = ToKeyframePoints(head, keyframe.points_in_camera->Unpack());
    const ros::Time time = std::max(message->header.stamp, ros::TIME_MIN);
    if (count == 0) {
      WriteValue<std_msgs::UInt32>(kVersionTopic, time, kSessionVersion, &bag);
      WriteValue<std_msgs::UInt32>(kKeyframesTopic, time, static_cast<uint32_t>(keyframes.size()), &bag);
      WriteValue<std_msgs::UInt32>(kEarlierTopic, time, static_cast<uint32_t>(session.map.earlier), &bag);
      WriteValue<std_msgs::Float64>(kVoxelSizeTopic, time, session.map.voxel_size, &bag);
    }
    message->count = ++count;
    if (keyframe.image) FillImage(keyframe.image->Read(), message.get());
    bag.Write(Topic(names::kKeyframePoints), time, *message);
    WriteImages(keyframe, session.map.voxel_size, time, message->points.header, &bag);
  }
  bag.Finish();
}

Session ReadSession(const std::filesystem::path& path, size_t max_bytes, const KeepImage& keep_image) {
  Session session;
  const auto read = [&](const rosbag::Bag& bag) {
    try {
      session = ReadOpened(bag, max_bytes, keep_image);
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat(path, ": ", error.what()));
    }
  };
  ReadBag(path, kWhenCutOff, read, max_bytes);
  return session;
}

}  // namespace acmp
