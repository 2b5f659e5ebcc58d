#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <rosbag/bag.h>

#include "acmp_mapping/bags/bag_check.h"
#include "acmp_mapping/intake/reading_check.h"
#include "acmp_mapping/intake/rig_check.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/ros/input_sources.h"

namespace acmp {

constexpr char kTfType[] = "tf2_msgs/TFMessage";

struct BagTopics {
  std::vector<BagTopic> all;
  TopicChoice chosen;

  BagTopic Find(const std::string& name) const;  ///< without type and messages where there is no such topic
};

/// The camera_info beside an image's topic; empty: there is none.
std::string CameraInfoBeside(const std::vector<BagTopic>& topics, const std::string& image);

/// Types that the mapper takes, in order of preference.
const std::vector<std::string>& ImageTypes();
const std::vector<std::string>& CameraInfoTypes();
const std::vector<std::string>& PoseTypes();
const std::vector<std::string>& CloudTypes();

/// Throws InvalidInputError when a wanted topic is not in the bag, or of a type that the mapper cannot use there.
BagTopics ChooseTopics(const rosbag::Bag& bag, const TopicChoice& wanted);

/// What the mapper makes of the messages of one topic.
struct Stream {
  std::vector<int64_t> stamps_ns;  ///< of those that can be used
  size_t refused = 0;
  std::string refusal;  ///< why, of the first one
  std::string frame;    ///< of the last one

  size_t used() const { return stamps_ns.size(); }
  size_t size() const { return used() + refused; }
};

/// All that one run of a bag through the mapper's intake tells.
struct IntakeRun {
  Stream images, infos, poses, clouds, masks;
  std::vector<Stream> source_images;
  std::string encoding;  ///< of the last image
  std::set<std::pair<int, int>> sizes;
  std::optional<CameraCalibration> calibration;  ///< the last one
  bool names_a_model = true;                     ///< the calibration, of distortion
  size_t keyframes = 0, masked = 0, time_jumps = 0;
  std::map<std::string, size_t> with_source;      ///< keyframes that have an image of this topic
  std::string source_places;                      ///< where these are
  std::map<std::string, RigCheck> rigs;           ///< whether the images say the same, by topic
  std::unique_ptr<ReadingCheck> images_of_poses;  ///< some keyframes in a row, from several places of the recording
  PoseSemantics semantics;                        ///< with the T_body_cam in use, or known
  size_t posed = 0;                               ///< images that have got a pose, whatever became of them
  double path = 0;                                ///< length, unit of the poses
  std::string child_frame;                        ///< of the last pose
  std::optional<DepthRange> range;                ///< of the landmarks of all keyframes
  std::vector<std::string> warnings, convention_warnings;
  struct Rejection {
    size_t count = 0;
    std::string first;
  };
  std::map<std::string, Rejection> rejections;  ///< by reason
  std::optional<double> share_in_front;
};

/// Feeds a bag to the mapper's intake, in the order in which it was recorded. Messages that cannot be used are counted.
IntakeRun FeedBag(const rosbag::Bag& bag, const BagTopics& topics, const NodeOptions& options,
                  const TransformSource& transforms);

}  // namespace acmp
