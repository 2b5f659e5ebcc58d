// A fisheye of 190 degrees: each image becomes five pinhole images, which are published and mapped as one capture.

#include <unistd.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>

#include <acmp_mapping/LoadSession.h>
#include <acmp_mapping/SaveSession.h>
#include <gtest/gtest.h>
#include <nav_msgs/Path.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::wide_rostest {

constexpr size_t kViews = 7, kMapped = 6;  ///< captures that the map keeps: as few as tell the scale of a path
constexpr int kFaces = 5;
constexpr int kSide = 96;

std::vector<SyntheticView> MakeWideViews() {
  SyntheticSceneOptions options = {kSide, kSide, static_cast<int>(kViews)};
  options.field_of_view = 190;
  return MakeSyntheticScene(options);
}

ViewMessages MakeWideMessages(const SyntheticView& view, const ros::Time& stamp) {
  ViewMessages messages = MakeMessages(view, stamp);
  const SyntheticWideImage& wide = *view.wide;
  messages.image = *ToColorMessage(wide.color, messages.image.header);
  messages.camera_info = *ToCameraInfo(wide.lens.camera(), messages.image.header);
  messages.camera_info.distortion_model = "equidistant";
  messages.camera_info.D = wide.lens.distortion().coefficients;
  std::vector<Eigen::Vector3f> points;
  for (const Eigen::Vector3d& landmark : wide.landmarks_in_world) points.push_back(landmark.cast<float>());
  messages.sparse_points = MakeCloud(points, kWorldFrame, stamp);
  return messages;
}

class WideSession : public MapperControl {
 public:
  WideSession()
      : MapperControl({{"field_of_view", 190.0}, {"min_confidence", 0.5}},
                      Parameters{{"max_keyframes", static_cast<int>(kMapped)},
                                 {"map_publish_rate", 0.0},
                                 {"save_folder", std::filesystem::temp_directory_path().string()}}) {}
  const std::vector<SyntheticView> views = MakeWideViews();
  Recorder<sensor_msgs::Image> left{nh, "face_left/depth/image_rect"};
  Recorder<sensor_msgs::CameraInfo> left_info{nh, "face_left/depth/camera_info"};
  Recorder<sensor_msgs::Image> back{nh, "face_back/depth/image_rect"};
  Recorder<sensor_msgs::PointCloud2> points{nh, "points"};
  tf2_ros::Buffer tf;
  tf2_ros::TransformListener tf_listener{tf};
  Recorder<nav_msgs::Path> path{nh, "keyframe_path"};
  Recorder<sensor_msgs::PointCloud2> map{nh, "map_points"};
  ros::Publisher optimized_path = nh.advertise<nav_msgs::Path>("optimized_path", 1);
  const bool ready = WaitUntilReady() && points.WaitForPublisher() && WaitForMapServer() && path.WaitForPublisher() &&
                     map.WaitForPublisher() && WaitForSubscriber(optimized_path);

  bool WaitForPath(double scale) {
    return path.WaitForNewest([&](const nav_msgs::Path& newest) {
      bool is_it = newest.poses.size() == kMapped;
      for (size_t i = 0; is_it && i < kMapped; ++i) {
        const geometry_msgs::Point& p = newest.poses[i].pose.position;
        const RigidTransform true_pose = views[i + kViews - kMapped].frame.cam_from_world.inverse();
        is_it = (Eigen::Vector3d(p.x, p.y, p.z) - scale * true_pose.translation()).norm() < 1e-6;
      }
      return is_it;
    });
  }

