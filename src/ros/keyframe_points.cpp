#include "acmp_mapping/ros/keyframe_points.h"

#include <algorithm>
#include <cmath>

#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"

namespace acmp {
namespace {

using acmp_mapping::KeyframePoints;

constexpr size_t kMaxNameLength = 255;
constexpr char kNameCharacters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_/";

using Matrix3x4 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
using Numbers = KeyframePoints::_T_world_capture_type;

Numbers ToNumbers(const RigidTransform& transform) {
  Numbers numbers;
  Eigen::Map<Matrix3x4>(numbers.data()) = transform.matrix().topRows<3>();
  return numbers;
}

RigidTransform TransformFromNumbers(const char* name, const Numbers& numbers) {
  RigidTransform transform = RigidTransform::Identity();
  transform.matrix().topRows<3>() = Eigen::Map<const Matrix3x4>(numbers.data());
  CheckPose(name, transform);
  return transform;
}

}  // namespace

acmp_mapping::KeyframePointsPtr ToKeyframePoints(const KeyframePointsHead& head, const PointCloud& points_in_camera) {
  const KeyframePose& pose = head.pose;
  auto message = boost::make_shared<KeyframePoints>();
  message->header.stamp.fromNSec(static_cast<uint64_t>(pose.stamp_ns));
  message->header.frame_id = head.world_frame;
  message->mapper = head.key.mapper;
  message->run = head.key.run;
  message->id = head.key.id;
  message->view = pose.view;
  message->T_world_capture = ToNumbers(pose.world_from_capture);
  message->T_capture_cam = ToNumbers(pose.capture_from_cam);
  message->T_refined_capture.fill(0);
  message->T_received_capture.fill(0);
  if (pose.refined) {
    message->refined_world = pose.refined->refined.world;
    message->T_refined_capture = ToNumbers(pose.refined->refined.world_from_cam);
    message->refined_scale = pose.refined->refined.scale;
    message->T_received_capture = ToNumbers(pose.refined->received);
  }
  std_msgs::Header camera = message->header;
  camera.frame_id = pose.camera_frame;
  message->camera_info = *ToCameraInfo(pose.camera, camera);
  FillCloud(points_in_camera, camera, &message->points);
  message->path_inverted = pose.path.maps_world_to_child;
  message->path_T_child_capture.fill(0);
  if (pose.path.child_from_cam) message->path_T_child_capture = ToNumbers(*pose.path.child_from_cam);
  message->path_frame = pose.path_frame;
  message->path_tolerance = static_cast<double>(pose.path.tolerance_ns) * 1e-9;
  return message;
}

acmp_mapping::KeyframePointsPtr ToKeyframePoints(const KeyframeOutput& output, const std::string& mapper,
                                                 bool replaces) {
  const CaptureOrigin& origin = output.origin();
  const ReceivedFrame& frame = output.frame();
  KeyframePointsHead head;
  const KeyframeDepth& maps = *output.maps;
  head.key = {mapper, origin.run, static_cast<uint64_t>(frame.id)};
  const RigidTransform capture_from_cam(frame.face.lens_from_face);
  head.pose = {origin.stamp_ns, origin.world_from_cam, origin.path,  origin.path_frame,
               std::nullopt,    frame.frame_id(),      frame.camera, static_cast<uint64_t>(frame.id - origin.id),
               capture_from_cam};
  if (maps.refined_camera) {
    head.pose.world_from_capture = (capture_from_cam * maps.cam_from_world).inverse();
    head.pose.refined = RefinedAndReceived{*maps.refined_camera, origin.world_from_cam};
    head.pose.refined->refined.world_from_cam.rotate(frame.face.lens_from_face.transpose());  // faces have one centre
  }
  head.world_frame = origin.world_frame;
  acmp_mapping::KeyframePointsPtr message = ToKeyframePoints(head, output.points_in_camera());
  message->replaces = replaces;
  if (!replaces && output.frame().jpeg) FillImage(*output.frame().jpeg, message.get());
  return message;
}

void FillImage(std::string_view jpeg, KeyframePoints* message) {
  message->image.header = message->points.header;
  message->image.format = "jpeg";
  message->image.data.assign(jpeg.begin(), jpeg.end());
}

StoredImagePtr StoreImage(const KeyframePoints& message, ImageStore* images) {
  const std::vector<uint8_t>& data = message.image.data;
  if (data.empty()) return nullptr;
  return images->Put({reinterpret_cast<const char*>(data.data()), data.size()},
                     ToCalibration(message.camera_info, true).camera);
}

std::string NameOf(const KeyframePoints& message) {
  return Concat("keyframe ", message.id, " of \"", message.mapper.substr(0, kMaxNameLength), "\"");
}

KeyframePointsHead ReadHead(const KeyframePoints& message, size_t max_bytes) {
  if (message.mapper.empty()) throw InvalidInputError("mapper is empty: must be the name of the mapper's node");
  if (message.mapper.find_first_not_of(kNameCharacters) != std::string::npos) {
    throw InvalidInputError("mapper: must be the name of a node, of letters, digits, _ and /");
  }
  if (message.mapper.size() > kMaxNameLength) {
    throw InvalidInputError(
        Concat("mapper has a name of ", message.mapper.size(), " characters: must have at most ", kMaxNameLength));
  }
  KeyframePointsHead head;
  head.key = {message.mapper, message.run, message.id};
  head.pose.stamp_ns = ToStampNs(message.header.stamp);
  CheckRange<uint64_t>("view", message.view, 0, message.id);
  head.pose.view = message.view;
  head.pose.world_from_capture = TransformFromNumbers("T_world_capture", message.T_world_capture);
  head.pose.capture_from_cam = TransformFromNumbers("T_capture_cam", message.T_capture_cam);
  if (message.refined_world != 0) {
    // More than any frontend has: what loop closures and sessions make of a scale must be readable again.
    CheckRange("refined_scale", message.refined_scale, 1e-100, 1e100);
    head.pose.refined =
        RefinedAndReceived{{message.refined_world, TransformFromNumbers("T_refined_capture", message.T_refined_capture),
                            message.refined_scale},
                           TransformFromNumbers("T_received_capture", message.T_received_capture)};
  }
  head.pose.path.maps_world_to_child = message.path_inverted;
  head.pose.path.child_from_cam.reset();
  const Numbers& child_from_cam = message.path_T_child_capture;
  if (std::any_of(child_from_cam.begin(), child_from_cam.end(), [](double number) { return number != 0; })) {
    head.pose.path.child_from_cam = TransformFromNumbers("path_T_child_capture", child_from_cam);
  }
  CheckRange("path_tolerance", message.path_tolerance, 0.0, 10.0);
  head.pose.path.tolerance_ns = std::llround(message.path_tolerance * 1e9);
  head.world_frame = StripLeadingSlash(message.header.frame_id);
  head.pose.path_frame = StripLeadingSlash(message.path_frame);
  head.pose.camera_frame = StripLeadingSlash(message.points.header.frame_id);
  head.pose.camera = ToCalibration(message.camera_info, true).camera;
  const PinholeCamera& camera = head.pose.camera;
  constexpr uint64_t kPixelBytes = 50;  // maps and messages of all of a session's images
  CheckMemory(Concat("camera_info of ", camera.width, "x", camera.height, " pixels"),
              static_cast<uint64_t>(camera.width) * static_cast<uint64_t>(camera.height), kPixelBytes, max_bytes);
  return head;
}

OptimizedPath ToOptimizedPath(const nav_msgs::Path& message, const std::string& path_frame,
                              const std::function<void(const RejectedInput&)>& on_bad_pose) {
  OptimizedPath path;
  path.poses.reserve(message.poses.size());
  for (const geometry_msgs::PoseStamped& pose : message.poses) {
    try {
      path.poses.push_back({ToStampNs(pose.header.stamp), ToTransform(pose.pose)});
    } catch (const InvalidInputError& error) {
      on_bad_pose({"bad_optimized_pose", Concat("optimized_path, pose ", pose.header.stamp, ": ", error.what())});
      continue;
    }
    const std::string& named = pose.header.frame_id.empty() ? message.header.frame_id : pose.header.frame_id;
    const std::string frame = StripLeadingSlash(named);
    if (path_frame.empty() || frame.empty() || frame == path_frame) continue;
    if (path.in_other_frame++ == 0) path.other_frame = frame;
  }
  return path;
}

RejectedInput DescribeDoubt(const OptimizedPath& path, const ReposeResult& result, const std::string& path_frame) {
  const auto to_ms = [](int64_t ns) { return static_cast<double>(ns) * 1e-6; };
  if (path.in_other_frame > 0) {
    return {"optimized_path_frame",
            Concat(path.in_other_frame, " of ", path.poses.size(), " poses of optimized_path are in \"",
                   path.other_frame, "\", the map is in \"", path_frame,
                   "\": taken as if they were in the map's; set ~world_frame of the mapper if both are the same")};
  }
  if (result.unresolved > 0) {
    return {"optimized_path_extrinsic",
            Concat(result.unresolved,
                   " keyframes are not corrected by optimized_path: their mapper did not know "
                   "T_body_cam, which ~path_child = body needs")};
  }
  if (result.named == 0 && result.too_far == 0 && result.nearest) {
    return {"optimized_path_unmatched",
            Concat("none of the ", path.poses.size(), " poses of optimized_path has the stamp of a keyframe within ",
                   to_ms(result.nearest->tolerance_ns), " ms (~sync_tolerance of the mapper); the nearest is ",
                   to_ms(result.nearest->gap_ns), " ms away: each pose needs the stamp of its own image")};
  }
  return {};
}

RejectedInput DescribeTooFar(const ReposeResult& result) {
  if (!result.first_too_far) return {};
  const ReposeResult::TooFar& first = *result.first_too_far;
  return {"optimized_path_too_far",
          Concat("keyframes not moved by optimized_path: ", result.too_far, "; the first would go by pose ",
                 FormatStamp(first.stamp_ns), " to (", first.position.x(), ", ", first.position.y(), ", ",
                 first.position.z(), "): must lie within ", first.allowed.max_distance, " of (",
                 first.allowed.origin.x(), ", ", first.allowed.origin.y(), ", ", first.allowed.origin.z(),
                 ") with its points (", kMaxMapVoxels, " voxels)")};
}

}  // namespace acmp
