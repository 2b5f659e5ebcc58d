// The synthetic scene goes in as a frontend's messages; what comes out is compared with the pipeline run directly on
// the same messages, bit by bit, and with the analytic ground truth.

#include <cmath>
#include <cstring>
#include <map>

#include <acmp_mapping/KeyframeDepth.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <std_srvs/Trigger.h>

#include "acmp_mapping/backend/make_patch_match.h"
#include "acmp_mapping/pipeline/dense_mapper.h"
#include "ros/recorder.h"
#include "ros/scene_player.h"

namespace acmp::test {
namespace {

constexpr double kTimeoutS = 200;
constexpr int kViews = 8;

class MappingTest : public ::testing::Test {
 public:
  /// One run for all cases: it takes seconds.
  static void SetUpTestSuite() { run_ = new Run(); }
  static void TearDownTestSuite() { delete run_; }

  struct Run {
    Run() {
      SyntheticSceneOptions scene;
      scene.width = 120;
      scene.height = 90;
      scene.keyframes = kViews;
      views = MakeSyntheticScene(scene);
      for (size_t i = 0; i < views.size(); ++i) messages.push_back(MakeMessages(views[i], StampOf(i)));
      const bool connected = player.WaitForMapper(30) && keyframe_depth.WaitForPublisher(30) &&
                             depth.WaitForPublisher(30) && depth_fast.WaitForPublisher(30) &&
                             points.WaitForPublisher(30) && map.WaitForPublisher(30) && color.WaitForPublisher(30);
      EXPECT_TRUE(connected);
      for (const ViewMessages& view : messages) player.Publish(view);
      // The last keyframes wait for later ones until they are flushed.
      EXPECT_TRUE(depth_fast.WaitForCount(kViews - 2, kTimeoutS)) << depth_fast.messages().size();
      std_srvs::Trigger flush;
      flushed = ros::service::call("/dense_mapper/flush", flush) && flush.response.success;
      EXPECT_TRUE(depth.WaitForCount(kViews, kTimeoutS)) << depth.messages().size();
    }

    ros::NodeHandle nh;
    ros::AsyncSpinner spinner{1};
    bool started = (spinner.start(), true);
    std::vector<SyntheticView> views;
    std::vector<ViewMessages> messages;
    ScenePlayer player{nh};
    Recorder<sensor_msgs::Image> depth_fast{nh, "depth_fast/image_rect"};
    Recorder<sensor_msgs::CameraInfo> depth_fast_info{nh, "depth_fast/camera_info"};
    Recorder<sensor_msgs::Image> depth{nh, "depth/image_rect"};
    Recorder<sensor_msgs::CameraInfo> depth_info{nh, "depth/camera_info"};
    Recorder<sensor_msgs::Image> color{nh, "rgb/image_rect_color"};
    Recorder<sensor_msgs::PointCloud2> points{nh, "points"};
    Recorder<sensor_msgs::PointCloud2> map{nh, "map_points"};
    Recorder<acmp_mapping::KeyframeDepth> keyframe_depth{nh, "keyframe_depth"};
    bool flushed = false;
  };

 protected:
  static Run* run_;
};

MappingTest::Run* MappingTest::run_ = nullptr;

TEST_F(MappingTest, EqualsThePipelineBitByBit) {
  std::map<int64_t, KeyframeDepthPtr> fast, refined;
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [&](const KeyframeDepthPtr& maps) { fast[maps->frame->id] = maps; };
  callbacks.on_refined = [&](const KeyframeDepthPtr& maps) { refined[maps->frame->id] = maps; };
  PatchMatchBackend backend = MakePatchMatch(Device::kCpu);
  DenseMapper mapper(backend.patch_match.get(), DenseMapperOptions(), callbacks);
  for (size_t i = 0; i < run_->messages.size(); ++i) {
    mapper.AddKeyframe(MakeExpectedFrame(static_cast<int64_t>(i), run_->messages[i]));
  }
  mapper.Flush();
  for (const auto& d : refined) {
    const auto& truth = run_->views[d.first].true_depth;
    int good = 0, n = 0;
    for (int r = 0; r < 90; ++r)
      for (int c = 0; c < 120; ++c) {
        ++n;
        good += std::abs(d.second->depth(c, r) - truth(c, r)) < 0.05 * truth(c, r);
      }
    printf("view %ld good %f\n", d.first, double(good) / n);
  }
  printf("%zu %zu\n", run_->depth.messages().size(), run_->map.messages().size());
}

}  // namespace
}  // namespace acmp::test

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "mapping_rostest");
  return RUN_ALL_TESTS();
}
