// Each frontend's launch file, started as a user starts it and fed with what that frontend publishes (frontends.yaml),
// must give the depth maps that the pipeline makes of the same estimates as plain messages (mapping_rostest shows that
// those of the plain topics are the same bit by bit). One after the other, as they share names of topics.

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <map>
#include <set>
#include <tuple>

#include <geometry_msgs/PoseStamped.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <nav_msgs/Path.h>
#include <pcl/point_types.h>
#include <pcl_conversions/pcl_conversions.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/point_cloud_conversion.h>
#include <std_srvs/Trigger.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/intake/pose_semantics.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "ros/recorder.h"
#include "ros/scene_player.h"

namespace acmp::test::frontends_rostest {

constexpr int kWidth = 64, kHeight = 48;
constexpr size_t kKeyframes = 5;
constexpr char kPreset[] = "online";  // as frontend.launch has it: all steps, in less time

/// What one SLAM frontend publishes: an entry of frontends.yaml.
class Traits {
 public:
  explicit Traits(const std::string& name) {
    if (!ros::param::get("/frontends/" + name, values_))
      throw InvalidInputError("no frontend in frontends.yaml: " + name);
  }
  /// Empty where the entry does not say.
  std::string Text(const char* key) const {
    return values_.hasMember(key) ? static_cast<std::string>(values_[key]) : std::string();
  }
  bool Flag(const char* key) const { return values_.hasMember(key) && static_cast<bool>(values_[key]); }
  int Number(const char* key, int otherwise) const {
    return values_.hasMember(key) ? static_cast<int>(values_[key]) : otherwise;
  }
  std::vector<std::array<std::string, 3>> static_tf() const {
    std::vector<std::array<std::string, 3>> all;
    for (int i = 0; values_.hasMember("static_tf") && i < values_["static_tf"].size(); ++i) {
      all.emplace_back();
      for (int k = 0; k < 3; ++k) all.back()[k] = static_cast<std::string>(values_["static_tf"][i][k]);
    }
    return all;
  }

