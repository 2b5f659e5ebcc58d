#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <boost/make_shared.hpp>

#include "acmp_mapping/ros/keyframe_intake.h"

/// Inputs of a KeyframeIntake by whole seconds, and its events sorted by kind.
namespace acmp::test {

inline sensor_msgs::CameraInfo MakeInfo(const std::string& frame_id = "cam") {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = frame_id;
  info.width = 64;
  info.height = 48;
  info.K = {50, 0, 32, 0, 50, 24, 0, 0, 1};
  return info;
}

inline std::shared_ptr<const EncodedImage> ImageAt(uint32_t stamp_s, const std::string& frame_id = "cam") {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp = ros::Time(stamp_s, 0);
  image->header.frame_id = frame_id;
  return std::make_shared<const EncodedImage>(EncodedImage{image, nullptr});
}

inline PoseSample PoseAt(uint32_t stamp_s, double x, const std::string& world_frame = "map") {
  PoseSample pose;
  pose.stamp_ns = ToStampNs(ros::Time(stamp_s, 0));
  pose.world_frame = world_frame;
  pose.received.translation().x() = x;
  return pose;
}

inline SparseCloudPtr CloudAt(uint32_t stamp_s, const std::string& frame_id, std::vector<Eigen::Vector3d> points) {
  auto cloud = std::make_shared<SparseCloud>();
  cloud->stamp_ns = ToStampNs(ros::Time(stamp_s, 0));
  cloud->frame_id = frame_id;
  cloud->points = std::move(points);
  return cloud;
}

struct Result {
  std::vector<KeyframeInput> keyframes;
  std::vector<RejectedInput> drops;
  std::vector<std::string> new_worlds;
  int jumps = 0;
};

inline Result Split(std::vector<IntakeEvent> events) {
  Result result;
  for (IntakeEvent& event : events) {
    if (auto* keyframe = std::get_if<KeyframeInput>(&event)) result.keyframes.push_back(std::move(*keyframe));
    if (auto* drop = std::get_if<RejectedInput>(&event)) result.drops.push_back(*drop);
    if (auto* world = std::get_if<NewWorld>(&event)) result.new_worlds.push_back(world->text);
    result.jumps += std::holds_alternative<TimeJump>(event);
  }
  return result;
}

/// Feeds one image with pose and cloud and returns what comes out.
inline Result Feed(KeyframeIntake* intake, uint32_t stamp_s, double x, const SparseCloudPtr& cloud,
                   const std::string& image_frame = "cam", const std::string& world_frame = "map") {
  if (cloud) intake->AddCloud(cloud);
  intake->AddPose(PoseAt(stamp_s, x, world_frame));
  intake->AddImage(ImageAt(stamp_s, image_frame));
  return Split(intake->TakeAll());
}

inline KeyframeIntake MakeIntake(const NodeOptions& options = {}, double fallback_depth = 0) {
  KeyframeIntake intake(options, KeyframeGateOptions(), fallback_depth);
  intake.AddCameraInfo(MakeInfo());
  return intake;
}

}  // namespace acmp::test
