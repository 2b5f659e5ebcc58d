// Each kind of bad input must be named to the user, in the log and with a count in the diagnostics, and must not keep
// the mapper from working on what follows.

#include <cmath>
#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::bad_input_rostest {

constexpr size_t kViews = 5;

class BadInputSession : public MapperControl {
 public:
  BadInputSession() : MapperControl(Parameters{}) {}
  const std::vector<ViewMessages> scene = MakeSmallScene(kViews);
  const bool ready = WaitUntilReady();
};

using BadInputTest = RunsTest<BadInputSession>;

TEST_F(BadInputTest, IsNamedWithItsReasonAndTheMapperGoesOn) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const auto with_cloud = [](ViewMessages* view, const std::vector<Eigen::Vector3f>& points) {
    view->sparse_points = MakeCloud(points, kWorldFrame, view->image.header.stamp);
  };
  const struct {
    std::string reason;
    std::vector<std::string> parts;
    std::function<void(ViewMessages*)> change;
  } cases[] = {
      {"bad_image", {"holograms"}, [](auto* v) { v->image.encoding = "holograms"; }},
      {"bad_camera_info", {"/camera_info", "K[0] = 0"}, [](auto* v) { v->camera_info.K[0] = 0; }},
      {"bad_image", {"64x48", "65x48"}, [](auto* v) { v->camera_info.width = 65; }},
      {"bad_image", {"principal point at (1e+09"}, [](auto* v) { v->camera_info.K[2] = 1e9; }},
      {"bad_pose", {"/pose", "not finite"}, [](auto* v) { v->pose.pose.position.y = double{kNan}; }},
      {"sparse_empty",
       {"1 not finite", "2 exactly zero"},
       [&](auto* v) {
         with_cloud(v, {{kNan, 0, 1}, {0, 0, 0}, {0, 0, 0}});
       }},
      {"no_depth_range",
       {"50 sparse points", "set depth_min and depth_max"},
       [&](auto* v) {
         const Eigen::Vector3d behind = ToTransform(v->pose.pose) * Eigen::Vector3d(0, 0, -2);
         with_cloud(v, std::vector<Eigen::Vector3f>(50, behind.cast<float>()));
       }},
      {"sparse_frame_unknown",
       {"odd_frame", "~sparse_frame"},
       [](auto* v) { v->sparse_points.header.frame_id = "odd_frame"; }},
      {"bad_sparse_points", {"/sparse_points", "no field \"x\""}, [](auto* v) { v->sparse_points.fields.clear(); }}};
  for (const auto& bad : cases) {
    ASSERT_TRUE(mapper().Call("reset"));
    start_s_ += 100;
    for (const uint32_t before_s : {10, 9}) {  // what fails must leave nothing half made for the next
      ViewMessages view = mapper().scene[0];
      SetStamp(ros::Time(start_s_ - before_s, 0), &view);
      bad.change(&view);
      mapper().player.Publish(view);
    }
    std::vector<std::string> parts = bad.parts;
    parts.push_back("dropped: " + bad.reason);
    EXPECT_TRUE(mapper().WaitForDiagnostic(parts)) << bad.reason << ": " << bad.parts[0];
  }
  EXPECT_TRUE(mapper().WaitForLog({"bad_image", "holograms"}));
  ASSERT_TRUE(mapper().Call("reset"));
  EXPECT_EQ(mapper().Map(OfThisRun(mapper().scene)), kViews) << "the mapper must go on after bad input";
}

TEST_F(BadInputTest, TimeJumpsBack) {
  for (int run = 0; run < 2; ++run) {  // the same stamps, as a looping bag has them
    EXPECT_EQ(mapper().Map(OfThisRun(mapper().scene)), kViews);
  }
  EXPECT_TRUE(mapper().WaitForLog({"time jumped back"}));
}

// The last one: images go on to wait for prior depth once some has come.
TEST_F(BadInputTest, PriorDepthThatIsOfNoUseIsNamedAndItsImagesAreMapped) {
  const std::vector<ViewMessages> views = OfThisRun(mapper().scene);
  std::vector<sensor_msgs::Image> depths;
  for (const ViewMessages& view : views) {  // one depth everywhere, at half of the images' size
    const float depth = depths.size() == 2 ? NAN : 2;
    depths.push_back(*ToFloatMessage(DepthMap(32, 24, depth), view.image.header));
  }
  depths[1].encoding = "mono8";
  depths[3].header.stamp += ros::Duration(0.01);
  ros::Publisher publisher = mapper().nh.advertise<sensor_msgs::Image>("prior_depth", 100);
  ASSERT_TRUE(WaitForSubscriber(publisher));
  for (const sensor_msgs::Image& depth : depths) publisher.publish(depth);
  ASSERT_TRUE(mapper().WaitForDiagnostic({"/prior_depth", Concat(kViews, " received")}));

  EXPECT_EQ(mapper().Map(views), kViews);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_prior_depth", "2 ("})) << "of views 1 and 2";
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: no_prior_depth", "goes without"})) << "of view 3, or 1";
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: unused_prior_depth", "it explains"}));
}

}  // namespace acmp::test::bad_input_rostest
