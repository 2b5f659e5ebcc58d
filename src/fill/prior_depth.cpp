#include "acmp_mapping/fill/prior_depth.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/geometry/vector_conversion.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

/// Depths within this ratio may be of the same surface, after the fit of scale and shift: so much a network's scale
/// drifts over the image.
constexpr double kSameSurface = 0.1;
/// The same after the fit of the drift: what a network's map deviates within one surface stays below, what lies between
/// two surfaces is above as a rule.
constexpr double kExplained = 0.05;
constexpr size_t kMinKnown = 20;  ///< depths that a fit takes: of fewer half would agree by chance

/// A known depth, and the prior's at its pixel.
struct Pair {
  int col, row;
  double prior;  ///< 1 / z
  double known;  ///< 1 / z
};

/// What 1 / z is said to be a sum of, each with a factor.
using Terms = Eigen::Vector3d;

/// Of a plane, which needs no prior: 1 / z is affine in the pixel.
Terms PlaneTerms(const Pair& pair) { return {1, static_cast<double>(pair.col), static_cast<double>(pair.row)}; }

/// Logarithm of fitted over known depth; infinite where the fit has none.
double DeviationOf(const Eigen::Vector3d& factors, const Terms& terms, const Pair& pair) {
  const double fitted = factors.dot(terms);
  return fitted > 0 ? std::log(pair.known / fitted) : HUGE_VAL;
}

/// A model of the known depths: factors of its terms, and how far it is off.
struct RobustFit {
  Eigen::Vector3d factors = Eigen::Vector3d::Zero();
  double loss = 1;  ///< mean of the squared deviations in units of kSameSurface, each at most 1
};

/// The factors of `count` terms of pairs `used`, by least squares of relative 1 / z; none where they do not tell.
template <class TermsOf, class Used>
std::optional<Eigen::Vector3d> SolveFor(int count, const std::vector<Pair>& pairs, const TermsOf& terms_of,
                                        const Used& used) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Pair& pair : pairs) {
    const Terms terms = terms_of(pair);
    if (!used(terms, pair)) continue;
    const Eigen::Vector3d relative = terms / pair.known;
    normal += relative * relative.transpose();
    right += relative;
  }
  const Eigen::FullPivLU<Eigen::MatrixXd> lu(normal.topLeftCorner(count, count));
  if (!lu.isInvertible()) return std::nullopt;
  Eigen::Vector3d factors = Eigen::Vector3d::Zero();
  factors.head(count) = lu.solve(right.head(count));
  return factors;
}

/// Some of the pairs, evenly.
std::vector<Pair> Thinned(const std::vector<Pair>& pairs, size_t enough) {
  const size_t step = (pairs.size() + enough - 1) / enough;
  std::vector<Pair> some;
  some.reserve(enough);
  for (size_t i = 0; i < pairs.size(); i += step) some.push_back(pairs[i]);
  return some;
}

/// Takes `factors` if they are better.
template <class TermsOf>
void Consider(const std::optional<Eigen::Vector3d>& factors, const std::vector<Pair>& pairs, const TermsOf& terms_of,
              RobustFit* best) {
  if (!factors) return;
  double sum = 0;
  for (const Pair& pair : pairs) {
    const double deviation = DeviationOf(*factors, terms_of(pair), pair) / kSameSurface;
    sum += std::min(deviation * deviation, 1.0);
  }
  const double loss = sum / static_cast<double>(pairs.size());
  if (loss < best->loss) *best = {*factors, loss};
}

/// A fit, refined a few times by least squares over the pairs that agree with it.
template <class TermsOf>
RobustFit Refined(RobustFit best, int count, const std::vector<Pair>& pairs, const TermsOf& terms_of) {
  constexpr int kRounds = 5;
  for (int i = 0; i < kRounds; ++i) {
    const auto agrees = [&](const Terms& terms, const Pair& pair) {
      return std::abs(DeviationOf(best.factors, terms, pair)) < kSameSurface;
    };
    Consider(SolveFor(count, pairs, terms_of, agrees), pairs, terms_of, &best);
  }
  return best;
}

