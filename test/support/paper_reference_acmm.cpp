#include <algorithm>
#include <cmath>

#include "support/paper_reference.h"

namespace acmp::paper {

/// Joint bilateral upsampling: the mean of the coarser scale's depths in 5 x 5 px, weighted by distance (deviation
/// 0.5 px there) and by difference of grey values here (a tenth of their range). The normal is that of the pixel that
/// covers this one; it faces the camera where that does not.
Reference::Hypothesis Reference::Upsample(const PlaneMap& coarser, int col, int row) {
  const ImageView<const float>& gray = problem_.reference.gray;
  const PinholeCamera camera = problem_.reference.camera.Halved();
  const Eigen::Vector2d place((col + 0.5) / 2 - 0.5, (row + 0.5) / 2 - 0.5);
  const Eigen::Vector2i covering(std::min(col / 2, camera.width - 1), std::min(row / 2, camera.height - 1));
  double sum = 0, total = 0;
  for (int r = covering.y() - 2; r <= covering.y() + 2; ++r) {
    for (int c = covering.x() - 2; c <= covering.x() + 2; ++c) {
      if (!coarser.View().Contains(c, r) || !(coarser(c, r).d > 0)) continue;
      const double distance = (Eigen::Vector2d(c, r) - place).norm() / 0.5;
      const double difference = (static_cast<double>(gray(2 * c, 2 * r)) - gray(col, row)) / 25.5;
      const double weight = std::exp(-distance * distance / 2) * std::exp(-difference * difference / 2);
      sum += weight * reference::Intersect(camera, {1.0 * c, 1.0 * r}, reference::ToDouble(coarser(c, r))).z();
      total += weight;
    }
  }
  const double depth = std::clamp<double>(sum / total, problem_.depth_range.min, problem_.depth_range.max);
  const Eigen::Vector3d normal = reference::ToDouble(coarser(covering.x(), covering.y())).normal;
  const bool is_facing = Less(normal.dot(Ray(col, row)), 0, 1e-6);
  return Through(is_facing ? normal : Eigen::Vector3d(0, 0, -1), depth, col, row);
}

Outcome Reference::Restore(const Maps& maps, const PlaneMap& coarser, int col, int row) {
  constexpr double kXi = 0.1;
  StartPixel();
  Outcome outcome = RateByBestViews(Upsample(coarser, col, row), col, row);
  const double own = maps.cost(col, row);
  if (Less(kXi, outcome.cost - own, kCostTolerance)) {  // a detail that the coarser scale does not have
    outcome.plane = reference::ToDouble(maps.planes(col, row));
    outcome.cost = own;
  }
  outcome.views = maps.views(col, row);
  return Done(outcome);
}

}  // namespace acmp::paper
