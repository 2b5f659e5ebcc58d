#include "acmp_mapping/synthetic/synthetic_scene.h"

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "world.h"

namespace acmp {
namespace {

/// About a vector whose length is the angle, rad; for small angles, without libm.
Eigen::Quaterniond SmallRotation(const Eigen::Vector3d& turn) {
  return Eigen::Quaterniond(1, 0.5 * turn.x(), 0.5 * turn.y(), 0.5 * turn.z()).normalized();
}

Eigen::Vector3d BellVector(RandomStream* random, double sigma) {
  const double x = BellNoise(random, sigma), y = BellNoise(random, sigma), z = BellNoise(random, sigma);
  return {x, y, z};
}

/// How the frontend sees the true world around one camera: x -> scale * rotation * (x - centre) + placed.
struct LocalWorld {
  double scale = 1;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< of the camera in the true world
  Eigen::Vector3d placed = Eigen::Vector3d::Zero();  ///< where the frontend puts it

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (rotation * (point - centre)) + placed;
  }
  RigidTransform CameraPose(const RigidTransform& true_world_from_cam) const {
    RigidTransform pose = RigidTransform::Identity();
    pose.linear() = rotation.toRotationMatrix() * true_world_from_cam.linear();
    pose.translation() = placed;
    return pose;
  }
};

RigidTransform WithJitter(const RigidTransform& pose, const SlamErrors& errors, double scale, RandomStream* random) {
  RigidTransform jitter = RigidTransform::Identity();
  jitter.linear() = SmallRotation(BellVector(random, kRadPerDeg<double> * errors.jitter_deg)).toRotationMatrix();
  jitter.translation() = BellVector(random, scale * errors.jitter_m);
  return pose * jitter;
}

}  // namespace

Eigen::Vector3d SlamRun::ToTrueWorld(const Eigen::Vector3d& point) const {
  return start_from_true.inverse(Eigen::Isometry) * (point / errors.units_per_m);
}

SlamRun SimulateSlam(const std::vector<SyntheticView>& views, const SlamErrors& errors, uint32_t seed) {
  const auto start = static_cast<size_t>(errors.start);
  CheckRange("start", errors.start, 0, 1000);
  CheckRange("images of the simulated frontend", views.size(), start + 4, size_t{1000});
  if (!(errors.units_per_m > 0)) throw InvalidInputError(Concat("units_per_m = ", errors.units_per_m, ": must be > 0"));
  SlamRun run;
  run.errors = errors;
  run.loop_closure = start + 2 * (views.size() - start) / 3;
  run.start_from_true = views[start].frame.cam_from_world;
  run.corrected.assign(run.loop_closure, RigidTransform::Identity());
  run.outputs.resize(views.size());

  LocalWorld after;  // the loop closure
  after.scale = errors.units_per_m;
  after.rotation = Eigen::Quaterniond(run.start_from_true.linear()).normalized();
  LocalWorld drifting = after;
  const Eigen::Quaterniond turn = SmallRotation({0, 0, kRadPerDeg<double> * errors.turn_deg});
  for (size_t i = start; i < views.size(); ++i) {
    const RigidTransform true_pose = views[i].frame.cam_from_world.inverse(Eigen::Isometry);
    const Eigen::Vector3d step = true_pose.translation() - (i > start ? drifting.centre : true_pose.translation());
    drifting.centre = after.centre = true_pose.translation();
    after.placed = errors.units_per_m * (run.start_from_true * true_pose.translation());
    if (i > start) {
      const double share = static_cast<double>(i - start) / static_cast<double>(run.loop_closure - start);
      drifting.scale = errors.units_per_m * (1 + errors.scale_growth * share);
      drifting.rotation = (drifting.rotation * turn).normalized();
      const Eigen::Vector3d too_long(errors.step_m, 0, 0);
      drifting.placed += drifting.scale * (drifting.rotation * (step + too_long));
    }
    const LocalWorld& world = i < run.loop_closure ? drifting : after;
    RandomStream random(seed, static_cast<uint32_t>(i), 0);
    SlamOutput& output = run.outputs[i];
    output.cam_from_world =
        WithJitter(world.CameraPose(true_pose), errors, world.scale, &random).inverse(Eigen::Isometry);
    for (const Eigen::Vector3d& landmark : views[i].frame.landmarks_in_world) {
      output.landmarks_in_world.push_back(world * landmark);
    }
    if (i < run.loop_closure) run.corrected[i] = after.CameraPose(true_pose);
  }
  return run;
}

}  // namespace acmp