  /// Of the map, made smaller by `scale`: share of its points on the room's surfaces, percent; none without points.
  std::optional<double> Accuracy(double scale) {
    std::string published;
    EXPECT_TRUE(CallMap("publish_map", &published));
    if (!map.WaitForNewest([&](const auto& m) { return published == Concat("published ", m.width, " points"); }))
      return {};
    PointCloud cloud = ToPointCloud(*map.messages().back());
    if (cloud.empty()) return {};
    for (SurfacePoint& point : cloud) point.position = static_cast<float>(1 / scale) * point.position;
    // 29 px per rad: half a pixel of disparity at 2 m and a baseline of 0.6 m is 12 cm.
    return EvaluateCloud(cloud, SampleSyntheticSurface(views, 0.03f), {0.12}, 0.05).front().accuracy;
  }
};

using WideTest = SessionTest<WideSession>;

TEST_F(WideTest, EachFaceIsAKeyframeOfItsOwn) {
  WideSession& mapper = session();
  ASSERT_TRUE(mapper.ready);
  std::vector<ViewMessages> messages;
  for (size_t i = 0; i < kViews; ++i) messages.push_back(MakeWideMessages(mapper.views[i], StampOf(i)));
  ASSERT_EQ(mapper.Map(messages), kViews);
  EXPECT_TRUE(mapper.WaitForDiagnostic({Concat(kViews, " received = ", kViews, " refined")}));
  EXPECT_EQ(mapper.depth.messages().size(), kViews) << "the face ahead alone";
  EXPECT_EQ(mapper.keyframe_pose.messages().size(), kViews);
  EXPECT_TRUE(mapper.back.messages().empty());

  // The first keyframe's face had no topic yet to which one could connect.
  ASSERT_TRUE(mapper.left.WaitForCount(1));
  ASSERT_TRUE(mapper.left_info.WaitForCount(1));
  const sensor_msgs::Image left = *mapper.left.messages().back();
  EXPECT_EQ(left.header.frame_id, Concat(kCameraFrame, "_left"));
  const PinholeCamera face = ToCalibration(*mapper.left_info.messages().back(), true).camera;
  ASSERT_EQ(static_cast<int>(left.width), face.width);
  const RigidTransform camera_from_face = RigidTransform(tf2::transformToEigen(
      mapper.tf.lookupTransform(kCameraFrame, left.header.frame_id, ros::Time(0), ros::Duration(kTimeoutS))));
  EXPECT_TRUE((camera_from_face * Eigen::Vector3d(0, 0, 1)).isApprox(Eigen::Vector3d(-1, 0, 0)));
  const Lens& lens = mapper.views.front().wide->lens;
  const auto* depths = reinterpret_cast<const float*>(left.data.data());
  int outside = 0;
  for (int row = 0; row < face.height; ++row) {
    for (int col = 0; col < face.width; ++col) {
      const Eigen::Vector3d ray =
          camera_from_face * face.Unproject({static_cast<double>(col), static_cast<double>(row)});
      if (lens.Project(ray)) continue;
      ++outside;
      EXPECT_TRUE(std::isnan(depths[row * face.width + col])) << col << ' ' << row << " is outside of the circle";
    }
  }
  EXPECT_GT(outside, 0);

  // Points of all faces, in the camera's frame, lie on the room's surfaces.
  ASSERT_TRUE(mapper.points.WaitForCount(kViews * kFaces));
  std::map<ros::Time, int> clouds;
  PointCloud in_world;
  std::array<int, 3> aside = {0, 0, 0};  // to the left, to the right, above
  for (const auto& cloud : mapper.points.messages()) {
    EXPECT_EQ(cloud->header.frame_id, kCameraFrame);
    ++clouds[cloud->header.stamp];
    size_t view = 0;
    while (view < kViews && StampOf(view) != cloud->header.stamp) ++view;
    ASSERT_LT(view, kViews);
    const RigidTransform world_from_cam = mapper.views[view].frame.cam_from_world.inverse();
    for (SurfacePoint point : ToPointCloud(*cloud)) {
      const Eigen::Vector3d in_camera(point.position.x, point.position.y, point.position.z);
      aside[0] += in_camera.x() < -1.2 * std::abs(in_camera.z()) ? 1 : 0;
      aside[1] += in_camera.x() > 1.2 * std::abs(in_camera.z()) ? 1 : 0;
      aside[2] += in_camera.y() < -1.2 * std::abs(in_camera.z()) ? 1 : 0;
      const Eigen::Vector3f at = (world_from_cam * in_camera).cast<float>();
      point.position = {at.x(), at.y(), at.z()};
      in_world.push_back(point);
    }
  }
  ASSERT_EQ(clouds.size(), kViews);
  for (const auto& [stamp, count] : clouds) EXPECT_EQ(count, kFaces) << stamp;
  for (const int count : aside) EXPECT_GT(count, 20);
  // 29 px per rad: half a pixel of disparity at 2 m and a baseline of 0.6 m is 12 cm.
  const PointCloud truth = SampleSyntheticSurface(mapper.views, 0.03f);
  EXPECT_GT(EvaluateCloud(in_world, truth, {0.12}, 0.05).front().accuracy, 80);
}

