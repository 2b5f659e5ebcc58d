// The synthetic scene goes in as a frontend's messages; what comes out is compared with the pipeline run directly on
// the same messages, bit by bit, and with the analytic ground truth.

#include <algorithm>
#include <cmath>
#include <map>

#include <acmp_mapping/KeyframeDepth.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>

#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::mapping_rostest {

constexpr int kWidth = 120, kHeight = 90;
constexpr size_t kViews = 8;

std::vector<SyntheticView> MakeViews() { return MakeSyntheticScene({kWidth, kHeight, kViews}); }

/// One run of the mapper, shared by all cases since it takes seconds.
struct Session : MapperControl {
  const std::vector<SyntheticView> views = MakeViews();
  const std::vector<ViewMessages> messages = MakeSmallScene(kViews, 1000, kWidth);
  const PipelineMaps expected = MapWithoutRos(messages, "balanced");
  Recorder<sensor_msgs::Image> depth_fast{nh, "depth_fast/image_rect"};
  Recorder<sensor_msgs::CameraInfo> depth_fast_info{nh, "depth_fast/camera_info"};
  Recorder<sensor_msgs::CameraInfo> depth_info{nh, "depth/camera_info"};
  Recorder<sensor_msgs::Image> color{nh, "rgb/image_rect_color"};
  Recorder<sensor_msgs::CameraInfo> color_info{nh, "rgb/camera_info"};
  Recorder<sensor_msgs::Image> confidence{nh, "confidence/image"};
  Recorder<sensor_msgs::Image> normal{nh, "normal/image"};
  Recorder<sensor_msgs::Image> depth_picture{nh, "depth/image_vis"};
  Recorder<sensor_msgs::Image> normal_picture{nh, "normal/image_vis"};
  Recorder<sensor_msgs::PointCloud2> points{nh, "points"};
  Recorder<nav_msgs::Path> path{nh, "keyframe_path"};
  Recorder<acmp_mapping::KeyframeDepth> keyframe_depth{nh, "keyframe_depth"};
  bool complete = false;

  Session() : MapperControl({{"preset", std::string("balanced")}}, Parameters{}) {
    complete = WaitUntilReady() && WaitForMapServer() && All([](auto* output) { return output->WaitForPublisher(); }) &&
               path.WaitForPublisher();
    for (const ViewMessages& view : messages) player.Publish(view);
    complete = complete && depth_fast.WaitForCount(expected.fast_before_flush) && Call("flush") &&
               All([](auto* output) { return output->WaitForCount(kViews); }) &&
               path.WaitForNewest([](const auto& newest) { return newest.poses.size() == kViews; });
  }

  /// Calls function(recorder) for all outputs that have a message of each keyframe until it says false.
  template <class Function>
  bool All(const Function& function) {
    return function(&depth_fast) && function(&depth_fast_info) && function(&depth) && function(&depth_info) &&
           function(&color) && function(&color_info) && function(&confidence) && function(&normal) &&
           function(&depth_picture) && function(&normal_picture) && function(&points) && function(&keyframe_pose) &&
           function(&keyframe_depth);
  }
};

class MappingTest : public SessionTest<Session> {
 protected:
  void SetUp() override { ASSERT_TRUE(session().complete) << "the mapper did not answer in time"; }
};

/// Index of the view with this stamp.
size_t ViewOf(const ros::Time& stamp) {
  for (size_t i = 0; i < kViews; ++i) {
    if (StampOf(i) == stamp) return i;
  }
  ADD_FAILURE() << "unknown stamp " << stamp;
  return 0;
}

