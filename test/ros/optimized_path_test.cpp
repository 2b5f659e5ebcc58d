#include "acmp_mapping/ros/optimized_path.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

geometry_msgs::PoseStamped MakePose(double stamp_s, double x, const std::string& frame = "world") {
  geometry_msgs::PoseStamped pose;
  pose.header.stamp = ros::Time(stamp_s);
  pose.header.frame_id = frame;
  pose.pose.position.x = x;
  pose.pose.orientation.w = 1;
  return pose;
}

struct Conversion {
  std::vector<Incident> drops;
  OptimizedPath path;
  Conversion(const nav_msgs::Path& message, const std::string& world_frame)
      : path(ToOptimizedPath(message, world_frame, [this](const Incident& bad) { drops.push_back(bad); })) {}
};

TEST(OptimizedPath, WarnsOfAnotherFrame) {
  nav_msgs::Path message;
  message.header.frame_id = "/map";
  message.poses = {MakePose(1, 1, "/world"), MakePose(2, 2, ""), MakePose(3, 3, "map")};
  const Conversion conversion(message, "world");
  EXPECT_EQ(conversion.path.poses.size(), 3u) << "used all the same";
  EXPECT_EQ(conversion.path.in_other_frame, 2u)
      << "a slash makes no difference; a nameless pose is in the path's frame";
  EXPECT_EQ(conversion.path.other_frame, "map");
  const Incident doubt = DescribeDoubt(conversion.path, ReposeResult(), "world");
  EXPECT_EQ(doubt.reason, "optimized_path_frame");
  EXPECT_THAT(doubt.message, AllOf(HasSubstr("2 of 3"), HasSubstr("\"map\""), HasSubstr("\"world\"")));
  EXPECT_EQ(Conversion(message, "").path.in_other_frame, 0u) << "nothing to compare with";
}

TEST(OptimizedPath, WarnsWhenNoStampFits) {
  OptimizedPath path;
  path.poses.resize(4);
  ReposeResult result;
  EXPECT_TRUE(DescribeDoubt(path, result, "world").message.empty()) << "there are no keyframes yet";
  result.nearest = ReposeResult::Gap{33400000, 1000000};
  EXPECT_THAT(DescribeDoubt(path, result, "world").message,
              AllOf(HasSubstr("none of the 4"), HasSubstr("within 1 ms"), HasSubstr("33.4 ms away")));
  result.named = 1;
  EXPECT_TRUE(DescribeDoubt(path, result, "world").message.empty());
}

TEST(OptimizedPath, NamesWhatIsTooFarAway) {
  ReposeResult result;
  EXPECT_TRUE(DescribeTooFar(result).message.empty());
  result.nearest = ReposeResult::Gap{0, 1000000};
  result.too_far = 2;
  result.first_too_far = ReposeResult::TooFar{1500000000, {1e12, 0, -3}, {{0, 5, 0}, 1e8}};
  const Incident too_far = DescribeTooFar(result);
  EXPECT_EQ(too_far.reason, "optimized_path_too_far");
  EXPECT_THAT(too_far.message,
              AllOf(HasSubstr("keyframes not moved by optimized_path: 2;"),
                    HasSubstr("pose 1.500000000 to (1e+12, 0, -3)"), HasSubstr("within 1e+08 of (0, 5, 0)")));
  EXPECT_TRUE(DescribeDoubt(OptimizedPath(), result, "world").message.empty()) << "the stamps fit";
}

}  // namespace
}  // namespace acmp
