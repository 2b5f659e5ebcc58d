#include "acmp_mapping/keyframe/frame.h"

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {

void CheckPose(const char* name, const RigidTransform& pose) {
  // Wider than float32 rounding of a quaternion, narrower than anything a reprojection error could hide.
  constexpr double kTolerance = 1e-3;
  if (!pose.matrix().allFinite()) {
    throw InvalidInputError(
        Concat(name, ": the pose has a value that is not finite: translation (", pose.translation().transpose(), ")"));
  }
  const Eigen::Matrix3d rotation = pose.linear();
  const double deviation = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (deviation > kTolerance) {
    throw InvalidInputError(
        Concat(name, ": the rotation is off orthonormal by ", deviation, ": must be at most ", kTolerance));
  }
  if (rotation.determinant() < 0) {
    throw InvalidInputError(Concat(name, ": the rotation is a reflection (determinant ", rotation.determinant(), ")"));
  }
}

Frame MakeFrame(int64_t id, double stamp_s, ColorImage color, const PinholeCamera& camera,
                const RigidTransform& cam_from_world, std::vector<Eigen::Vector3d> landmarks_in_world, int max_size,
                const Mask& mask, const DepthMap& prior_depth, const LabelImage& labels) {
  const std::string name = Concat("frame ", id);
  CheckCamera(name, camera);
  CheckPose(name.c_str(), cam_from_world);
  CheckSize(name + ": image", color.width(), color.height(), camera);
  if (!mask.empty() && (mask.width() != camera.width || mask.height() != camera.height)) {
    throw InvalidInputError(Concat(name, ": mask size ", mask.width(), " x ", mask.height(), ": must be the image's, ",
                                   camera.width, " x ", camera.height));
  }
  if (max_size < 0) throw InvalidInputError(Concat(name, ": max_size = ", max_size, ": must be >= 0 px"));

  int width = camera.width;
  int height = camera.height;
  LimitSize(max_size, &width, &height);

  Frame frame;
  frame.id = id;
  frame.stamp_s = stamp_s;
  frame.camera = camera.Resized(width, height);
  frame.cam_from_world = cam_from_world;
  // Resized in float, after the conversion: averaging keeps the faint texture that 8 bits would round away.
  frame.gray = ToGray(color);
  if (width != camera.width || height != camera.height) {
    frame.gray = Resize(frame.gray, width, height);
    color = Resize(color, width, height);
  }
  frame.color = std::move(color);
  if (IgnoresSome(mask)) frame.mask = ResizeMask(mask, width, height);
  if (!labels.empty()) frame.labels = ResizeLabels(labels, width, height);
  if (!prior_depth.empty()) frame.prior_depth = ResizeDepth(prior_depth, width, height);
  frame.landmarks_in_world =
      WithoutMasked(std::move(landmarks_in_world), frame.camera, frame.cam_from_world, frame.mask);
  return frame;
}

std::vector<Eigen::Vector3d> RoundedToFloat(const std::vector<Eigen::Vector3d>& points) {
  // Through memory: gcc 12's vectoriser takes point.cast<float>().cast<double>() for a copy.
  std::vector<Eigen::Vector3f> rounded(points.size());
  std::transform(points.begin(), points.end(), rounded.begin(),
                 [](const Eigen::Vector3d& point) { return Eigen::Vector3f(point.cast<float>()); });
  std::vector<Eigen::Vector3d> result(points.size());
  std::transform(rounded.begin(), rounded.end(), result.begin(),
                 [](const Eigen::Vector3f& point) { return Eigen::Vector3d(point.cast<double>()); });
  return result;
}

}  // namespace acmp
