#pragma once

#include <Eigen/Core>

#include "acmp_mapping/geometry/plane_hypothesis.h"
#include "acmp_mapping/patch_match/patch_match_options.h"
#include "acmp_mapping/patch_match/patch_match_problem.h"

namespace acmp::reference {

/// The paper's formulas in plain double arithmetic, for tests. Nothing here shares code or shortcuts with the kernels:
/// window samples are intersected with the plane one by one and projected by the cameras, sums are centred in two
/// passes.

/// n.X + d = 0 in the reference camera's frame.
struct Plane {
  Eigen::Vector3d normal;
  double d;
};
Plane ToDouble(const PlaneHypothesis& plane);

/// Point where the ray through a pixel of the camera meets the plane; its z may be negative or not finite.
Eigen::Vector3d Intersect(const PinholeCamera& camera, const Eigen::Vector2d& pixel, const Plane& plane);

/// Bilinear value, positions clamped to the image.
double SampleBilinear(const ImageView<const float>& image, double x, double y);

/// Pixel in `target` of the plane's point seen at a pixel of `source`; `z` is its depth in the target.
Eigen::Vector2d Transfer(const MatchView& source, const MatchView& target, const Plane& plane,
                         const Eigen::Vector2d& pixel, double* z);

/// Why a cost is what it is: windows without texture and points without correspondence have fixed costs.
enum class CostKind { kMatched, kNoCorrespondence, kFlatReference, kFlatSource };

struct Cost {
  CostKind kind;
  double value;               ///< 1 - NCC limited to 0..2, if matched
  double reference_variance;  ///< weighted, grey levels^2
  double source_variance;
  double
      min_z;  ///< least ratio of the window's depths in the source and the reference: the homography's third component
};

/// m_ij of eq. 1 at a pixel. The 36 samples lie at every second pixel of the 11 x 11 window; samples outside the
/// reference image do not count.
Cost PhotometricCost(const PatchMatchProblem& problem, const PatchMatchOptions& options, const Plane& plane, int col,
                     int row, int view);

/// Whether the inverse depth of a pixel's plane differs from the mean of those of two opposite pixels, each with its
/// own plane, 5 px away by more than half of edge_bend, relative. Pairs that are not wholly in the image do not count.
bool IsSurfaceBroken(const PinholeCamera& camera, const PlaneMap& planes, const PatchMatchOptions& options, int col,
                     int row);

/// delta e_j of eq. 13 before truncation, with halved depths; infinite where it does not exist.
double ReprojectionError(const PatchMatchProblem& problem, double depth, int col, int row, int view);

}  // namespace acmp::reference
