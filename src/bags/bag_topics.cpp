#include "bag_feed.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <set>

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/image_encodings.h>
#include <boost/algorithm/string/predicate.hpp>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::vector<BagTopic> ReadTopics(const rosbag::Bag& bag) {
  std::map<std::string, std::string> types;
  for (const rosbag::ConnectionInfo* connection : rosbag::View(bag).getConnections()) {
    types[connection->topic] = connection->datatype;
  }
  std::vector<BagTopic> topics;
  for (const auto& [name, type] : types) {
    rosbag::View messages(bag, rosbag::TopicQuery(name));
    topics.push_back({name, type, messages.size(), (messages.getEndTime() - messages.getBeginTime()).toSec()});
  }
  return topics;
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

/// The wanted topic, or the first that is named as a mask.
std::string ChooseMaskTopic(const std::vector<BagTopic>& topics, const TopicChoice& wanted) {
  const std::vector<std::string> types = {ros::message_traits::DataType<sensor_msgs::Image>::value()};
  if (!wanted.mask.empty()) return ChooseTopic(topics, types, wanted.mask, "--mask");
  for (const BagTopic& topic : topics) {
    const bool is_named = boost::algorithm::ends_with(topic.name, "mask");
    if (is_named && topic.type == types.front() && topic.name != wanted.image) return topic.name;
  }
  return "";
}

template <class... Messages>
std::vector<std::string> TypesOf() {
  return {ros::message_traits::DataType<Messages>::value()...};
}

}  // namespace

BagTopic BagTopics::Find(const std::string& name) const {
  const auto found = std::find_if(all.begin(), all.end(), [&](const BagTopic& t) { return t.name == name; });
  return found == all.end() ? BagTopic() : *found;
}

std::string CameraInfoBeside(const std::vector<BagTopic>& topics, const std::string& image) {
  const std::string base = WithoutCompressed(image);
  const std::string beside = base.substr(0, base.rfind('/') + 1) + "camera_info";
  const bool found =
      std::any_of(topics.begin(), topics.end(), [&](const BagTopic& topic) { return topic.name == beside; });
  return found ? beside : "";
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

BagTopics ChooseTopics(const rosbag::Bag& bag, const TopicChoice& wanted) {
  BagTopics found;
  found.all = ReadTopics(bag);
  TopicChoice& chosen = found.chosen;
  chosen.mask = ChooseMaskTopic(found.all, wanted);
  const std::set<std::string> depth = DepthTopics(bag);
  std::vector<BagTopic> but_masks, pictures;
  std::copy_if(found.all.begin(), found.all.end(), std::back_inserter(but_masks),
               [&](const BagTopic& topic) { return topic.name != chosen.mask; });
  std::copy_if(but_masks.begin(), but_masks.end(), std::back_inserter(pictures),
               [&](const BagTopic& topic) { return depth.count(topic.name) == 0; });
  chosen.image = ChooseTopic(wanted.image.empty() ? pictures : but_masks, ImageTypes(), wanted.image, "--image");
  if (chosen.image.empty()) chosen.image = ChooseTopic(but_masks, ImageTypes(), "", "--image");
  const std::string beside = CameraInfoBeside(found.all, chosen.image);
  chosen.camera_info = ChooseTopic(found.all, CameraInfoTypes(),
                                   wanted.camera_info.empty() ? beside : wanted.camera_info, "--camera-info");
  for (const std::string& topic : wanted.source_images) {
    chosen.source_images.push_back(ChooseTopic(found.all, ImageTypes(), topic, "--source-image"));
    const size_t index = chosen.source_camera_infos.size();
    const bool given = index < wanted.source_camera_infos.size();
    const std::string info = given ? wanted.source_camera_infos[index] : CameraInfoBeside(found.all, topic);
    if (info.empty()) throw InvalidInputError(Concat("--source-image ", topic, ": give its --source-camera-info"));
    chosen.source_camera_infos.push_back(ChooseTopic(found.all, CameraInfoTypes(), info, "--source-camera-info"));
  }
  chosen.pose = ChooseTopic(found.all, PoseTypes(), wanted.pose, "--pose");
  if (found.Find(chosen.pose).type == kTfType) chosen.pose.clear();
  chosen.sparse_points = ChooseTopic(found.all, CloudTypes(), wanted.sparse_points, "--sparse-points");
  return found;
}

}  // namespace acmp
