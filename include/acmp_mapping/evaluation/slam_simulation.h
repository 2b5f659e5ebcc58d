#pragma once

#include <cstdint>
#include <vector>

#include "acmp_mapping/evaluation/synthetic_scene.h"

namespace acmp {

/// How a simulated monocular SLAM frontend errs. The defaults are like those of recorded ones at their best.
struct SlamErrors {
  int start = 3;               ///< images before it has initialised: poses are the identity, there are no landmarks
  double units_per_m = 0.5;    ///< of its world after the loop closure
  double scale_growth = 0.06;  ///< by this share its scale has grown when it closes the loop
  double turn_deg = 0.1;       ///< by which each step turns the world about the vertical
  double step_m = 0.002;       ///< that each step is too long, along x
  double jitter_deg = 0.06;    ///< of each pose about each axis, standard deviation
  double jitter_m = 0.002;     ///< of each pose along each axis, standard deviation
};

/// What the frontend publishes with one image, in its own world.
struct SlamOutput {
  RigidTransform cam_from_world = RigidTransform::Identity();
  std::vector<Eigen::Vector3d> landmarks_in_world;
};

/// A run of the frontend. Its world is the camera's at image `start`, as its units and the drift have it.
struct SlamRun {
  SlamErrors errors;
  std::vector<SlamOutput> outputs;  ///< one per image
  size_t loop_closure = 0;          ///< before this image it closes a loop: from here on nothing drifts any more
  /// world_from_cam of the images before, as the loop closure corrects them; identity of those before the start.
  std::vector<RigidTransform> corrected;
  RigidTransform start_from_true = RigidTransform::Identity();  ///< the camera's true cam_from_world at image `start`

  /// Where a point of the frontend's world, as that is after the loop closure, lies in the true one, m.
  Eigen::Vector3d ToTrueWorld(const Eigen::Vector3d& point) const;
};

/// Runs the frontend on views in their order. The loop is closed after two thirds of the images. The same input gives
/// the same bytes on every machine. Throws InvalidInputError unless there are at least four images more than `start`,
/// or for units that are not positive.
SlamRun SimulateSlam(const std::vector<SyntheticView>& views, const SlamErrors& errors, uint32_t seed);

}  // namespace acmp
