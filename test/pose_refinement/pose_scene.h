#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdlib>
#include <random>
#include <vector>

#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {

/// The synthetic room, rendered once.
inline const std::vector<SyntheticView>& Room() {
  static const std::vector<SyntheticView> views = [] {
    SyntheticSceneOptions options;
    options.width = 320;
    options.height = 240;
    options.keyframes = 14;
    return MakeSyntheticScene(options);
  }();
  return views;
}

constexpr DepthRange kRoomRange = {0.3f, 12.0f};

/// The room's images with their exact poses. Every image is matched with the three before and after it.
inline std::vector<PosedImage> RoomImages() {
  std::vector<PosedImage> images;
  const int count = static_cast<int>(Room().size());
  for (int i = 0; i < count; ++i) {
    const Frame& frame = Room()[static_cast<size_t>(i)].frame;
    PosedImage image;
    image.id = i;
    image.camera = frame.camera;
    image.cam_from_world = frame.cam_from_world;
    image.depth_range = kRoomRange;
    for (int gap : {2, 1, 3}) {
      if (i - gap >= 0) image.sources.push_back(i - gap);
      if (i + gap < count) image.sources.push_back(i + gap);
    }
    images.push_back(std::move(image));
  }
  return images;
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
