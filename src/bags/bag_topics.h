#pragma once

#include <string>
#include <vector>

#include <rosbag/bag.h>

#include "acmp_mapping/bags/bag_check.h"

namespace acmp {

constexpr char kTfType[] = "tf2_msgs/TFMessage";

struct BagTopics {
  std::vector<BagTopic> all;
  TopicChoice chosen;

  std::string TypeOf(const std::string& name) const;  ///< empty: there is no such topic
};

/// "/camera/image" of "/camera/image/compressed".
std::string WithoutCompressed(const std::string& topic);

/// The camera_info beside an image's topic; empty: there is none.
std::string CameraInfoBeside(const std::vector<BagTopic>& topics, const std::string& image);

/// Types that the mapper takes, in order of preference.
const std::vector<std::string>& ImageTypes();
const std::vector<std::string>& CameraInfoTypes();
const std::vector<std::string>& PoseTypes();
const std::vector<std::string>& CloudTypes();

/// Throws InvalidInputError when a wanted topic is not in the bag, or of a type that the mapper cannot use there.
BagTopics ChooseTopics(const rosbag::Bag& bag, const TopicChoice& wanted);

}  // namespace acmp
