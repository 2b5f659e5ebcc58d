#include "bag_contents.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <set>

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/ros/bag_reader.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {
namespace {

constexpr const char* kTfType = "tf2_msgs/TFMessage";

std::vector<BagTopic> ReadTopics(const rosbag::Bag& bag) {
  std::map<std::string, BagTopic> topics;
  std::map<std::string, ros::Time> first;
  rosbag::View all(bag);
  for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
    topics[connection->topic] = {connection->topic, connection->datatype, 0, 0};
  }
  for (const rosbag::MessageInstance& message : all) {
    BagTopic& topic = topics[message.getTopic()];
    ++topic.messages;
    topic.duration_s = (message.getTime() - first.try_emplace(topic.name, message.getTime()).first->second).toSec();
  }
  std::vector<BagTopic> list;
  list.reserve(topics.size());
  for (auto& [name, topic] : topics) list.push_back(std::move(topic));
  return list;
}

/// The wanted topic, or the preferred one of some types; empty when there is none.
std::string ChooseTopic(const std::vector<BagTopic>& topics, const std::vector<std::string>& types,
                        const std::string& wanted, const char* option) {
  const auto preference = [&](const BagTopic& topic) { return std::find(types.begin(), types.end(), topic.type); };
  const BagTopic* best = nullptr;
  for (const BagTopic& topic : topics) {
    if (!wanted.empty() && topic.name != wanted) continue;
    if (wanted.empty() && preference(topic) == types.end()) continue;
    const bool better = best == nullptr || preference(topic) < preference(*best) ||
                        (topic.type == best->type && topic.messages > best->messages);
    if (better) best = &topic;
  }
  if (best == nullptr && !wanted.empty()) throw InvalidInputError(Concat(option, " ", wanted, ": not in the bag"));
  if (best == nullptr) return "";
  if (preference(*best) == types.end() && !(best->type == kTfType && &types == &PoseTypes())) {
    throw InvalidInputError(
        Concat(option, " ", wanted, ": has type ", best->type, ", which the mapper cannot use there"));
  }
  return best->name;
}

/// Image topics whose first message is a depth map, as RGB-D cameras have.
std::set<std::string> DepthTopics(const rosbag::Bag& bag) {
  std::set<std::string> seen, depth;
  for (const rosbag::MessageInstance& record :
       rosbag::View(bag, rosbag::TypeQuery(ros::message_traits::DataType<sensor_msgs::Image>::value()))) {
    if (!seen.insert(record.getTopic()).second) continue;
    const auto image = record.instantiate<sensor_msgs::Image>();
    if (!image) continue;
    const std::string& encoding = image->encoding;
    if (encoding == sensor_msgs::image_encodings::TYPE_16UC1 || encoding == sensor_msgs::image_encodings::TYPE_32FC1) {
      depth.insert(record.getTopic());
    }
  }
  return depth;
}

/// The camera_info beside an image's topic, if there is one.
std::string CameraInfoBeside(const std::vector<BagTopic>& topics, const std::string& image) {
  const std::string base = WithoutCompressed(image);
  const std::string beside = base.substr(0, base.rfind('/') + 1) + "camera_info";
  const bool found =
      std::any_of(topics.begin(), topics.end(), [&](const BagTopic& topic) { return topic.name == beside; });
  return found ? beside : "";
}

/// The wanted topic, or the first that is named as a mask.
std::string ChooseMaskTopic(const std::vector<BagTopic>& topics, const TopicChoice& wanted) {
  const std::vector<std::string> types = {ros::message_traits::DataType<sensor_msgs::Image>::value()};
  if (!wanted.mask.empty()) return ChooseTopic(topics, types, wanted.mask, "--mask");
  const std::string ending = "mask";
  for (const BagTopic& topic : topics) {
    const size_t size = topic.name.size();
    const bool is_named = size >= ending.size() && topic.name.compare(size - ending.size(), size, ending) == 0;
    if (is_named && topic.type == types.front() && topic.name != wanted.image) return topic.name;
  }
  return "";
}

/// Adds what convert(message) makes of a record of this type; nothing of another type.
template <class Message, class Stream, class Convert>
void AddIf(const rosbag::MessageInstance& record, Stream* stream, const Convert& convert) {
  if (record.getDataType() != ros::message_traits::DataType<Message>::value()) return;
  stream->Add([&] {
    const boost::shared_ptr<Message> message = InstantiateChecked<Message>(record);
    if (message) return convert(message);
    throw InvalidInputError(
        Concat("recorded with another definition of ", record.getDataType(), "; convert it with: rosbag fix"));
  });
}

BagImage ToBagImage(const EncodedImage& image) {
  const cv::Mat rgb = DecodeRgb(image);
  return {ToStampNs(image.header().stamp), StripLeadingSlash(image.header().frame_id),
          image.raw ? image.raw->encoding : image.compressed->format, rgb.cols, rgb.rows};
}

BagMask ToBagMask(const sensor_msgs::ImageConstPtr& message) {
  const CompanionSample sample = ToMaskSample(message);
  const PinholeCamera size = {static_cast<int>(message->width), static_cast<int>(message->height)};
  return {sample.stamp_ns, size.width, size.height, IgnoresAll(DecodeMask(*sample.image, size))};
}

/// Whole clouds at first, as the convention check compares them, then a sample: a cloud may be a whole map.
template <class Message>
SparseCloud ToSample(const Message& message, size_t* whole_points) {
  constexpr size_t kSample = 1000, kMostWhole = 5000000;
  SparseCloud cloud = ToSparseCloud(message);
  *whole_points += cloud.points.size();
  if (*whole_points <= kMostWhole) return cloud;
  const size_t step = cloud.points.size() / kSample + 1;
  std::vector<Eigen::Vector3d> sample;
  for (size_t i = 0; i < cloud.points.size(); i += step) sample.push_back(cloud.points[i]);
  cloud.points = std::move(sample);
  return cloud;
}

void ReadMessage(const rosbag::MessageInstance& record, BagContents* contents) {
  const TopicChoice& chosen = contents->chosen;
  const std::string& topic = record.getTopic();
  const auto to_pose = [](const auto& message) { return ToPoseSample(*message); };
  const auto to_cloud = [contents](const auto& message) { return ToSample(*message, &contents->whole_points); };
  if (topic == chosen.image) {
    AddIf<sensor_msgs::Image>(record, &contents->images, [](const auto& raw) { return ToBagImage({raw, {}}); });
    AddIf<sensor_msgs::CompressedImage>(record, &contents->images, [](const auto& m) { return ToBagImage({{}, m}); });
  } else if (topic == chosen.mask) {
    AddIf<sensor_msgs::Image>(record, &contents->masks, [](const auto& mask) { return ToBagMask(mask); });
  } else if (topic == chosen.camera_info) {
    AddIf<sensor_msgs::CameraInfo>(record, &contents->calibrations, [](const auto& info) {
      return BagCalibration{ToCalibration(*info, false), !info->distortion_model.empty() || !info->D.empty()};
    });
  } else if (topic == chosen.pose) {
    AddIf<geometry_msgs::PoseStamped>(record, &contents->poses, to_pose);
    AddIf<geometry_msgs::PoseWithCovarianceStamped>(record, &contents->poses, to_pose);
    AddIf<nav_msgs::Odometry>(record, &contents->poses, to_pose);
    AddIf<geometry_msgs::TransformStamped>(record, &contents->poses, to_pose);
  } else if (topic == chosen.sparse_points) {
    AddIf<sensor_msgs::PointCloud2>(record, &contents->clouds, to_cloud);
    AddIf<sensor_msgs::PointCloud>(record, &contents->clouds, to_cloud);
  }
}

std::string RootOf(const tf2::BufferCore& buffer, const std::string& frame) {
  constexpr int kMaxChain = 1000;  // a corrupt tree may be a loop
  std::string root = frame;
  std::string parent;
  for (int i = 0; i < kMaxChain && buffer._getParent(root, ros::Time(), parent); ++i) root = parent;
  return root;
}

/// The camera's pose at each image from the transform tree, seen from the tree's root.
void ReadPosesFromTf(const rosbag::Bag& bag, BagContents* contents) {
  if (contents->images.samples.empty()) return;
  constexpr double kWholeBag_s = 1e9;
  tf2::BufferCore buffer{ros::Duration(kWholeBag_s)};
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TypeQuery(kTfType))) {
    const auto transforms = InstantiateChecked<tf2_msgs::TFMessage>(message);
    if (transforms == nullptr) continue;
    const bool is_static = message.getTopic().find("tf_static") != std::string::npos;
    for (const auto& transform : transforms->transforms) buffer.setTransform(transform, "bag", is_static);
  }
  const std::string camera = contents->images.samples.front().frame;
  const std::string root = RootOf(buffer, camera);
  if (root == camera) return;
  contents->pose_from_tf = Concat(root, " -> ", camera);
  for (const BagImage& image : contents->images.samples) {
    try {
      const ros::Time stamp = ros::Time().fromNSec(static_cast<uint64_t>(image.stamp_ns));
      const geometry_msgs::TransformStamped transform = buffer.lookupTransform(root, camera, stamp);
      contents->poses.Add([&] { return ToPoseSample(transform); });
    } catch (const tf2::TransformException&) {
      // an image without a pose shows up as unmatched
    }
  }
}