 private:
  mutable XmlRpc::XmlRpcValue values_;  // reading is not const
};

/// x right, y down, z forward -> x forward, y left, z up
Eigen::Matrix3d FluFromOptical() {
  Eigen::Matrix3d rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return rotation;
}

/// Of a static transform: imu, a frame in which the camera is turned about two axes and off the centre, in short
/// decimals, so that the launch file has the same numbers; base, where the camera link of a robot sits; flu, the axes
/// of that link.
RigidTransform StaticTransform(const std::string& what) {
  RigidTransform transform = RigidTransform::Identity();
  if (what == "imu") {
    transform.linear() << 0.6, -0.64, 0.48, 0.8, 0.48, -0.36, 0, 0.6, 0.8;
    transform.translation() << 0.07, -0.02, 0.05;
  } else if (what == "base") {
    transform.linear() << 0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1;
    transform.translation() << 0.25, -0.125, 0.5;
  } else {
    transform.linear() = FluFromOptical();
  }
  return transform;
}

/// Maps the optical frame to the one whose pose is published.
RigidTransform FrameFromCamera(const std::string& pose_of) {
  if (pose_of.empty() || pose_of == "camera") return RigidTransform::Identity();
  return pose_of == "base" ? StaticTransform("base") * StaticTransform("flu") : StaticTransform(pose_of);
}

constexpr int64_t kPoseIntervalNs = 5000000;  // of an IMU at 200 Hz

/// 20 Hz, a time of today: only there a double is too short for nanoseconds, and no whole microseconds.
ros::Time ImageStamp(size_t view) {
  ros::Time stamp(1403636579, 63555584);
  return stamp + ros::Duration(0, static_cast<int32_t>(view) * 50000000);
}

/// kKeyframes where no image has this stamp.
size_t ViewOf(const ros::Time& stamp) {
  size_t view = 0;
  while (view < kKeyframes && ImageStamp(view) != stamp) ++view;
  return view;
}

ros::Time Rounded(const ros::Time& stamp, const std::string& how) {
  if (how == "double") return ros::Time(stamp.toSec());
  return how == "microseconds" ? pcl_conversions::fromPCL(pcl_conversions::toPCL(stamp)) : stamp;
}

geometry_msgs::Pose RoundedToFloat(geometry_msgs::Pose pose) {
  for (double* value : {&pose.position.x, &pose.position.y, &pose.position.z, &pose.orientation.x, &pose.orientation.y,
                        &pose.orientation.z, &pose.orientation.w}) {
    const volatile float rounded = static_cast<float>(*value);  // volatile: gcc 12 may drop the rounding
    *value = static_cast<double>(rounded);
  }
  return pose;
}

geometry_msgs::TransformStamped ToTransformStamped(const ros::Time& stamp, const std::string& parent,
                                                   const std::string& child, const geometry_msgs::Pose& pose) {
  geometry_msgs::TransformStamped transform;
  transform.header.stamp = stamp;
  transform.header.frame_id = parent;
  transform.child_frame_id = child;
  transform.transform.translation.x = pose.position.x;
  transform.transform.translation.y = pose.position.y;
  transform.transform.translation.z = pose.position.z;
  transform.transform.rotation = pose.orientation;
  return transform;
}

template <class Point>
sensor_msgs::PointCloud2 ToPclMessage(const std::vector<Eigen::Vector3f>& points, const std_msgs::Header& header) {
  pcl::PointCloud<Point> cloud;
  for (const Eigen::Vector3f& point : points) {
    cloud.push_back(Point());
    cloud.back().getVector3fMap() = point;
  }
  sensor_msgs::PointCloud2 message;
  pcl::toROSMsg(cloud, message);
  message.header = header;
  return message;
}

sensor_msgs::PointCloud ToPointCloudV1(const std::vector<Eigen::Vector3f>& points, const std_msgs::Header& header) {
  sensor_msgs::PointCloud cloud;
  sensor_msgs::convertPointCloud2ToPointCloud(MakeCloud(points, header.frame_id, header.stamp), cloud);
  // Normalised x, y, pixel u, v, id: one channel per point, against the contract.
  for (const auto& point : cloud.points) {
    sensor_msgs::ChannelFloat32 channel;
    channel.values = {point.x, 0.2f, 30.f, 40.f, static_cast<float>(cloud.channels.size())};
    cloud.channels.push_back(channel);
  }
  return cloud;
}

/// Plays the synthetic scene as a frontend would publish it, on its topics.
class FrontendPlayer {
 public:
  FrontendPlayer(ros::NodeHandle nh, const Traits& traits)
      : traits_(traits), child_from_cam_(FrameFromCamera(traits.Text("pose_of"))) {
    if (traits.Flag("flu_world")) world_from_scene_ = FluFromOptical();
    Estimate();
    image_ = Advertise<sensor_msgs::Image>(&nh, "image");
    camera_info_ = Advertise<sensor_msgs::CameraInfo>(&nh, "camera_info");
    const std::string type = traits.Text("pose_type");
    pose_ = type == "tf"         ? Advertise<tf2_msgs::TFMessage>(&nh, "pose")
            : type == "Odometry" ? Advertise<nav_msgs::Odometry>(&nh, "pose")
                                 : Advertise<geometry_msgs::PoseStamped>(&nh, "pose");
    cloud_ = traits.Text("cloud_type") == "v1" ? Advertise<sensor_msgs::PointCloud>(&nh, "cloud")
                                               : Advertise<sensor_msgs::PointCloud2>(&nh, "cloud");
    extrinsic_ = Advertise<nav_msgs::Odometry>(&nh, "extrinsic");
    path_ = Advertise<nav_msgs::Path>(&nh, "path");
    if (!traits.static_tf().empty()) static_tf_ = nh.advertise<tf2_msgs::TFMessage>("/tf_static", 100, true);
  }

  /// The same estimates as the plainest frontend would publish them, of all views that get a pose: PoseStamped of the
  /// optical frame, PointCloud2 in the world, equal stamps.
  const std::vector<ViewMessages>& plain() const { return plain_; }

  /// Poses of the optical frame in the frontend's world, of the same views.
  const std::vector<RigidTransform>& world_from_cam() const { return world_from_cam_; }

  /// Waits until somebody has subscribed to everything; false with what is missing after kTimeoutS.
  bool WaitForMapper(std::string* missing) const {
    return WaitUntil([&] {
      missing->clear();
      for (const ros::Publisher& publisher : connected_) {
        if (publisher.getNumSubscribers() == 0) *missing += " " + publisher.getTopic();
      }
      return missing->empty();
    });
  }

