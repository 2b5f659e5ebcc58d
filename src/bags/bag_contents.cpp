#include "acmp_mapping/bags/bag_contents.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

namespace traits = ros::message_traits;

constexpr size_t kCloudSample = 500;  // points per cloud: enough for shares to a few percent

struct KnownType {
  std::string name;
  std::string md5;
  TopicRole role;
};

template <class Message>
KnownType Known(TopicRole role) {
  return {traits::DataType<Message>::value(), traits::MD5Sum<Message>::value(), role};
}

/// In order of preference where several topics could play a role.
const std::vector<KnownType>& KnownTypes() {
  static const std::vector<KnownType> types = {
      Known<sensor_msgs::Image>(TopicRole::kImage),
      Known<sensor_msgs::CompressedImage>(TopicRole::kImage),
      Known<sensor_msgs::CameraInfo>(TopicRole::kCameraInfo),
      Known<geometry_msgs::PoseStamped>(TopicRole::kPose),
      Known<geometry_msgs::PoseWithCovarianceStamped>(TopicRole::kPose),
      Known<nav_msgs::Odometry>(TopicRole::kPose),
      Known<geometry_msgs::TransformStamped>(TopicRole::kPose),
      Known<tf2_msgs::TFMessage>(TopicRole::kTf),
      Known<sensor_msgs::PointCloud2>(TopicRole::kSparsePoints),
      Known<sensor_msgs::PointCloud>(TopicRole::kSparsePoints),
  };
  return types;
}

size_t Preference(const std::string& type) {
  const auto& types = KnownTypes();
  return std::find_if(types.begin(), types.end(), [&](const KnownType& known) { return known.name == type; }) -
         types.begin();
}

void Describe(const rosbag::ConnectionInfo& connection, BagTopic& topic) {
  topic.name = connection.topic;
  topic.type = connection.datatype;
  for (const KnownType& known : KnownTypes()) {
    if (known.name != connection.datatype) continue;
    topic.role = known.role;
    topic.known_definition = known.md5 == connection.md5sum;
  }
}

std::vector<BagTopic> ReadTopics(const rosbag::Bag& bag) {
  std::map<std::string, BagTopic> topics;
  rosbag::View all(bag);
  for (const rosbag::ConnectionInfo* connection : all.getConnections())
    Describe(*connection, topics[connection->topic]);
  for (const rosbag::MessageInstance& message : all) {
    BagTopic& topic = topics[message.getTopic()];
    if (topic.messages++ == 0) topic.first = message.getTime();
    topic.last = message.getTime();
  }
  std::vector<BagTopic> list;
  list.reserve(topics.size());
  for (auto& [name, topic] : topics) list.push_back(std::move(topic));
  return list;
}

/// The wanted topic, or the preferred one of a role; empty when there is none.
std::string ChooseTopic(const std::vector<BagTopic>& topics, TopicRole role, const std::string& wanted,
                        const char* option) {
  const BagTopic* best = nullptr;
  for (const BagTopic& topic : topics) {
    if (!wanted.empty() && topic.name != wanted) continue;
    if (topic.role != role && wanted.empty()) continue;
    const bool better = best == nullptr || Preference(topic.type) < Preference(best->type) ||
                        (topic.type == best->type && topic.messages > best->messages);
    if (better) best = &topic;
  }
  if (best != nullptr && best->role != role && !(role == TopicRole::kPose && best->role == TopicRole::kTf)) {
    throw InvalidInputError(
        Concat(option, " ", wanted, ": has type ", best->type, ", which the mapper cannot use there"));
  }
  if (best == nullptr && !wanted.empty()) throw InvalidInputError(Concat(option, " ", wanted, ": not in the bag"));
  return best != nullptr ? best->name : "";
}

ImageRecord ToRecord(const sensor_msgs::Image& image) {
  ImageRecord record{image.header.stamp, image.header.frame_id, image.encoding, false, image.width, image.height};
  try {
    const int bits = sensor_msgs::image_encodings::bitDepth(image.encoding) *
                     sensor_msgs::image_encodings::numChannels(image.encoding);
    record.complete = image.step >= image.width * bits / 8 && image.data.size() >= size_t{image.step} * image.height;
  } catch (const std::runtime_error&) {
    record.complete = true;  // an encoding that nobody knows is reported as such
  }
  return record;
}

ImageRecord ToRecord(const sensor_msgs::CompressedImage& image) {
  return {image.header.stamp, image.header.frame_id, image.format, true, 0, 0, !image.data.empty()};
}

