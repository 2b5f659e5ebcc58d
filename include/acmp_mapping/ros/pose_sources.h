#pragma once

#include <string>
#include <tuple>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <geometry_msgs/TransformStamped.h>
#include <nav_msgs/Odometry.h>

#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {

/// A way to send poses: its name is the value of ~pose_source and the topic's, relative to the node's namespace.
template <class Message>
struct PoseSource {
  using MessageType = Message;
  const char* name;
  PoseSample (*convert)(const Message& message);  ///< throws as ToPoseSample does
};

/// All but tf, the preferred ones first. From these rows parameter, subscription, advice, acmp_check_bag and the launch
/// file's arguments follow.
inline constexpr std::tuple kPoseSources = {
    PoseSource<geometry_msgs::PoseStamped>{
        "pose", [](const geometry_msgs::PoseStamped& m) { return ToPoseSample(m.header, "", m.pose); }},
    PoseSource<geometry_msgs::PoseWithCovarianceStamped>{
        "pose_cov",
        [](const geometry_msgs::PoseWithCovarianceStamped& m) { return ToPoseSample(m.header, "", m.pose.pose); }},
    PoseSource<nav_msgs::Odometry>{
        "odom", [](const nav_msgs::Odometry& m) { return ToPoseSample(m.header, m.child_frame_id, m.pose.pose); }},
    PoseSource<geometry_msgs::TransformStamped>{"transform", [](const geometry_msgs::TransformStamped& m) {
                                                  return ToPoseSample(m.header, m.child_frame_id, m.transform);
                                                }}};

constexpr char kTfPoses[] = "tf";  ///< value of ~pose_source: poses are looked up in tf

/// Calls use(source) for each row of kPoseSources.
template <class Use>
void ForEachPoseSource(const Use& use) {
  std::apply([&](const auto&... sources) { (use(sources), ...); }, kPoseSources);
}

struct PoseInput {
  std::string name, type;
};
/// The names of the rows and the types of their messages.
inline std::vector<PoseInput> PoseInputs() {
  std::vector<PoseInput> topics;
  ForEachPoseSource([&](const auto& source) {
    using Message = typename std::decay_t<decltype(source)>::MessageType;
    topics.push_back({source.name, ros::message_traits::DataType<Message>::value()});
  });
  return topics;
}

}  // namespace acmp