  void Play() const {
    if (static_tf_) PublishStaticTransforms();
    for (size_t i = 0; i < images_.size(); ++i) {
      if (camera_info_) camera_info_.publish(images_[i].camera_info);
      image_.publish(images_[i].image);
      if (i < delay()) continue;
      const size_t posed = i - delay();
      if (extrinsic_) PublishExtrinsic(stamps_[i]);
      PublishPoses(posed);
      PublishCloud(posed);
    }
  }

  /// A loop closure: all poses again, in a world that has moved by `correction`. Needs a path.
  void PublishPath(const RigidTransform& correction) const {
    nav_msgs::Path path;
    for (size_t i = 0; i < world_from_cam_.size(); ++i) {
      geometry_msgs::PoseStamped pose;
      pose.header.stamp = Rounded(stamps_[i], traits_.Text("pose_stamp"));
      pose.header.frame_id = traits_.Text("path_frame");
      pose.pose = tf2::toMsg(correction * ToTransform(poses_[i]));
      path.poses.push_back(pose);
    }
    path.header = path.poses.back().header;
    path_.publish(path);
  }

 private:
  /// Where the frontend has such a topic.
  template <class Message>
  ros::Publisher Advertise(ros::NodeHandle* nh, const char* key) {
    const std::string topic = traits_.Text(key);
    if (topic.empty()) return {};
    connected_.push_back(nh->advertise<Message>(topic, 100));
    return connected_.back();
  }

  size_t delay() const { return static_cast<size_t>(traits_.Number("delay", 0)); }

  void Estimate() {
    const std::vector<SyntheticView> views =
        MakeSyntheticScene({kWidth, kHeight, static_cast<int>(kKeyframes + delay())});
    std::set<std::tuple<float, float, float>> seen;
    // Then the mapper gets the numbers of the camera's pose as they are, and nothing at all may differ.
    const bool same_numbers =
        child_from_cam_.isApprox(RigidTransform::Identity(), 0) && world_from_scene_.isIdentity(0);
    for (size_t i = 0; i < views.size(); ++i) {
      stamps_.push_back(ImageStamp(i));
      ViewMessages plain = MakeMessages(views[i], stamps_[i]);
      plain.image.header.frame_id = plain.camera_info.header.frame_id = traits_.Text("image_frame");
      if (traits_.Flag("float_poses")) plain.pose.pose = RoundedToFloat(plain.pose.pose);
      images_.push_back(plain);
      plain_.push_back(plain);

      observed_.emplace_back();
      for (const Eigen::Vector3d& landmark : views[i].frame.landmarks_in_world) {
        const Eigen::Vector3f point = landmark.cast<float>();
        observed_[i].push_back(point);
        if (seen.emplace(point.x(), point.y(), point.z()).second) map_.push_back(point);
      }

      const RigidTransform scene_from_cam = ToTransform(plain.pose.pose);
      RigidTransform world_from_scene = RigidTransform::Identity();
      world_from_scene.linear() = world_from_scene_;
      world_from_cam_.push_back(world_from_scene * scene_from_cam);
      poses_.push_back(same_numbers ? plain.pose.pose : tf2::toMsg(world_from_cam_[i] * child_from_cam_.inverse()));
    }
    const size_t posed = views.size() - delay();
    plain_.resize(posed);
    world_from_cam_.resize(posed);
    for (size_t i = 0; i < posed; ++i) {
      plain_[i].sparse_points = MakeCloud(traits_.Flag("whole_map") ? map_ : observed_[i], kWorldFrame, stamps_[i]);
    }
  }

  void PublishPoses(size_t view) const {
    PublishPose(Rounded(stamps_[view], traits_.Text("pose_stamp")), poses_[view]);
    // Those in between belong to no image; how good they are does not matter.
    for (int k = 1; k < traits_.Number("poses_per_image", 1) && view + 1 < poses_.size(); ++k) {
      PublishPose(stamps_[view] + ros::Duration(0, static_cast<int32_t>(k * kPoseIntervalNs)), poses_[view]);
    }
  }

  void PublishPose(const ros::Time& stamp, const geometry_msgs::Pose& pose) const {
    std_msgs::Header header;
    header.stamp = stamp;
    header.frame_id = traits_.Text("world");
    const std::string type = traits_.Text("pose_type"), child = traits_.Text("child");
    if (type == "tf") {
      tf2_msgs::TFMessage message;
      message.transforms.push_back(ToTransformStamped(stamp, header.frame_id, child, pose));
      pose_.publish(message);
    } else if (type == "Odometry") {
      nav_msgs::Odometry message;
      message.header = header;
      message.child_frame_id = child;
      message.pose.pose = pose;
      pose_.publish(message);
    } else {
      geometry_msgs::PoseStamped message;
      message.header = header;
      message.pose = pose;
      pose_.publish(message);
    }
  }

