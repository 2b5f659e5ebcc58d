#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

/// How a lens bends the rays of a camera: OpenCV's models and coefficients, those of Kalibr and basalt for wide lenses,
/// and the equirectangular projection.
struct LensDistortion {
  enum class Model {
    kNone,
    kBrownConrady,     ///< k1 k2 p1 p2 [k3]
    kRational,         ///< k1 k2 p1 p2 k3 k4 k5 k6
    kEquidistant,      ///< k1 k2 k3 k4: the fisheye of Kannala and Brandt
    kUnified,          ///< xi k1 k2 p1 p2: the omnidirectional camera of Mei and Rives (OpenCV's omnidir)
    kExtendedUnified,  ///< alpha beta: EUCM, Khomutenko et al. 2016 (beta = 1: UCM, as in basalt)
    kDoubleSphere,     ///< xi alpha: Usenko et al., 3DV 2018
    kEquirectangular,  ///< none: longitude and latitude of the whole sphere; fx and fy in px per rad
  };
  Model model = Model::kNone;
  std::vector<double> coefficients;

  bool operator==(const LensDistortion& o) const { return model == o.model && coefficients == o.coefficients; }
};

/// How the camera moved while the rows of an image were read out one after the other (rolling shutter), from the first
/// to the last. Nothing: all rows were taken at once.
struct ReadoutMotion {
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  ///< rad, of the scene about the camera's axes
  Eigen::Vector3d move = Eigen::Vector3d::Zero();  ///< of the camera along its axes, over the scene's typical depth

  bool operator==(const ReadoutMotion& o) const { return turn == o.turn && move == o.move; }
};

/// A camera with its lens: at which pixel of the image as it is stored or sent a ray is seen. Rays are in the camera's
/// frame, of any length.
class Lens {
 public:
  /// Coefficients hold as long as the image of a ray goes outwards with the ray's angle from the axis: beyond, two rays
  /// would fall on one pixel, and the lens sees nothing. Throws InvalidInputError where that is so near the middle that
  /// they cannot be right (a quarter of the image's shorter side) or within `field_of_view`, for a field that the model
  /// cannot have, and for an equirectangular image that is not twice as wide as high.
  /// @param field_of_view deg from side to side, of a lens whose image ends at a circle; 0: all of the image is seen
  Lens(const PinholeCamera& camera, const LensDistortion& distortion, double field_of_view = 0);

  /// The pixel of a ray, which may lie outside of the image; none where the lens does not see the ray.
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& ray) const;

  /// Whether a pixel lies where the lens puts a ray; tangential distortion aside.
  bool Shows(const Eigen::Vector2d& pixel) const;

  /// The ray of a pixel, of length 1; none where the lens sees none.
  std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& pixel) const;

  /// Angle that the image shows from left to right or from top to bottom, through the principal point, whichever is
  /// larger; deg.
  double FieldOfView() const;

  /// The pinhole camera that takes the distortion out: of the image's size and of the lens' resolution in its middle.
  PinholeCamera Undistorted() const;

  const PinholeCamera& camera() const { return camera_; }
  const LensDistortion& distortion() const { return distortion_; }

  bool operator==(const Lens& o) const {
    return camera_ == o.camera_ && distortion_ == o.distortion_ && limit_ == o.limit_;
  }

 private:
  double Radius(double angle) const;
  double RadialFactor(double r2) const;
  Eigen::Vector2d Bend(const Eigen::Vector2d& ideal) const;

  PinholeCamera camera_;
  LensDistortion distortion_;
  std::array<double, 8> k_ = {};  ///< its coefficients; 0 where it has fewer
  double limit_ = 0;              ///< angle from the axis beyond which nothing is seen, rad
  double cos_limit_ = 0;          ///< its cosine
  double radius_ = 0;             ///< where that is seen from the principal point, for a focal length of 1
};

/// Whether the model's coefficients can say one: not those of EUCM, double sphere and whole spheres.
bool CanHaveRadialDistortion(LensDistortion::Model model);

/// The coefficients of a lens in front of which a ray at (x, y, 1) comes from (x, y) (1 + k1 r^2 + k2 r^4), as those of
/// its own model (of LensDistortion::Model::kNone: kBrownConrady) that fit best within the image.
/// @param lens of a model that can have it (CanHaveRadialDistortion)
LensDistortion WithRadialDistortion(const Lens& lens, double k1, double k2);

/// Throws what the Lens does, with a name before it.
void CheckLens(const std::string& name, const PinholeCamera& camera, const LensDistortion& distortion,
               double field_of_view = 0);

/// A pinhole camera at the place of one with a lens.
struct PinholeFace {
  std::string name;  ///< "left", "right", "up", "down" or "back"; empty: it looks where the lens does
  PinholeCamera camera;
  Eigen::Matrix3d lens_from_face = Eigen::Matrix3d::Identity();  ///< rotation

  bool operator==(const PinholeFace& o) const { return camera == o.camera && lens_from_face == o.lens_from_face; }
};

/// A field of view from which one pinhole camera of the lens' focal length loses the rim, deg.
constexpr double kWideFieldOfView = 120;

/// The pinhole cameras that see together what a wide lens sees, at the resolution of its middle: the faces of a cube, a
/// little wider than 90 degrees each, cut to what the lens shows of them; the one ahead comes first. Those of which it
/// shows hardly anything are left out; if all, InvalidInputError. Up to kWideFieldOfView, its own camera alone.
std::vector<PinholeFace> FacesOf(const Lens& lens);

}  // namespace acmp
