#include "ros/frontend_traits.h"

#include "acmp_mapping/common/error.h"

namespace acmp::test {
namespace {

/// x right, y down, z forward -> x forward, y left, z up
Eigen::Matrix3d FluFromOptical() {
  Eigen::Matrix3d rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return rotation;
}

RigidTransform Rotation(const Eigen::Matrix3d& matrix) {
  RigidTransform transform = RigidTransform::Identity();
  transform.linear() = matrix;
  return transform;
}

/// Where the camera of a robot sits.
RigidTransform BaseFromCameraLink() {
  RigidTransform transform = RigidTransform::Identity();
  transform.linear() << 0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1;
  transform.translation() << 0.25, -0.125, 0.5;
  return transform;
}

FrontendTraits Vins(const std::string& name) {
  FrontendTraits vins;
  vins.name = name;
  vins.image_topic = "/cam0/image_raw";
  vins.image_frame = "cam0";
  vins.pose_message = PoseMessage::kOdometry;
  vins.pose_topic = "/vins_estimator/keyframe_pose";
  vins.world_frame = "world";
  vins.child_from_cam = ImuFromCamera();
  vins.pose_stamp = StampRounding::kDouble;
  vins.pose_delay = 2;
  vins.cloud_message = CloudMessage::kChannelPerPoint;
  vins.cloud_topic = "/vins_estimator/keyframe_point";
  vins.cloud_stamp = StampRounding::kDouble;
  vins.extrinsic_topic = "/vins_estimator/extrinsic";
  return vins;
}

FrontendTraits VinsMono() {
  FrontendTraits vins = Vins("vins_mono");
  // The tf that it broadcasts: its name of the camera is not that of the images.
  vins.static_transforms = {{"body", "camera", ImuFromCamera()}};
  vins.path_topic = "/pose_graph/pose_graph_path";
  vins.path_frame = "world";
  return vins;
}

FrontendTraits VinsFusion() {
  FrontendTraits vins = Vins("vins_fusion");
  vins.path_topic = "/loop_fusion/pose_graph_path";
  vins.path_frame = "world";
  vins.cloud_frame = "world";
  return vins;
}

/// The other way to wire VINS: the camera's pose of every image, at once.
FrontendTraits VinsFusionCameraPose() {
  FrontendTraits vins = Vins("vins_fusion_camera_pose");
  vins.pose_topic = "/vins_estimator/camera_pose";
  vins.child_from_cam.setIdentity();
  vins.pose_delay = 0;
  vins.cloud_topic = "/vins_estimator/point_cloud";
  vins.cloud_frame = "world";
  vins.extrinsic_topic = "";
  return vins;
}

FrontendTraits OrbSlam3(const std::string& name, const std::string& cloud_topic) {
  FrontendTraits orb;
  orb.name = name;
  orb.image_topic = "/camera/image_raw";
  orb.camera_info_topic = "/camera/camera_info";
  orb.image_frame = "camera_optical_frame";
  orb.pose_topic = "/orb_slam3/camera_pose";
  orb.world_frame = "world";
  orb.float_poses = true;
  orb.cloud_topic = cloud_topic;
  orb.cloud_frame = "world";
  orb.zero_points = true;
  return orb;
}

FrontendTraits OrbSlam2() {
  FrontendTraits orb = OrbSlam3("orb_slam_2_ros", "/orb_slam2_mono/map_points");
  orb.pose_topic = "/orb_slam2_mono/pose";
  orb.world_frame = "map";
  orb.child_from_cam = BaseFromCameraLink() * Rotation(FluFromOptical());
  orb.world_from_scene = FluFromOptical();
  orb.cloud_frame = "map";
  orb.whole_map = true;
  orb.static_transforms = {{"base_link", "camera_link", BaseFromCameraLink()},
                           {"camera_link", "camera_optical_frame", Rotation(FluFromOptical())}};
  return orb;
}

FrontendTraits StellaVslam() {
  FrontendTraits stella;
  stella.name = "stella_vslam_ros";
  stella.image_topic = "/camera/image_raw";
  stella.camera_info_topic = "/camera/camera_info";
  stella.image_frame = "camera_optical_frame";
  stella.pose_message = PoseMessage::kOdometry;
  stella.pose_topic = "/run_slam/camera_pose";
  stella.world_frame = "map";
  stella.child_frame = "camera_frame";
  stella.child_from_cam = Rotation(FluFromOptical());
  stella.world_from_scene = FluFromOptical();
  stella.cloud_message = CloudMessage::kPclXyz;
  stella.cloud_topic = "/run_slam/pointcloud";
  stella.cloud_frame = "map";
  stella.whole_map = true;
  return stella;
}

FrontendTraits Ov2Slam() {
  FrontendTraits ov2;
  ov2.name = "ov2slam";
  ov2.image_topic = "/cam0/image_raw";
  ov2.camera_info_topic = "/cam0/camera_info";
  ov2.image_frame = "cam0";
  ov2.pose_topic = "/ov2slam_node/vo_pose";
  ov2.world_frame = "world";
  ov2.pose_stamp = StampRounding::kDouble;
  ov2.cloud_message = CloudMessage::kPclXyzRgb;
  ov2.cloud_topic = "/ov2slam_node/point_cloud";
  ov2.cloud_frame = "world";
  ov2.cloud_stamp = StampRounding::kMicroseconds;
  ov2.whole_map = true;
  ov2.zero_points = true;
  return ov2;
}

/// As forks do: the map is the same, whenever it was sent.
FrontendTraits Ov2SlamLateCloud() {
  FrontendTraits ov2 = Ov2Slam();
  ov2.name = "ov2slam_cloud_stamped_now";
  ov2.cloud_stamp = StampRounding::kSendingTime;
  return ov2;
}

FrontendTraits KimeraVio() {
  FrontendTraits kimera;
  kimera.name = "kimera_vio";
  kimera.image_topic = "/cam0/image_raw";
  kimera.camera_info_topic = "/cam0/camera_info";
  kimera.image_frame = "cam0";
  kimera.output_frame = "left_cam";
  kimera.pose_message = PoseMessage::kOdometry;
  kimera.pose_topic = "/kimera_vio_ros/odometry";
  kimera.world_frame = "world";
  kimera.child_frame = "base_link";
  kimera.child_from_cam = ImuFromCamera();
  kimera.cloud_message = CloudMessage::kPclXyzRgb;
  kimera.cloud_topic = "/kimera_vio_ros/time_horizon_pointcloud";
  kimera.cloud_frame = "world";
  kimera.cloud_stamp = StampRounding::kMicroseconds;
  kimera.path_topic = "/kimera_vio_ros/optimized_trajectory";
  kimera.path_frame = "map";
  kimera.static_transforms = {{"base_link", "left_cam", ImuFromCamera()}};
  return kimera;
}

FrontendTraits Okvis() {
  FrontendTraits okvis;
  okvis.name = "okvis";
  okvis.image_topic = "/cam0/image_raw";
  okvis.image_frame = "cam0";
  okvis.pose_message = PoseMessage::kOdometry;
  okvis.pose_topic = "/okvis_node/okvis_odometry";
  okvis.world_frame = "world";
  okvis.child_frame = "world";  // velocitiesFrame: Wc
  okvis.child_from_cam = ImuFromCamera();
  okvis.poses_per_image = 4;
  okvis.cloud_message = CloudMessage::kPclXyzRgb;
  okvis.cloud_topic = "/okvis_node/okvis_points_matched";
  okvis.cloud_frame = "world";
  okvis.cloud_stamp = StampRounding::kMicroseconds;
  return okvis;
}

FrontendTraits OpenVins() {
  FrontendTraits openvins;
  openvins.name = "openvins";
  openvins.image_topic = "/cam0/image_raw";
  openvins.image_frame = "cam0_of_the_driver";
  openvins.pose_message = PoseMessage::kOdometry;
  openvins.pose_topic = "/ov_msckf/loop_pose";
  openvins.world_frame = "global";
  openvins.child_from_cam = ImuFromCamera();
  openvins.pose_stamp = StampRounding::kDouble;
  openvins.pose_delay = 1;
  openvins.cloud_message = CloudMessage::kChannelPerPoint;
  openvins.cloud_topic = "/ov_msckf/loop_feats";
  openvins.cloud_frame = "global";
  openvins.cloud_stamp = StampRounding::kDouble;
  openvins.extrinsic_topic = "/ov_msckf/loop_extrinsic";
  openvins.path_topic = "/loop_fusion/pose_graph_path";
  openvins.path_frame = "global";
  return openvins;
}

FrontendTraits RtabMap() {
  FrontendTraits rtabmap;
  rtabmap.name = "rtabmap";
  rtabmap.image_topic = "/camera/rgb/image_rect_color";
  rtabmap.camera_info_topic = "/camera/rgb/camera_info";
  rtabmap.image_frame = "camera_rgb_optical_frame";
  rtabmap.pose_message = PoseMessage::kTf;
  rtabmap.pose_topic = "/tf";
  rtabmap.world_frame = "odom";
  rtabmap.child_frame = "camera_link";
  rtabmap.child_from_cam = Rotation(FluFromOptical());
  rtabmap.world_from_scene = FluFromOptical();
  rtabmap.cloud_message = CloudMessage::kPclXyzRgb;
  rtabmap.cloud_topic = "/rtabmap/odom_local_map";
  rtabmap.cloud_frame = "odom";
  rtabmap.static_transforms = {{"camera_link", "camera_rgb_optical_frame", Rotation(FluFromOptical())}};
  return rtabmap;
}

}  // namespace

bool FrontendTraits::SendsSameNumbers() const {
  return child_from_cam.isApprox(RigidTransform::Identity(), 0) && world_from_scene.isIdentity(0);
}

RigidTransform ImuFromCamera() {
  RigidTransform transform = RigidTransform::Identity();
  transform.linear() << 0.6, -0.64, 0.48, 0.8, 0.48, -0.36, 0, 0.6, 0.8;
  transform.translation() << 0.07, -0.02, 0.05;
  return transform;
}

const std::vector<FrontendTraits>& AllFrontends() {
  static const std::vector<FrontendTraits> kAll = {VinsMono(),
                                                   VinsFusion(),
                                                   VinsFusionCameraPose(),
                                                   OrbSlam3("orb_slam3_ros", "/orb_slam3/tracked_points"),
                                                   OrbSlam3("orb_slam3_ros_wrapper", "/orb_slam3/map_points"),
                                                   OrbSlam2(),
                                                   StellaVslam(),
                                                   Ov2Slam(),
                                                   Ov2SlamLateCloud(),
                                                   KimeraVio(),
                                                   Okvis(),
                                                   OpenVins(),
                                                   RtabMap()};
  return kAll;
}

const FrontendTraits& FindFrontend(const std::string& name) {
  std::string known;
  for (const FrontendTraits& frontend : AllFrontends()) {
    if (frontend.name == name) return frontend;
    known += " " + frontend.name;
  }
  throw InvalidInputError(Concat("unknown frontend \"", name, "\": must be one of", known));
}

}  // namespace acmp::test
