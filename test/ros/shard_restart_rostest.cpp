// One of two mappers that share the keyframes is killed: the other goes on, and when the first starts again, the two
// find back to one count of the keyframes.

#include <csignal>

#include <acmp_mapping/KeyframePoints.h>
#include <gtest/gtest.h>
#include <std_srvs/Trigger.h>
#include <sys/wait.h>
#include <unistd.h>

#include "acmp_mapping/common/error.h"
#include "ros/mapper_control.h"

namespace acmp::test {
namespace {

constexpr double kTimeoutS = 60;

/// A mapper process in the namespace /shard_INDEX, killed at the end.
class ShardProcess {
 public:
  explicit ShardProcess(int index) {
    const std::string name = Concat("/shard_", index, "/dense_mapper/");
    ros::param::set(name + "device", "cpu");
    ros::param::set(name + "overload", "block");
    ros::param::set(name + "sparse_wait", 10.0);
    ros::param::set(name + "shard_index", index);
    ros::param::set(name + "shard_count", 2);
    ros::param::set(name + "shard_timeout", 1.0);
    const std::string ns = Concat("__ns:=/shard_", index);
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::execl(ACMP_NODE_PATH, ACMP_NODE_PATH, "__name:=dense_mapper", ns.c_str(), "image:=/image",
            "camera_info:=/camera_info", "pose:=/pose", "sparse_points:=/sparse_points",
            "keyframe_estimates:=/keyframe_estimates", "keyframe_points:=/keyframe_points",
            static_cast<char*>(nullptr));
    ::_exit(127);
  }
  ~ShardProcess() {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }

 private:
  pid_t pid_ = -1;
};

bool HasValue(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key, const std::string& not_begin) {
  for (const auto& value : status.values) {
    if (value.key == key && value.value.rfind(not_begin, 0) != 0) return true;
  }
  return false;
}

class ShardRestartTest : public ::testing::Test {
 protected:
  ShardRestartTest() { spinner.start(); }

  /// Both have subscribed, and each hears the other.
  bool WaitForBoth() {
    diagnostics.Clear();
    const auto hears = [&](const std::string& name, const std::string& peer) {
      return diagnostics.WaitUntil(
          [&](const auto& arrays) {
            for (const auto& array : arrays) {
              for (const auto& status : array->status) {
                if (status.name == name && HasValue(status, peer, "0 messages")) return true;
              }
            }
            return false;
          },
          kTimeoutS);
    };
    return hears("shard_0/dense_mapper: shards", "shard 1") && hears("shard_1/dense_mapper: shards", "shard 0") &&
           player.WaitForMapper(kTimeoutS) && WaitForSubscribers(2);
  }

  bool WaitForSubscribers(uint32_t count) const {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(kTimeoutS);
    for (const ros::Publisher* input : {&player.image, &player.camera_info, &player.pose, &player.sparse_points}) {
      while (input->getNumSubscribers() != count) {
        if (ros::WallTime::now() > end) return false;
        ros::WallDuration(0.05).sleep();
      }
    }
    return true;
  }

  void PublishUpTo(size_t end) {
    for (; next < end; ++next) player.Publish(views[next]);
  }

  /// Waits until a shard has finished the keyframe of this view, with points.
  bool WaitForView(int shard, size_t view) {
    return points.WaitUntil(
        [&](const auto& messages) {
          for (const auto& message : messages) {
            if (message->shard_index == shard && message->header.stamp == StampOf(view) && message->dropped.empty()) {
              return true;
            }
          }
          return false;
        },
        kTimeoutS);
  }

  ros::NodeHandle nh;
  ros::AsyncSpinner spinner{1};
  const std::vector<ViewMessages> views = MakeSmallScene(60);
  size_t next = 0;
  ScenePlayer player{nh};
  Recorder<acmp_mapping::KeyframePoints> points{nh, "/keyframe_points"};
  Recorder<diagnostic_msgs::DiagnosticArray> diagnostics{nh, "/diagnostics"};
};

TEST_F(ShardRestartTest, TheOtherGoesOnAndBothFindBackToOneCount) {
  const ShardProcess shard_0(0);
  auto shard_1 = std::make_unique<ShardProcess>(1);
  ASSERT_TRUE(WaitForBoth());
  PublishUpTo(10);
  ASSERT_TRUE(WaitForView(0, 6));
  ASSERT_TRUE(WaitForView(1, 7));

  shard_1.reset();
  PublishUpTo(20);
  ASSERT_TRUE(WaitForView(0, 16)) << "it must not wait for ever";

  shard_1 = std::make_unique<ShardProcess>(1);
  ASSERT_TRUE(WaitForBoth());
  // It has begun to count at 0. View by view, so that the other's estimates can reach it.
  const auto agreed = [&] {
    for (const auto& message : points.messages()) {
      if (message->shard_index == 1 && message->number >= 20 && message->dropped.empty() &&
          message->header.stamp == StampOf(message->number)) {
        return true;
      }
    }
    return false;
  };
  while (next < 40 && !agreed()) {
    PublishUpTo(next + 1);
    ros::WallDuration(0.2).sleep();
  }
  EXPECT_TRUE(agreed());

  // The rest goes to both in turn.
  const size_t begin = next;
  PublishUpTo(begin + 20);  // as many as the queues hold
  for (const size_t view : {begin + 16, begin + 17}) ASSERT_TRUE(WaitForView(static_cast<int>(view % 2), view)) << view;
  for (const auto& message : points.messages()) {
    if (message->header.stamp < StampOf(begin)) continue;
    EXPECT_EQ(message->header.stamp, StampOf(message->number));
    EXPECT_EQ(message->number % 2, message->shard_index);
  }
}

}  // namespace
}  // namespace acmp::test

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "shard_restart_rostest");
  return RUN_ALL_TESTS();
}