CameraInfoRecord ToRecord(const sensor_msgs::CameraInfo& info) {
  const bool has_roi = info.roi.width > 0 && info.roi.height > 0;
  const uint32_t binning_x = std::max(info.binning_x, 1u);
  const uint32_t binning_y = std::max(info.binning_y, 1u);
  CameraInfoRecord record;
  record.width = (has_roi ? info.roi.width : info.width) / binning_x;
  record.height = (has_roi ? info.roi.height : info.height) / binning_y;
  record.fx = info.K[0];
  record.fy = info.K[4];
  record.cx = info.K[2];
  record.cy = info.K[5];
  record.resized = has_roi || binning_x > 1 || binning_y > 1;
  record.distortion_model = info.distortion_model;
  record.distortion_size = info.D.size();
  return record;
}

PoseRecord ToRecord(const std_msgs::Header& header, const geometry_msgs::Pose& pose) {
  return {header.stamp,
          header.frame_id,
          {pose.position.x, pose.position.y, pose.position.z},
          {pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w}};
}

PoseRecord ToRecord(const geometry_msgs::TransformStamped& transform) {
  const auto& t = transform.transform.translation;
  const auto& q = transform.transform.rotation;
  return {transform.header.stamp, transform.header.frame_id, {t.x, t.y, t.z}, {q.x, q.y, q.z, q.w}};
}

/// Counts the unusable points of a cloud and keeps a sample of the others.
class CloudReader {
 public:
  explicit CloudReader(size_t points) : stride_(points / kCloudSample + 1) {}

  void Add(const Eigen::Vector3f& point, CloudRecord& record) {
    if (!point.allFinite()) {
      ++record.not_finite;
    } else if (point.isZero(0)) {
      ++record.all_zero;
    } else if (usable_++ % stride_ == 0) {
      record.sample.push_back(point);
    }
  }

 private:
  size_t stride_;
  size_t usable_ = 0;
};

std::string LayoutProblem(const sensor_msgs::PointCloud2& cloud) {
  for (const char* axis : {"x", "y", "z"}) {
    const auto field = std::find_if(cloud.fields.begin(), cloud.fields.end(),
                                    [&](const sensor_msgs::PointField& candidate) { return candidate.name == axis; });
    if (field == cloud.fields.end()) return Concat("has no field ", axis);
    if (field->datatype != sensor_msgs::PointField::FLOAT32) return Concat("field ", axis, " is not FLOAT32");
    if (field->offset + sizeof(float) > cloud.point_step) return Concat("field ", axis, " lies outside the point");
  }
  if (cloud.is_bigendian != 0) return "is big endian";
  if (cloud.data.size() < size_t{cloud.width} * cloud.height * cloud.point_step) {
    return Concat("has ", cloud.data.size(), " bytes for ", size_t{cloud.width} * cloud.height, " points of ",
                  cloud.point_step);
  }
  return "";
}

CloudRecord ToRecord(const sensor_msgs::PointCloud2& cloud) {
  CloudRecord record;
  record.stamp = cloud.header.stamp;
  record.frame = cloud.header.frame_id;
  record.points = size_t{cloud.width} * cloud.height;
  record.problem = LayoutProblem(cloud);
  if (!record.problem.empty()) return record;
  CloudReader reader(record.points);
  sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
  for (size_t i = 0; i < record.points; ++i, ++x, ++y, ++z) reader.Add({*x, *y, *z}, record);
  return record;
}

CloudRecord ToRecord(const sensor_msgs::PointCloud& cloud) {
  CloudRecord record;
  record.stamp = cloud.header.stamp;
  record.frame = cloud.header.frame_id;
  record.points = cloud.points.size();
  CloudReader reader(record.points);
  for (const auto& point : cloud.points) reader.Add({point.x, point.y, point.z}, record);
  return record;
}

void ReadImage(const rosbag::MessageInstance& message, BagContents& contents) {
  if (const auto image = message.instantiate<sensor_msgs::Image>()) {
    contents.images.push_back(ToRecord(*image));
  } else if (const auto compressed = message.instantiate<sensor_msgs::CompressedImage>()) {
    contents.images.push_back(ToRecord(*compressed));
  }
}