  std::vector<Eigen::Vector3f> PublishedPoints(size_t view) const {
    std::vector<Eigen::Vector3f> points;
    const Eigen::Matrix3f world_from_scene = world_from_scene_.cast<float>();
    for (const Eigen::Vector3f& point : traits_.Flag("whole_map") ? map_ : observed_[view]) {
      if (traits_.Flag("zero_points") && points.size() % 3 == 0) points.push_back(Eigen::Vector3f::Zero());
      points.push_back(world_from_scene * point);
    }
    return points;
  }

  void PublishCloud(size_t view) const {
    const std::vector<Eigen::Vector3f> points = PublishedPoints(view);
    std_msgs::Header header;
    header.stamp = Rounded(stamps_[view], traits_.Text("cloud_stamp"));
    header.frame_id = traits_.Text("cloud_frame");
    const std::string type = traits_.Text("cloud_type");
    if (type == "v1") {
      cloud_.publish(ToPointCloudV1(points, header));
    } else if (type == "pcl") {
      cloud_.publish(ToPclMessage<pcl::PointXYZ>(points, header));
    } else if (type == "pcl_rgb") {
      cloud_.publish(ToPclMessage<pcl::PointXYZRGB>(points, header));
    } else {
      cloud_.publish(MakeCloud(points, header.frame_id, header.stamp));
    }
  }

  void PublishExtrinsic(const ros::Time& stamp) const {
    nav_msgs::Odometry message;
    message.header.stamp = Rounded(stamp, traits_.Text("pose_stamp"));
    message.header.frame_id = traits_.Text("world");  // VINS: "world", which it is not
    message.pose.pose = tf2::toMsg(child_from_cam_);
    extrinsic_.publish(message);
  }

  void PublishStaticTransforms() const {
    tf2_msgs::TFMessage message;
    for (const auto& [parent, child, what] : traits_.static_tf()) {
      message.transforms.push_back(
          ToTransformStamped(stamps_.front(), parent, child, tf2::toMsg(StaticTransform(what))));
    }
    static_tf_.publish(message);
  }

  const Traits traits_;
  const RigidTransform child_from_cam_;
  /// Maps the axes of the synthetic scene to the frontend's world; no rounding: a permutation of axes.
  Eigen::Matrix3d world_from_scene_ = Eigen::Matrix3d::Identity();
  std::vector<ros::Time> stamps_;  ///< of the images
  std::vector<ViewMessages> images_;
  std::vector<ViewMessages> plain_;
  std::vector<RigidTransform> world_from_cam_;
  std::vector<geometry_msgs::Pose> poses_;              ///< as published
  std::vector<std::vector<Eigen::Vector3f>> observed_;  ///< points of each image, in the scene's world
  std::vector<Eigen::Vector3f> map_;                    ///< all of them, in the scene's world
  std::vector<ros::Publisher> connected_;               ///< those that the mapper has to subscribe to
  ros::Publisher image_, camera_info_, pose_, cloud_, extrinsic_, path_, static_tf_;
};

/// frontend.launch of an entry of frontends.yaml, as long as this lives.
class LaunchedFrontend {
 public:
  explicit LaunchedFrontend(const std::string& name) {
    const std::string launch = Traits(name).Text("launch");
    const std::string frontend = "frontend:=" + (launch.empty() ? name : launch), played_as = "played_as:=" + name;
    process_ = ::fork();
    if (process_ != 0) return;
    ::execlp("roslaunch", "roslaunch", ACMP_SOURCE_DIR "/test/ros/frontend.launch", frontend.c_str(), played_as.c_str(),
             static_cast<char*>(nullptr));
    ::_exit(127);
  }
  ~LaunchedFrontend() {
    ::kill(process_, SIGINT);
    ::waitpid(process_, nullptr, 0);
  }
  LaunchedFrontend(const LaunchedFrontend&) = delete;
  LaunchedFrontend& operator=(const LaunchedFrontend&) = delete;

