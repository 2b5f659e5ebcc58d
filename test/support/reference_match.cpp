#include "support/reference_match.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace acmp::reference {
namespace {

/// X in the world of a point in the view's camera frame and back.
Eigen::Vector3d ToWorld(const MatchView& view, const Eigen::Vector3d& point_in_cam) {
  return view.cam_from_world.inverse() * point_in_cam;
}

struct Sample {
  double weight, reference, source;
};

/// Weighted variances and covariance, centred in a second pass.
struct Moments {
  explicit Moments(const std::vector<Sample>& samples) {
    double weights = 0, mean_reference = 0, mean_source = 0;
    for (const Sample& s : samples) {
      weights += s.weight;
      mean_reference += s.weight * s.reference;
      mean_source += s.weight * s.source;
    }
    mean_reference /= weights;
    mean_source /= weights;
    for (const Sample& s : samples) {
      const double share = s.weight / weights;
      reference_variance += share * (s.reference - mean_reference) * (s.reference - mean_reference);
      source_variance += share * (s.source - mean_source) * (s.source - mean_source);
      covariance += share * (s.reference - mean_reference) * (s.source - mean_source);
    }
  }
  double reference_variance = 0, source_variance = 0, covariance = 0;
};

bool InsideImage(const PinholeCamera& camera, const Eigen::Vector2d& pixel) {
  return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() < camera.width - 0.5 && pixel.y() < camera.height - 0.5;
}

/// exp(-r / (2 s_r^2) - |dI| / (2 s_c^2)).
double BilateralWeight(double distance_px, double gray_difference, const PatchMatchOptions& options) {
  const double spatial = options.sigma_spatial_px, color = options.sigma_color;
  return std::exp(-distance_px / (2 * spatial * spatial) - std::abs(gray_difference) / (2 * color * color));
}

/// Depth of the 2 x 2 px that hold a pixel: the harmonic mean of the known ones if they agree within 2 %, else of the
/// two whose inverses are closest; of only two the nearer. 0: none is known.
double HalvedDepthAt(const ImageView<const float>& depth, int col, int row) {
  std::vector<double> inverse;
  for (int r = row / 2 * 2; r < std::min(row / 2 * 2 + 2, depth.height); ++r) {
    for (int c = col / 2 * 2; c < std::min(col / 2 * 2 + 2, depth.width); ++c) {
      if (depth(c, r) > 1e-30f) inverse.push_back(1.0 / depth(c, r));
    }
  }
  if (inverse.empty()) return 0;
  std::sort(inverse.begin(), inverse.end());
  if (inverse.size() == 1 || inverse.back() <= 1.02 * inverse.front()) {
    return static_cast<double>(inverse.size()) / std::accumulate(inverse.begin(), inverse.end(), 0.0);
  }
  if (inverse.size() == 2) return 1 / inverse.back();
  double gap = std::numeric_limits<double>::infinity(), sum = 0;
  for (size_t i = 0; i + 1 < inverse.size(); ++i) {
    if (!(inverse[i + 1] - inverse[i] < gap)) continue;
    gap = inverse[i + 1] - inverse[i];
    sum = inverse[i + 1] + inverse[i];
  }
  return 2 / sum;
}

/// Inverse depth of the halved map at a position of the full image: bilinear if the four around it agree within 5 %,
/// else the nearest. 0: unknown.
double InverseDepthAt(const ImageView<const float>& depth, const Eigen::Vector2d& position) {
  const auto block = [&](double col, double row) {  // pixels of the halved map; outside are those at the border
    const double z = HalvedDepthAt(depth, static_cast<int>(std::min(std::max(2 * col, 0.0), depth.width - 1.0)),
                                   static_cast<int>(std::min(std::max(2 * row, 0.0), depth.height - 1.0)));
    return z > 0 ? 1 / z : 0;
  };
  const Eigen::Vector2d halved = 0.5 * (position.array() - 0.5);
  const double left = std::floor(halved.x()), top = std::floor(halved.y());
  const double right_share = halved.x() - left, bottom_share = halved.y() - top;
  const double corners[] = {block(left, top), block(left + 1, top), block(left, top + 1), block(left + 1, top + 1)};
  const auto [least, greatest] = std::minmax_element(std::begin(corners), std::end(corners));
  if (*greatest > 1.05 * *least) return block(std::floor(halved.x() + 0.5), std::floor(halved.y() + 0.5));
  return (1 - bottom_share) * ((1 - right_share) * corners[0] + right_share * corners[1]) +
         bottom_share * ((1 - right_share) * corners[2] + right_share * corners[3]);
}

}  // namespace

Plane ToDouble(const PlaneHypothesis& plane) { return {{plane.nx, plane.ny, plane.nz}, plane.d}; }

Eigen::Vector3d Intersect(const PinholeCamera& camera, const Eigen::Vector2d& pixel, const Plane& plane) {
  const Eigen::Vector3d ray((pixel.x() - camera.cx) / camera.fx, (pixel.y() - camera.cy) / camera.fy, 1.0);
  return -plane.d / plane.normal.dot(ray) * ray;
}