TEST_F(MappingTest, FastAndRefinedDepthEqualThePipelineBitByBit) {
  const auto expect_same = [](auto* images, const auto& expected, auto KeyframeDepth::*map) {
    ASSERT_EQ(expected.size(), kViews);
    ASSERT_EQ(images->messages().size(), kViews);
    for (const auto& message : images->messages()) {
      const auto id = static_cast<int64_t>(ViewOf(message->header.stamp));
      EXPECT_EQ(CountDifferent(*message, (*expected.at(id)).*map), 0) << "view " << id;
    }
  };
  expect_same(&session().depth_fast, session().expected.fast, &KeyframeDepth::depth);
  expect_same(&session().depth, session().expected.refined, &KeyframeDepth::depth);
  expect_same(&session().confidence, session().expected.refined, &KeyframeDepth::confidence);
}

TEST_F(MappingTest, ImagesAreStampedAndNamedAsTheirSource) {
  const struct {
    Recorder<sensor_msgs::Image>& images;
    const char* encoding;
    uint32_t pixel_bytes;
  } outputs[] = {{session().depth_fast, "32FC1", 4},   {session().depth, "32FC1", 4},
                 {session().color, "rgb8", 3},         {session().confidence, "32FC1", 4},
                 {session().normal, "32FC3", 12},      {session().depth_picture, "rgb8", 3},
                 {session().normal_picture, "rgb8", 3}};
  for (const auto& output : outputs) {
    std::map<size_t, int> seen;
    for (const auto& message : output.images.messages()) {
      ++seen[ViewOf(message->header.stamp)];
      EXPECT_EQ(message->header.frame_id, kCameraFrame);
      EXPECT_EQ(message->encoding, output.encoding);
      EXPECT_EQ(message->width, static_cast<uint32_t>(kWidth));
      EXPECT_EQ(message->height, static_cast<uint32_t>(kHeight));
      EXPECT_EQ(message->step, kWidth * output.pixel_bytes);
      EXPECT_EQ(message->data.size(), message->step * message->height);
    }
    EXPECT_EQ(seen.size(), kViews) << output.encoding << ": one message per keyframe";
  }
}

TEST_F(MappingTest, DepthPicturesAreDarkWhereDepthIsUnsure) {
  int unsure = 0, bright = 0;
  for (const auto& confidence : session().confidence.messages()) {
    const auto values = reinterpret_cast<const float*>(confidence->data.data());
    for (const auto& picture : session().depth_picture.messages()) {
      if (picture->header.stamp != confidence->header.stamp) continue;
      for (int i = 0; i < kWidth * kHeight; ++i) {
        const unsigned char* rgb = &picture->data[3 * i];
        const int lightest = *std::max_element(rgb, rgb + 3);
        unsure += values[i] < 0.1f;
        if (values[i] < 0.1f) {
          EXPECT_LE(lightest, 52) << "0.1 of what 0.5 shows as 255, rounded";
        }
        bright += lightest > 128;
      }
    }
  }
  EXPECT_GT(unsure, 0);
  EXPECT_GT(bright, 0);
}

TEST_F(MappingTest, CameraInfosBelongToTheirImages) {
  for (Recorder<sensor_msgs::CameraInfo>* infos :
       {&session().depth_fast_info, &session().depth_info, &session().color_info}) {
    ASSERT_EQ(infos->messages().size(), kViews);
    for (const auto& info : infos->messages()) {
      const PinholeCamera& camera = session().views[ViewOf(info->header.stamp)].frame.camera;
      EXPECT_EQ(info->header.frame_id, kCameraFrame);
      EXPECT_EQ(info->width, static_cast<uint32_t>(camera.width));
      EXPECT_EQ(info->height, static_cast<uint32_t>(camera.height));
      EXPECT_EQ(info->K[0], camera.fx);
      EXPECT_EQ(info->K[2], camera.cx);
      EXPECT_EQ(info->K[5], camera.cy);
      EXPECT_EQ(info->P[5], camera.fy);
      for (const double d : info->D) EXPECT_EQ(d, 0);
    }
  }
}

TEST_F(MappingTest, ColourIsTheImageThatWasSent) {
  for (const auto& message : session().color.messages()) {
    EXPECT_EQ(message->data, session().messages[ViewOf(message->header.stamp)].image.data);
  }
}

