#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "view.h"

namespace acmp {

/// Views, what is known of their poses, and landmarks seen in them.
struct Bundle {
  std::vector<PinholeCamera> cameras;
  std::vector<ViewPose> received;
  std::vector<ViewPose> expected;                    ///< what poses are held to: received ones, or near them
  std::vector<ViewPose> poses;                       ///< the best known so far
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< in the world: centres are relative to it, for precision
  std::vector<double> times;                         ///< of the exposures, ascending; the unit of CameraErrors::readout
  std::vector<std::optional<CameraMotion>> motions;  ///< where known from elsewhere
  std::vector<Landmark> landmarks;

  size_t size() const { return cameras.size(); }
};

/// The motion at each view: as given, else from the neighbours in time.
std::vector<CameraMotion> MotionsOf(const Bundle& bundle);

/// How the camera's errors move a pixel, px per unit of each.
struct PixelErrors {
  Eigen::Matrix<double, 2, 3> by_parameter = Eigen::Matrix<double, 2, 3>::Zero();  ///< columns: k1, k2, readout
};

/// @param direction to the landmark in the camera's frame, of any length
/// @param inverse_length (length of `direction`) / (distance), with sign: 1 / z where direction.z = 1
PixelErrors PixelErrorsAt(const PinholeCamera& camera, const Eigen::Vector2d& pixel, const ViewPose& pose,
                          const CameraMotion& motion, const Eigen::Vector3d& direction, double inverse_length);

/// The same bundle as a camera without errors would have seen it: pixels freed from them.
Bundle FreedFrom(const CameraErrors& camera, Bundle bundle);

/// Whether a camera hardly moves: its positions lie within a hundredth of the depth, half of what maps may lie apart.
/// They then tell nothing of a scale: that would be one noise over another.
bool Stands(const std::vector<ViewPose>& poses, double depth);

/// Distance of the farthest centre from their mean.
double Extent(const std::vector<ViewPose>& poses);

/// FitSimilarity of the first `count` poses, but with the scale as it is known where the camera stands there.
/// @param depth typical one, in the world of `from`
/// @param known_scale lengths in the world of `to` of what is 1 in that of `from`
Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count,
                         double depth = 0, double known_scale = 1);

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses);

}  // namespace acmp