/// Limits, path, loop closures with their scale, and sessions are of captures, in which the faces keep their places.
TEST_F(WideTest, TheMapIsMadeOfCaptures) {
  WideSession& mapper = session();
  ASSERT_TRUE(mapper.ready);
  EXPECT_TRUE(mapper.WaitForPath(1)) << "the first one made room";
  const std::optional<double> accuracy = mapper.Accuracy(1);
  ASSERT_TRUE(accuracy);
  EXPECT_GT(*accuracy, 60) << "one point per voxel: the many of near surfaces count as few";

  constexpr double kScale = 1.2;
  nav_msgs::Path closure;
  for (size_t i = 0; i < kViews; ++i) {
    RigidTransform pose = mapper.views[i].frame.cam_from_world.inverse();
    pose.translation() *= kScale;
    closure.poses.emplace_back();
    closure.poses.back().header.stamp = StampOf(i);
    closure.poses.back().pose = tf2::toMsg(pose);
  }
  mapper.optimized_path.publish(closure);
  EXPECT_TRUE(mapper.WaitForPath(kScale));
  EXPECT_TRUE(mapper.WaitForDiagnostic({"scales of keyframes by optimized paths", "1 to 1.2"}));
  const std::optional<double> closed = mapper.Accuracy(kScale);
  ASSERT_TRUE(closed);
  EXPECT_NEAR(*closed, *accuracy, 0.5) << "points of all faces grow with the path; voxels do not";

  acmp_mapping::SaveSession save;
  save.request.path = (std::filesystem::temp_directory_path() / Concat("wide_", ::getpid(), ".bag")).string();
  ASSERT_TRUE(CallService("/map_server/save_session", &save) && save.response.success) << save.response.message;
  EXPECT_EQ(save.response.keyframes, kMapped * kFaces);
  ASSERT_TRUE(mapper.CallMap("reset"));
  acmp_mapping::LoadSession load;
  load.request.path = save.request.path;
  ASSERT_TRUE(CallService("/map_server/load_session", &load) && load.response.success) << load.response.message;
  std::filesystem::remove(save.request.path);
  EXPECT_TRUE(mapper.WaitForPath(kScale));
  const std::optional<double> loaded = mapper.Accuracy(kScale);
  ASSERT_TRUE(loaded);
  EXPECT_NEAR(*loaded, *closed, 0.5);
}

TEST_F(WideTest, ACameraThatCannotBeIsRefused) {
  WideSession& mapper = session();
  ViewMessages messages = MakeWideMessages(mapper.views.front(), StampOf(0, 2000));
  messages.camera_info.D = {-0.2, 0, 0, 0};  // up to 74 degrees
  mapper.player.Publish(messages);
  EXPECT_TRUE(mapper.WaitForLog({"rays go outwards in the image up to 74.", "95 degrees (field_of_view)"}));
}

}  // namespace acmp::test::wide_rostest