TEST_F(MappingTest, PosesAndPathAreThoseThatWereSent) {
  for (const auto& message : session().keyframe_pose.messages()) {
    const geometry_msgs::Pose& sent = session().messages[ViewOf(message->header.stamp)].pose.pose;
    EXPECT_EQ(message->header.frame_id, kWorldFrame);
    // 1e-9: inverted and turned into a matrix and back in double
    EXPECT_TRUE(ToTransform(message->pose).isApprox(ToTransform(sent), 1e-9));
  }
  EXPECT_EQ(session().path.messages().back()->poses.size(), kViews);
  EXPECT_EQ(session().path.messages().back()->header.frame_id, kWorldFrame);
}

TEST_F(MappingTest, PointsLieOnTheSurfacesOfTheirView) {
  size_t points = 0, good = 0;
  for (const auto& message : session().points.messages()) {
    EXPECT_EQ(message->header.frame_id, kCameraFrame);
    const SyntheticView& view = session().views[ViewOf(message->header.stamp)];
    for (const SurfacePoint& point : ToPointCloud(*message)) {
      const Eigen::Vector3d at(point.position.x, point.position.y, point.position.z);
      // The mean of a pixel and those that agree with it, which may lie so far off: at a border outside the image.
      const Eigen::Vector2d projected = view.frame.camera.Project(at);
      const Eigen::Vector2d pixel = projected.cwiseMax(0).cwiseMin(Eigen::Vector2d(kWidth - 1, kHeight - 1));
      ASSERT_LE((projected - pixel).norm(), FusionOptions().max_reprojection_px);
      const double truth = view.true_depth(static_cast<int>(pixel.x() + 0.5), static_cast<int>(pixel.y() + 0.5));
      ++points;
      good += std::abs(at.z() - truth) < 0.05 * truth;
      const Eigen::Vector3d normal(point.normal.x, point.normal.y, point.normal.z);
      EXPECT_NEAR(normal.norm(), 1, 1e-3);
      EXPECT_LT(normal.dot(at), 0) << "normals face the camera";
    }
  }
  // Probably right (min_confidence), hence far better than all pixels are; see the message for the figures.
  EXPECT_GT(points, kViews * kWidth * kHeight / 10);
  EXPECT_GT(static_cast<double>(good), 0.8 * static_cast<double>(points)) << good << " of " << points;
}

TEST_F(MappingTest, KeyframeDepthHoldsEverythingAtOnce) {
  for (const auto& message : session().keyframe_depth.messages()) {
    const auto id = static_cast<int64_t>(ViewOf(message->header.stamp));
    const KeyframeDepth& expected = *session().expected.refined.at(id);
    EXPECT_EQ(message->header.frame_id, kWorldFrame);
    EXPECT_EQ(message->depth.header.frame_id, kCameraFrame);
    EXPECT_EQ(CountDifferent(message->depth, expected.depth), 0);
    EXPECT_EQ(CountDifferent(message->confidence, expected.confidence), 0);
    EXPECT_EQ(message->normal.encoding, "32FC3");
    EXPECT_EQ(message->camera_info.width, static_cast<uint32_t>(kWidth));
    EXPECT_EQ(message->depth_min, expected.range.min);
    EXPECT_EQ(message->depth_max, expected.range.max);
  }
}

TEST_F(MappingTest, DiagnosticsAreWell) {
  for (const auto& [key, value] : std::map<std::string, std::string>{{"device", "cpu"},
                                                                     {"keyframes", std::to_string(kViews)},
                                                                     {"refined depth maps", std::to_string(kViews)},
                                                                     {"matched size [px]", "120x90"}}) {
    EXPECT_TRUE(session().WaitForValue("dense_mapper: mapping", key, value)) << key;
  }
  EXPECT_GT(std::stoi(session().DiagnosticValue("dense_mapper: mapping", "refined again for the map")), 0);
  EXPECT_EQ(session().points.messages().size(), kViews) << "what is refined again is not published again";
}

}  // namespace acmp::test::mapping_rostest