void ReadPose(const rosbag::MessageInstance& message, BagContents& contents) {
  if (const auto pose = message.instantiate<geometry_msgs::PoseStamped>()) {
    contents.poses.push_back(ToRecord(pose->header, pose->pose));
  } else if (const auto pose_cov = message.instantiate<geometry_msgs::PoseWithCovarianceStamped>()) {
    contents.poses.push_back(ToRecord(pose_cov->header, pose_cov->pose.pose));
  } else if (const auto odometry = message.instantiate<nav_msgs::Odometry>()) {
    contents.poses.push_back(ToRecord(odometry->header, odometry->pose.pose));
  } else if (const auto transform = message.instantiate<geometry_msgs::TransformStamped>()) {
    contents.poses.push_back(ToRecord(*transform));
  }
}

void ReadCloud(const rosbag::MessageInstance& message, BagContents& contents) {
  if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
    contents.clouds.push_back(ToRecord(*cloud));
  } else if (const auto cloud_v1 = message.instantiate<sensor_msgs::PointCloud>()) {
    contents.clouds.push_back(ToRecord(*cloud_v1));
  }
}

void ReadMessages(const rosbag::Bag& bag, BagContents& contents) {
  const TopicChoice& chosen = contents.chosen;
  std::vector<std::string> names;
  for (const std::string& name : {chosen.image, chosen.camera_info, chosen.pose, chosen.sparse_points}) {
    if (!name.empty()) names.push_back(name);
  }
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(names))) {
    const std::string& topic = message.getTopic();
    if (topic == chosen.image) ReadImage(message, contents);
    if (topic == chosen.camera_info) {
      if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
        contents.camera_infos.push_back(ToRecord(*info));
      }
    }
    if (topic == chosen.pose) ReadPose(message, contents);
    if (topic == chosen.sparse_points) ReadCloud(message, contents);
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
void ReadPosesFromTf(const rosbag::Bag& bag, BagContents& contents) {
  if (contents.images.empty()) return;
  constexpr double kWholeBag_s = 1e9;
  tf2::BufferCore buffer{ros::Duration(kWholeBag_s)};
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TypeQuery("tf2_msgs/TFMessage"))) {
    const auto transforms = message.instantiate<tf2_msgs::TFMessage>();
    if (transforms == nullptr) continue;
    const bool is_static = message.getTopic().find("tf_static") != std::string::npos;
    for (const auto& transform : transforms->transforms) buffer.setTransform(transform, "bag", is_static);
  }
  const std::string& camera = contents.images.front().frame;
  const std::string root = RootOf(buffer, camera);
  if (root == camera) return;
  contents.pose_from_tf = Concat(root, " -> ", camera);
  for (const ImageRecord& image : contents.images) {
    try {
      contents.poses.push_back(ToRecord(buffer.lookupTransform(root, camera, image.stamp)));
    } catch (const tf2::TransformException&) {
      // an image without a pose shows up as unmatched
    }
  }
}

BagContents ReadOpened(const rosbag::Bag& bag, const TopicChoice& wanted) {
  BagContents contents;
  contents.topics = ReadTopics(bag);
  TopicChoice& chosen = contents.chosen;
  chosen.image = ChooseTopic(contents.topics, TopicRole::kImage, wanted.image, "--image");
  chosen.camera_info = ChooseTopic(contents.topics, TopicRole::kCameraInfo, wanted.camera_info, "--camera-info");
  chosen.pose = ChooseTopic(contents.topics, TopicRole::kPose, wanted.pose, "--pose");
  chosen.sparse_points =
      ChooseTopic(contents.topics, TopicRole::kSparsePoints, wanted.sparse_points, "--sparse-points");
  const bool is_tf = std::any_of(contents.topics.begin(), contents.topics.end(), [&](const BagTopic& topic) {
    return topic.name == chosen.pose && topic.role == TopicRole::kTf;
  });
  if (is_tf) chosen.pose.clear();
  ReadMessages(bag, contents);
  if (chosen.pose.empty()) ReadPosesFromTf(bag, contents);
  return contents;
}

}  // namespace

BagContents ReadBagContents(const std::filesystem::path& path, const TopicChoice& wanted) {
  if (!std::filesystem::is_regular_file(path)) throw InvalidInputError(Concat(path, ": no such file"));
  try {
    rosbag::Bag bag(path.string(), rosbag::bagmode::Read);
    return ReadOpened(bag, wanted);
  } catch (const InvalidInputError&) {
    throw;
  } catch (const rosbag::BagUnindexedException&) {
    throw InvalidInputError(
        Concat(path, ": has no index, so the recording was cut off; repair it with: rosbag reindex"));
  } catch (const std::exception& error) {  // rosbag's, and out of memory or range from corrupt lengths
    throw InvalidInputError(Concat(path, ": is truncated, corrupt or not a bag: ", error.what()));
  }
}

}  // namespace acmp