double SampleBilinear(const ImageView<const float>& image, double x, double y) {
  x = std::clamp(x, 0.0, image.width - 1.0);
  y = std::clamp(y, 0.0, image.height - 1.0);
  // Tent weights of the four pixels around the position; those beyond the border have weight zero.
  double sum = 0;
  for (int row = static_cast<int>(y); row <= std::min(static_cast<int>(y) + 1, image.height - 1); ++row) {
    for (int col = static_cast<int>(x); col <= std::min(static_cast<int>(x) + 1, image.width - 1); ++col) {
      sum += (1 - std::abs(col - x)) * (1 - std::abs(row - y)) * image(col, row);
    }
  }
  return sum;
}

Eigen::Vector2d Transfer(const MatchView& source, const MatchView& target, const Plane& plane,
                         const Eigen::Vector2d& pixel, double* z) {
  const Eigen::Vector3d point = target.cam_from_world * ToWorld(source, Intersect(source.camera, pixel, plane));
  *z = point.z();
  return {target.camera.fx * point.x() / point.z() + target.camera.cx,
          target.camera.fy * point.y() / point.z() + target.camera.cy};
}

bool IsSurfaceBroken(const PinholeCamera& camera, const PlaneMap& planes, const PatchMatchOptions& options, int col,
                     int row) {
  const auto inverse_depth = [&](int x, int y) {
    return 1 / Intersect(camera, Eigen::Vector2d(x, y), ToDouble(planes(x, y))).z();
  };
  for (const Eigen::Vector2i& step : {Eigen::Vector2i(5, 0), {0, 5}, {4, 3}, {4, -3}}) {
    const int dx = step.x(), dy = step.y();
    if (!planes.View().Contains(col + dx, row + dy) || !planes.View().Contains(col - dx, row - dy)) continue;
    const double mean = (inverse_depth(col + dx, row + dy) + inverse_depth(col - dx, row - dy)) / 2;
    const double own = inverse_depth(col, row);
    if (std::abs(mean - own) > options.edge_bend / 2 * own) return true;
  }
  return false;
}

Cost PhotometricCost(const PatchMatchProblem& problem, const PatchMatchOptions& options, const Plane& plane, int col,
                     int row, int view) {
  const MatchView& reference = problem.reference;
  const MatchView& source = problem.sources[view];
  Cost cost = {CostKind::kNoCorrespondence, 2.0, 0, 0, std::numeric_limits<double>::infinity()};
  const RigidTransform source_from_reference = source.cam_from_world * reference.cam_from_world.inverse();
  const Eigen::Vector3d center = source_from_reference * Intersect(reference.camera, Eigen::Vector2d(col, row), plane);
  const bool visible = center.z() > 0 && InsideImage(source.camera, source.camera.Project(center));

  std::vector<Sample> samples;
  samples.reserve(36);
  for (int dy = -5; dy <= 5; dy += 2) {
    for (int dx = -5; dx <= 5; dx += 2) {
      const Eigen::Vector2d pixel(col + dx, row + dy);
      const Eigen::Vector3d point = Intersect(reference.camera, pixel, plane);
      const Eigen::Vector3d in_source = source_from_reference * point;
      cost.min_z = std::min(cost.min_z, in_source.z() / point.z());
      if (!reference.gray.Contains(col + dx, row + dy)) continue;
      const double value = reference.gray(col + dx, row + dy);
      const double weight = BilateralWeight(std::hypot(dx, dy), value - reference.gray(col, row), options);
      const Eigen::Vector2d target = source.camera.Project(in_source);
      samples.push_back({weight, value, SampleBilinear(source.gray, target.x(), target.y())});
    }
  }
  if (!visible) return cost;
  if (samples.empty()) return {CostKind::kFlatReference, 1.0, 0, 0, cost.min_z};
  const Moments moments(samples);
  cost.reference_variance = moments.reference_variance;
  cost.source_variance = moments.source_variance;
  if (cost.reference_variance < options.min_variance) {
    cost.kind = CostKind::kFlatReference;
    cost.value = 1.0;
  } else if (cost.source_variance < options.min_variance) {
    cost.kind = CostKind::kFlatSource;
    cost.value = 2.0;
  } else {
    cost.kind = CostKind::kMatched;
    cost.value =
        std::clamp(1 - moments.covariance / std::sqrt(cost.reference_variance * cost.source_variance), 0.0, 2.0);
  }
  return cost;
}

double ReprojectionError(const PatchMatchProblem& problem, double depth, int col, int row, int view) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const MatchView& reference = problem.reference;
  const MatchView& source = problem.sources[view];
  if (source.depth.empty()) return kNone;
  const Eigen::Vector2d pixel(col, row);
  const Eigen::Vector3d in_source =
      source.cam_from_world * ToWorld(reference, reference.camera.Unproject(pixel, depth));
  if (!(in_source.z() > 0)) return kNone;
  const Eigen::Vector2d forward = source.camera.Project(in_source);
  if (!InsideImage(source.camera, forward)) return kNone;
  const double inverse = InverseDepthAt(source.depth, forward);
  if (!(inverse > 0)) return kNone;
  const Eigen::Vector3d back =
      reference.cam_from_world * ToWorld(source, source.camera.Unproject(forward, 1 / inverse));
  if (!(back.z() > 0)) return kNone;
  return (reference.camera.Project(back) - pixel).norm();
}

}  // namespace acmp::reference