/// The best of fits through as many pairs, drawn at random, as there are terms (the first `count`), refined. Some pairs
/// tell which is best.
template <class TermsOf>
RobustFit FitRobustly(int count, const std::vector<Pair>& pairs, const TermsOf& terms_of) {
  constexpr int kDraws = 300;
  constexpr size_t kJudges = 300;
  constexpr uint32_t kSeed = 1;
  const std::vector<Pair> judges = Thinned(pairs, kJudges);
  RandomStream random(kSeed, 0, static_cast<uint32_t>(count));
  RobustFit best;
  for (int i = 0; i < kDraws; ++i) {
    std::vector<Pair> drawn;
    drawn.reserve(static_cast<size_t>(count));
    for (int k = 0; k < count; ++k) drawn.push_back(pairs[random.NextWord() % pairs.size()]);
    const auto all = [](const Terms&, const Pair&) { return true; };
    Consider(SolveFor(count, drawn, terms_of, all), judges, terms_of, &best);
  }
  RobustFit of_all;
  Consider(best.factors, pairs, terms_of, &of_all);
  return Refined(of_all, count, pairs, terms_of);
}

/// The prior's fit: 1 / z = (shift + scale / prior) * Dot(drift, (1, column, row)).
struct PriorFit {
  double shift = 0, scale = 1;
  Eigen::Vector3d drift = {1, 0, 0};

  Terms DriftTerms(double inverse_prior, int col, int row) const {
    return (shift + scale * inverse_prior) * Terms(1, col, row);
  }
  double Deviation(const Pair& pair) const {
    return DeviationOf(drift, DriftTerms(pair.prior, pair.col, pair.row), pair);
  }
};

/// Scale and shift.
PriorFit FitScale(const std::vector<Pair>& pairs) {
  const RobustFit fit = FitRobustly(2, pairs, [](const Pair& pair) { return Terms(1, pair.prior, 0); });
  return {fit.factors[0], fit.factors[1]};
}

/// How the scale drifts over the image, of `width` x `height`; not at all, where known depths do not tell, or tell that
/// it does so by more than kSameSurface.
Eigen::Vector3d FitDrift(const PriorFit& fit, const std::vector<Pair>& pairs, int width, int height) {
  const auto terms_of = [&](const Pair& pair) { return fit.DriftTerms(pair.prior, pair.col, pair.row); };
  Eigen::Vector3d drift = Refined({fit.drift, 1}, 3, pairs, terms_of).factors;
  for (const int col : {0, width - 1}) {
    for (const int row : {0, height - 1}) {
      if (!(std::abs(drift.dot(Eigen::Vector3d(1, col, row)) - 1) < kSameSurface)) return fit.drift;
    }
  }
  return drift;
}

std::vector<Pair> PairsOf(const ImageView<const float>& prior, const ImageView<const float>& known) {
  std::vector<Pair> pairs;
  for (int row = 0; row < prior.height; ++row) {
    for (int col = 0; col < prior.width; ++col) {
      if (prior(col, row) > 0 && known(col, row) > 0) {
        pairs.push_back({col, row, 1.0 / prior(col, row), 1.0 / known(col, row)});
      }
    }
  }
  return pairs;
}

/// Why the fitted external depth is useless; empty: it is not. It must explain half of the known depths that the best
/// plane does not explain. True maps, with all kinds of faults, explain 0.42 of them and more, maps of other images
/// 0.39 at most (0.25 as a rule), constant maps, ramps and noise next to nothing. And it must explain a third of all
/// known depths: a weak network may get one second surface right alone. Where the plane explains nearly everything, so
/// must the external depth.
std::string WhyUseless(const PriorFit& fit, const std::vector<Pair>& pairs) {
  constexpr double kEnough = 0.5, kOfAll = 1.0 / 3, kNearlyAll = 0.9, kHardlyAny = 0.01;
  const RobustFit plane = FitRobustly(3, pairs, PlaneTerms);
  size_t explained = 0, off_plane = 0, explained_off_plane = 0;
  for (const Pair& pair : pairs) {
    const bool is_explained = fit.scale > 0 && std::abs(fit.Deviation(pair)) < kExplained;
    const bool is_off_plane = !(std::abs(DeviationOf(plane.factors, PlaneTerms(pair), pair)) < kExplained);
    explained += is_explained ? 1 : 0;
    off_plane += is_off_plane ? 1 : 0;
    explained_off_plane += is_explained && is_off_plane ? 1 : 0;
  }
  const auto share = [](size_t part, size_t all) { return static_cast<double>(part) / static_cast<double>(all); };
  const auto refusal = [](double explains, const char* which, double least) {
    return Concat("it explains ", 100 * explains, " % of the known depths", which, ": must be at least ", 100 * least,
                  " %");
  };
  const double of_all = share(explained, pairs.size());
  if (share(off_plane, pairs.size()) < kHardlyAny) {
    return of_all < kNearlyAll ? refusal(of_all, ", which all lie on a plane", kNearlyAll) : "";
  }
  if (of_all < kOfAll) return refusal(of_all, "", kOfAll);
  const double off = share(explained_off_plane, off_plane);
  return off < kEnough ? refusal(off, " that no plane explains", kEnough) : "";
}

