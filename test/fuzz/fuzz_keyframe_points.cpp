// Two KeyframePoints and an optimized_path into a map, as map_server does.

#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/optimized_path.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(keyframe_points) {
  using namespace acmp;
  fuzz::Bytes bytes(data, size);
  MapStore map({});
  for (int i = 0; i < 2; ++i) {
    acmp_mapping::KeyframePoints message;
    fuzz::Fill(&bytes, &message.header);
    message.mapper = bytes.TakeText();
    message.run = bytes.Take<uint8_t>();
    message.id = bytes.Take<uint8_t>();
    message.replaces = bytes.TakeBool();
    message.path_inverted = bytes.TakeBool();
    message.path_tolerance = bytes.Take<double>();
    for (double& value : message.T_world_cam) value = bytes.Take<double>();
    for (double& value : message.path_T_child_cam) value = bytes.Take<double>();
    message.refined_world = bytes.Take<uint8_t>();
    message.refined_scale = bytes.Take<double>();
    for (double& value : message.T_refined_cam) value = bytes.Take<double>();
    for (double& value : message.T_received_cam) value = bytes.Take<double>();
    message.camera_info = *ToCameraInfo({64, 48, 50, 50, 31.5, 23.5}, message.header);  // has a target of its own
    fuzz::Fill(&bytes, &message.points);
    fuzz::MayRefuse([&] {
      const KeyframePointsHead head = ReadHead(message);
      const PointCloud points = ToPointCloud(message.points);
      if (message.replaces) {
        map.Replace(head.key, head.pose, points);
      } else {
        map.Add(head.key, head.pose, points);
      }
    });
  }
  nav_msgs::Path path;
  path.poses.resize(bytes.Take<uint8_t>() % 8);
  for (geometry_msgs::PoseStamped& pose : path.poses) {
    fuzz::Fill(&bytes, &pose.header);
    fuzz::Fill(&bytes, &pose.pose);
  }
  fuzz::MayRefuse([&] {
    const OptimizedPath poses = ToOptimizedPath(path, "map", [](const Incident&) {});
    const ReposeResult result = map.Repose(poses.poses);
    DescribeDoubt(poses, result, "map");
    DescribeTooFar(result);
  });
  fuzz::MayRefuse([&] { map.WorldCloud(); });  // also what is too far away for its voxels
  map.Path();
  return 0;
}