/// T_body_cam, if tf_static has it.
std::optional<RigidTransform> ReadExtrinsic(const rosbag::Bag& bag, const std::string& body,
                                            const std::string& camera) {
  if (body.empty() || camera.empty() || body == camera) return std::nullopt;
  tf2::BufferCore buffer;
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TypeQuery(kTfType))) {
    if (message.getTopic().find("tf_static") == std::string::npos) continue;
    const auto transforms = message.instantiate<tf2_msgs::TFMessage>();
    if (transforms == nullptr) continue;
    for (const auto& transform : transforms->transforms) buffer.setTransform(transform, "bag", true);
  }
  try {
    return ToTransform(buffer.lookupTransform(body, camera, ros::Time()).transform);
  } catch (const tf2::TransformException&) {
    return std::nullopt;
  }
}

BagContents ReadOpened(const rosbag::Bag& bag, const TopicChoice& wanted) {
  BagContents contents;
  contents.topics = ReadTopics(bag);
  TopicChoice& chosen = contents.chosen;
  chosen.mask = ChooseMaskTopic(contents.topics, wanted);
  const std::set<std::string> depth = DepthTopics(bag);
  std::vector<BagTopic> but_masks, pictures;
  std::copy_if(contents.topics.begin(), contents.topics.end(), std::back_inserter(but_masks),
               [&](const BagTopic& topic) { return topic.name != chosen.mask; });
  std::copy_if(but_masks.begin(), but_masks.end(), std::back_inserter(pictures),
               [&](const BagTopic& topic) { return depth.count(topic.name) == 0; });
  chosen.image = ChooseTopic(wanted.image.empty() ? pictures : but_masks, ImageTypes(), wanted.image, "--image");
  if (chosen.image.empty()) chosen.image = ChooseTopic(but_masks, ImageTypes(), "", "--image");
  const std::string beside = CameraInfoBeside(contents.topics, chosen.image);
  chosen.camera_info = ChooseTopic(contents.topics, CameraInfoTypes(),
                                   wanted.camera_info.empty() ? beside : wanted.camera_info, "--camera-info");
  chosen.pose = ChooseTopic(contents.topics, PoseTypes(), wanted.pose, "--pose");
  chosen.sparse_points = ChooseTopic(contents.topics, CloudTypes(), wanted.sparse_points, "--sparse-points");
  if (const BagTopic* pose = contents.Find(chosen.pose); pose && pose->type == kTfType) chosen.pose.clear();
  const std::vector<std::string> topics = {chosen.image, chosen.camera_info, chosen.pose, chosen.sparse_points,
                                           chosen.mask};
  for (const rosbag::MessageInstance& record : rosbag::View(bag, rosbag::TopicQuery(topics))) {
    ReadMessage(record, &contents);
  }
  if (chosen.pose.empty()) ReadPosesFromTf(bag, &contents);
  if (!contents.poses.samples.empty() && !contents.images.samples.empty() && !chosen.pose.empty()) {
    contents.body_from_cam =
        ReadExtrinsic(bag, contents.poses.samples.front().child_frame, contents.images.samples.front().frame);
  }
  return contents;
}