/// Sums over cells, for those over any rectangle of cells.
class CellSums {
 public:
  CellSums(int cols, int rows) : sums_(cols + 1, rows + 1) {}

  void Add(int col, int row, double value) { sums_(col + 1, row + 1) += value; }
  void Integrate() {
    for (int row = 1; row < sums_.height(); ++row) {
      for (int col = 1; col < sums_.width(); ++col) {
        sums_(col, row) += sums_(col - 1, row) + sums_(col, row - 1) - sums_(col - 1, row - 1);
      }
    }
  }
  /// Over the square of cells around one.
  double Around(int col, int row, int radius) const {
    const int left = std::max(col - radius, 0), right = std::min(col + radius + 1, sums_.width() - 1);
    const int top = std::max(row - radius, 0), bottom = std::min(row + radius + 1, sums_.height() - 1);
    return sums_(right, bottom) - sums_(left, bottom) - sums_(right, top) + sums_(left, top);
  }

 private:
  Image<double> sums_;
};

/// By which the fitted depths are to be multiplied, per cell; 0: not to be used.
Image<float> FitSurroundings(const PriorFit& fit, const std::vector<Pair>& pairs, int width, int height, int cell_size,
                             bool metric) {
  // Cells around that count. The scale changes slowly; what is wrong may be small.
  constexpr int kScaleRadius = 20, kWrongRadius = 12;
  const int cols = CellsOf(width, cell_size), rows = CellsOf(height, cell_size);
  const double few = cell_size * cell_size;  // so many count as one that agrees with the fit of the whole image
  CellSums count(cols, rows), agreeing(cols, rows), deviation(cols, rows);
  for (const Pair& pair : pairs) {
    const int col = pair.col / cell_size, row = pair.row / cell_size;
    const double d = fit.Deviation(pair);
    count.Add(col, row, 1);
    if (!(std::abs(d) < kExplained)) continue;
    agreeing.Add(col, row, 1);
    deviation.Add(col, row, d);
  }
  for (CellSums* sums : {&count, &agreeing, &deviation}) sums->Integrate();
  Image<float> factors(cols, rows);
  for (int row = 0; row < rows; ++row) {
    for (int col = 0; col < cols; ++col) {
      if (2 * agreeing.Around(col, row, kWrongRadius) < count.Around(col, row, kWrongRadius)) continue;
      const double mean = deviation.Around(col, row, kScaleRadius) / (agreeing.Around(col, row, kScaleRadius) + few);
      factors(col, row) = metric ? 1 : static_cast<float>(std::exp(-mean));
    }
  }
  return factors;
}

/// Depths that views confirm, after FillUnverified, and of landmarks; 0 elsewhere.
DepthMap KnownDepths(const Frame& frame, bool with_landmarks, const ImageView<const float>& cost,
                     const ImageView<PlaneHypothesis>& planes) {
  const RayGrid rays = MakeRayGrid(frame.camera);
  DepthMap known(planes.width, planes.height);
  for (const Eigen::Vector3d& landmark : frame.landmarks_in_world) {
    if (!with_landmarks) break;
    const double z = DepthInView(landmark, frame.camera, frame.cam_from_world);
    if (!(z > 0)) continue;
    const Eigen::Vector2d pixel = frame.camera.Project(frame.cam_from_world * landmark);
    const int col = std::clamp(static_cast<int>(std::lround(pixel.x())), 0, known.width() - 1);
    const int row = std::clamp(static_cast<int>(std::lround(pixel.y())), 0, known.height() - 1);
    known(col, row) = static_cast<float>(z);
  }
  ForEachPixel(known.width(), known.height(), [&](int col, int row) {
    if (!(planes(col, row).d > 0) || IsFilled(cost(col, row))) return;
    known(col, row) = PlaneDepth(planes(col, row), rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  });
  return known;
}

}  // namespace

