#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <random>
#include <vector>

#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {

/// A walk through the synthetic room, 320 x 240 px.
inline std::vector<SyntheticView> WalkThroughRoom(int keyframes) { return MakeSyntheticScene({320, 240, keyframes}); }

/// Rendered once.
inline const std::vector<SyntheticView>& Room() {
  static const std::vector<SyntheticView> views = WalkThroughRoom(14);
  return views;
}

constexpr DepthRange kRoomRange = {0.3f, 12.0f};

/// The first images of a walk with their exact poses. Every image is matched with the three before and after it.
inline std::vector<PosedImage> ImagesOf(const std::vector<SyntheticView>& views, size_t count) {
  std::vector<PosedImage> images;
  for (size_t i = 0; i < count; ++i) {
    const Frame& frame = views[i].frame;
    PosedImage image;
    image.id = static_cast<int64_t>(i);
    image.camera = frame.camera;
    image.cam_from_world = frame.cam_from_world;
    image.depth_range = kRoomRange;
    for (size_t gap : {2, 1, 3}) {
      if (i >= gap) image.sources.push_back(static_cast<int>(i - gap));
      if (i + gap < count) image.sources.push_back(static_cast<int>(i + gap));
    }
    images.push_back(std::move(image));
  }
  return images;
}

/// An image of the room with the pose that a frontend gives; five in a second.
inline Frame RoomFrame(size_t i, const RigidTransform& received) {
  const Frame& view = Room()[i].frame;
  Frame frame;
  frame.id = static_cast<int64_t>(i);
  frame.stamp_s = 100 + 0.2 * static_cast<double>(i);
  frame.camera = view.camera;
  frame.cam_from_world = received;
  frame.gray = view.gray.Clone();
  return frame;
}

inline std::vector<RigidTransform> TruePoses(const std::vector<SyntheticView>& views = Room()) {
  std::vector<RigidTransform> poses;
  for (const SyntheticView& view : views) poses.push_back(view.frame.cam_from_world);
  return poses;
}

inline ImagePixels RoomPixels(size_t i) { return {Room()[i].frame.gray.Clone(), {}}; }

/// Normally distributed, independent errors about and along each axis, always the same.
class PoseErrors {
 public:
  PoseErrors(double rotation_deg, double position) : rotation_deg_(rotation_deg), position_(position) {}

  RigidTransform Perturbed(const RigidTransform& cam_from_world) {
    const Eigen::Vector3d turn = Draw() * rotation_deg_ * M_PI / 180, move = Draw() * position_;
    RigidTransform error = RigidTransform::Identity();
    error.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    error.translation() = move;
    return error * cam_from_world;
  }

 private:
  /// Sums of twelve uniform numbers: the same on every machine, unlike std::normal_distribution.
  double DrawOne() {
    double sum = -6;
    for (int i = 0; i < 12; ++i)
      sum += static_cast<double>(random_() - random_.min()) / (random_.max() - random_.min());
    return sum;
  }
  Eigen::Vector3d Draw() {
    const double x = DrawOne(), y = DrawOne();
    return {x, y, DrawOne()};
  }

  double rotation_deg_, position_;
  std::minstd_rand random_{7};
};

inline std::vector<RigidTransform> Perturbed(std::vector<RigidTransform> poses, double rotation_deg, double position) {
  PoseErrors errors(rotation_deg, position);
  for (RigidTransform& pose : poses) pose = errors.Perturbed(pose);
  return poses;
}

/// What a frontend sends that has lost track without noticing: from image `begin` on every step is of another length
/// and goes astray.
inline std::vector<RigidTransform> LostFrom(size_t begin, std::vector<RigidTransform> poses) {
  const std::vector<RigidTransform> truth = poses;
  const double lengths[] = {1.5, 0.6, 1.7, 0.7, 1.3, 0.5};
  for (size_t i = std::max<size_t>(begin, 1); i < poses.size(); ++i) {
    RigidTransform motion = truth[i] * truth[i - 1].inverse();
    motion.translation() *= lengths[i % 6];
    motion.linear() =
        Eigen::AngleAxisd(i % 2 == 0 ? 0.02 : -0.01, Eigen::Vector3d(1, 2, 0).normalized()) * motion.linear();
    poses[i] = motion * poses[i - 1];
  }
  return poses;
}

/// Errors of the motion from each image to the next: medians.
struct MotionErrors {
  double rotation_deg = 0;
  double position = 0;
};

inline MotionErrors CompareMotions(const std::vector<RigidTransform>& poses, const std::vector<RigidTransform>& truth) {
  std::vector<double> rotations, positions;
  for (size_t i = 0; i + 1 < poses.size(); ++i) {
    const RigidTransform motion = poses[i + 1] * poses[i].inverse(), exact = truth[i + 1] * truth[i].inverse();
    const RigidTransform error = motion * exact.inverse();
    rotations.push_back(Eigen::AngleAxisd(error.rotation()).angle() * 180 / M_PI);
    positions.push_back((motion.translation() - exact.translation()).norm());
  }
  const auto median = [](std::vector<double> v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  return {median(rotations), median(positions)};
}

inline std::vector<RigidTransform> PosesOf(const std::vector<RefinedPose>& refined) {
  std::vector<RigidTransform> poses;
  for (const RefinedPose& pose : refined) poses.push_back(pose.cam_from_world);
  return poses;
}

inline std::vector<RigidTransform> PosesOf(const std::vector<PosedImage>& images) {
  std::vector<RigidTransform> poses;
  for (const PosedImage& image : images) poses.push_back(image.cam_from_world);
  return poses;
}

inline bool SameBits(const RigidTransform& a, const RigidTransform& b) {
  return std::equal(a.matrix().data(), a.matrix().data() + 16, b.matrix().data());
}

}  // namespace acmp