template <class... Messages>
std::vector<std::string> TypesOf() {
  return {ros::message_traits::DataType<Messages>::value()...};
}

}  // namespace

const BagTopic* BagContents::Find(const std::string& name) const {
  const auto found = std::find_if(topics.begin(), topics.end(), [&](const BagTopic& t) { return t.name == name; });
  return found == topics.end() ? nullptr : &*found;
}

std::string WithoutCompressed(const std::string& topic) {
  const std::string suffix = "/compressed";
  const bool ends =
      topic.size() > suffix.size() && topic.compare(topic.size() - suffix.size(), suffix.size(), suffix) == 0;
  return ends ? topic.substr(0, topic.size() - suffix.size()) : topic;
}

const std::vector<std::string>& ImageTypes() {
  static const auto types = TypesOf<sensor_msgs::Image, sensor_msgs::CompressedImage>();
  return types;
}
const std::vector<std::string>& CameraInfoTypes() {
  static const auto types = TypesOf<sensor_msgs::CameraInfo>();
  return types;
}
const std::vector<std::string>& PoseTypes() {
  static const auto types = TypesOf<geometry_msgs::PoseStamped, geometry_msgs::PoseWithCovarianceStamped,
                                    nav_msgs::Odometry, geometry_msgs::TransformStamped>();
  return types;
}
const std::vector<std::string>& CloudTypes() {
  static const auto types = TypesOf<sensor_msgs::PointCloud2, sensor_msgs::PointCloud>();
  return types;
}

BagContents ReadBagContents(const std::filesystem::path& path, const TopicChoice& wanted) {
  BagContents contents;
  ReadBag(path, "repair it with: rosbag reindex", [&](const rosbag::Bag& bag) { contents = ReadOpened(bag, wanted); });
  return contents;
}

}  // namespace acmp