FittedPriorDepth FitPriorDepth(ImageView<const float> prior, ImageView<const float> known, const DepthRange& range,
                               const PriorDepthOptions& options) {
  constexpr int kCellsAcross = 100;
  CheckDepthRange("depth range of the prior depth", range);
  const std::vector<Pair> pairs = PairsOf(prior, known);
  PriorFit fit;
  if (pairs.size() < kMinKnown) {
    const char* few = " of its pixels have a known depth to fit it to: must be at least ";
    if (!options.metric) return {{}, Concat("only ", pairs.size(), few, kMinKnown)};
  } else {
    constexpr size_t kEnough = 2000;  // a fit needs no more
    const std::vector<Pair> some = Thinned(pairs, kEnough);
    if (!options.metric) fit = FitScale(some);
    if (std::string reason = WhyUseless(fit, some); !reason.empty()) return {{}, std::move(reason)};
    if (!options.metric) fit.drift = FitDrift(fit, some, prior.width, prior.height);
  }
  const int cell_size = SizeOfCells(prior.width, prior.height, kCellsAcross);
  const Image<float> factors = FitSurroundings(fit, pairs, prior.width, prior.height, cell_size, options.metric);
  FittedPriorDepth fitted = {DepthMap(prior.width, prior.height), {}};
  ForEachPixel(prior.width, prior.height, [&](int col, int row) {
    if (!(prior(col, row) > 0)) return;
    const double inverse = fit.drift.dot(fit.DriftTerms(1.0 / prior(col, row), col, row));
    const float z = static_cast<float>(factors(col / cell_size, row / cell_size) / inverse);
    if (inverse > 0 && z >= range.min && z <= range.max) fitted.depth(col, row) = z;
  });
  return fitted;
}

PlaneHypothesis PlaneOfPixel(ImageView<const float> depth, const RayGrid& rays, int col, int row) {
  constexpr int kRadius = 3;
  constexpr float kSame = 0.03f;      // relative difference of depths within one surface and this radius
  constexpr double kMinCosine = 0.1;  // between normal and ray: steeper planes are edges
  const float z = depth(col, row);
  if (!(z > 0)) return {};
  const auto ray_of = [&](int c, int r) { return ToEigen(rays.Ray(static_cast<float>(c), static_cast<float>(r))); };
  // On a plane 1 / z = dual . ray, and the normal is along the dual vector.
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (int r = std::max(row - kRadius, 0); r <= std::min(row + kRadius, depth.height - 1); ++r) {
    for (int c = std::max(col - kRadius, 0); c <= std::min(col + kRadius, depth.width - 1); ++c) {
      if (!(std::abs(depth(c, r) - z) < kSame * z)) continue;
      const Eigen::Vector3d ray = ray_of(c, r);
      normal += ray * ray.transpose();
      right += ray / depth(c, r);
    }
  }
  const Eigen::Vector3d ray = ray_of(col, row).normalized();
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(normal);
  Eigen::Vector3d dual = lu.isInvertible() ? Eigen::Vector3d(lu.solve(right).normalized()) : ray;
  if (!(dual.dot(ray) > kMinCosine)) dual = ray;
  return PlaneThrough(ToVec3f(-dual), rays.Ray(static_cast<float>(col), static_cast<float>(row)), z);
}

std::string UsePriorDepth(const Frame& frame, bool in_scale_of_frame, const DepthRange& range,
                          PriorDepthOptions options, ImageView<const float> cost, ImageView<PlaneHypothesis> planes) {
  if (frame.prior_depth.empty()) return {};
  options.metric = options.metric && in_scale_of_frame;
  const DepthMap known = KnownDepths(frame, in_scale_of_frame, cost, planes);
  FittedPriorDepth fitted = FitPriorDepth(frame.prior_depth, known, range, options);
  if (fitted.depth.empty()) return std::move(fitted.rejection);
  const RayGrid rays = MakeRayGrid(frame.camera);
  ForEachPixel(planes.width, planes.height, [&](int col, int row) {
    if (!(planes(col, row).d > 0 && cost(col, row) >= kWorstCost)) return;
    const PlaneHypothesis plane = PlaneOfPixel(fitted.depth, rays, col, row);
    if (plane.d > 0) planes(col, row) = plane;
  });
  return {};
}

}  // namespace acmp
