#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp {

/// A smooth random function of the plane: 24 waves of random direction and phase. Band-limited, so that images of it
/// have no aliasing and bilinear sampling is nearly exact.
class WaveTexture {
 public:
  /// @param shortest, longest wavelengths in metres
  WaveTexture(uint32_t seed, double shortest, double longest);
  double operator()(double x, double y) const;  ///< grey value, mostly in 0..255

 private:
  struct Wave {
    double kx, ky, phase;
  };
  std::vector<Wave> waves_;
};

/// World plane n.X + d = 0.
struct WorldPlane {
  Eigen::Vector3d normal = {0, 0, -1};
  double d = 4;

  static WorldPlane Slanted(double tilt_x_deg, double tilt_y_deg, double distance);
};

/// One rendered image with its exact depths. Owns the pixels.
struct PlanarView {
  PinholeCamera camera;
  RigidTransform cam_from_world = RigidTransform::Identity();
  GrayImage gray;
  DepthMap depth;

  MatchView View(bool with_depth = false) const;
};

/// Camera with square pixels, 60 degrees of horizontal field of view and an uncentred principal point.
PinholeCamera TestCamera(int width, int height);

/// World to camera: at `center`, looking along +z turned by the given angles.
RigidTransform LookAhead(const Eigen::Vector3d& center, double yaw_deg, double pitch_deg, double roll_deg);

/// A textured plane seen by the camera, sampled at pixel centres.
PlanarView RenderPlane(const WorldPlane& plane, const WaveTexture& texture, const PinholeCamera& camera,
                       const RigidTransform& cam_from_world);

/// A textured plane seen by several cameras of one size, 0.3 m apart and turned a little, the first near the origin.
std::vector<PlanarView> RenderPlanarScene(const WorldPlane& plane, int width, int height, int views);

/// Matches view `reference` against all others. Pixels belong to `views`.
PatchMatchProblem MakeProblem(const std::vector<PlanarView>& views, size_t reference, const DepthRange& range,
                              bool with_depths = false);

}  // namespace acmp