 private:
  pid_t process_;
};

class FrontendTest : public ::testing::TestWithParam<const char*> {
 protected:
  void Run() {
    spinner_.start();
    std::string missing;
    ASSERT_TRUE(player_.WaitForMapper(&missing)) << "nobody subscribed to" << missing;
    ASSERT_TRUE(depth_.WaitForPublisher() && pose_.WaitForPublisher());
    player_.Play();
    // A flush before all have arrived would finish early ones with fewer views.
    ASSERT_TRUE(pose_.WaitForCount(kKeyframes)) << pose_.messages().size() << " keyframes";
    std_srvs::Trigger flush;
    ASSERT_TRUE(CallService("/acmp/dense_mapper/flush", &flush) && flush.response.success);
    ASSERT_TRUE(depth_.WaitForCount(kKeyframes)) << depth_.messages().size() << " depth maps";
  }

  void ExpectPose(const ros::Time& stamp, const geometry_msgs::Pose& pose, const RigidTransform& correction) const {
    const RigidTransform received = ToTransform(pose);
    const RigidTransform expected = correction * player_.world_from_cam().at(ViewOf(stamp));
    // Some products of rotations and a quaternion, all in double.
    EXPECT_LT((received.matrix() - expected.matrix()).cwiseAbs().maxCoeff(), 1e-12) << stamp;
  }

  void ExpectPathToMoveTheKeyframes() {
    RigidTransform correction(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()));
    correction.translation() << 1, 2, 3;
    Recorder<nav_msgs::Path> path(nh_, "/acmp/keyframe_path");
    player_.PublishPath(correction);
    const Eigen::Vector3d first = (correction * player_.world_from_cam().front()).translation();
    ASSERT_TRUE(path.WaitForNewest([&](const nav_msgs::Path& newest) {
      if (newest.poses.size() != kKeyframes) return false;
      const geometry_msgs::Point& p = newest.poses.front().pose.position;
      return (Eigen::Vector3d(p.x, p.y, p.z) - first).norm() < 0.01;
    })) << "the keyframes do not follow "
        << traits_.Text("path");
    for (const auto& pose : path.messages().back()->poses) ExpectPose(pose.header.stamp, pose.pose, correction);
  }

  const LaunchedFrontend launched_{GetParam()};
  ros::NodeHandle nh_;
  ros::AsyncSpinner spinner_{1};
  const Traits traits_{GetParam()};
  FrontendPlayer player_{nh_, traits_};
  Recorder<sensor_msgs::Image> depth_{nh_, "/acmp/depth/image_rect"};
  Recorder<geometry_msgs::PoseStamped> pose_{nh_, "/acmp/keyframe_pose"};
};

TEST_P(FrontendTest, MapsAreThoseOfThePlainMessages) {
  ASSERT_NO_FATAL_FAILURE(Run());
  const std::map<int64_t, KeyframeDepthPtr> expected = MapWithoutRos(player_.plain(), kPreset).refined;
  ASSERT_EQ(expected.size(), kKeyframes);
  std::string output_frame = traits_.Text("output_frame");
  if (output_frame.empty()) output_frame = traits_.Text("image_frame");
  for (const auto& message : depth_.messages()) {
    const auto view = static_cast<int64_t>(ViewOf(message->header.stamp));
    ASSERT_EQ(expected.count(view), 1u) << message->header.stamp << ": not an image's stamp";
    EXPECT_EQ(message->header.frame_id, output_frame);
    const DepthMap& depth = expected.at(view)->depth;
    EXPECT_GT(std::count_if(depth.begin(), depth.end(), [](float z) { return z > 0; }), depth.size() / 2);
    // Also where poses went through another frame and are rounded differently by 1e-16: matching takes them as float
    // numbers, whose steps are 1e8 times as large. (An extrinsic that is a millimetre off changes every pixel.)
    EXPECT_EQ(CountDifferent(*message, depth), 0);
  }

  for (const auto& message : pose_.messages()) {
    EXPECT_EQ(message->header.frame_id, traits_.Text("world"));
    ExpectPose(message->header.stamp, message->pose, RigidTransform::Identity());
  }
  if (!traits_.Text("path").empty()) ExpectPathToMoveTheKeyframes();
}

INSTANTIATE_TEST_SUITE_P(Of, FrontendTest,
                         ::testing::Values("vins_mono", "vins_fusion", "vins_fusion_camera_pose", "orb_slam3_ros",
                                           "orb_slam3_ros_wrapper", "orb_slam_2_ros", "stella_vslam_ros", "ov2slam",
                                           "kimera_vio", "okvis", "openvins", "rtabmap"),
                         [](const auto& frontend) { return std::string(frontend.param); });

}  // namespace acmp::test::frontends_rostest
