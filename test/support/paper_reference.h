#pragma once

#include <algorithm>
#include <cmath>
#include <numeric>

#include <Eigen/Geometry>

#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "support/reference_match.h"

namespace acmp::paper {

/// Algorithm 1 of the ACMP paper, one pixel at a time in plain double arithmetic, with the view weights of ACMH in its
/// photometric pass, and ACMM's step between two scales; and what the presets of our own do otherwise. It shares no
/// code with the kernels; the random numbers' definition is written down again.

/// What a pixel reads, as the pass has left it so far.
struct Maps {
  const PlaneMap& planes;
  const CostMap& cost;
  const Image<uint32_t>& views;  ///< of ACMH the one view that weighed most
  PriorMap prior;                ///< zero planes: none
};

/// What a pixel becomes.
struct Outcome {
  reference::Plane plane;
  double cost = 2;            ///< that of no view seeing it
  double cost_tolerance = 0;  ///< what rounding to float may change the cost by
  uint32_t views = 0;
  bool is_near_tie = false;  ///< some comparison on the way was so close that rounding to float may decide it otherwise
};

/// One pass over one problem. `problem` and `options` must outlive it.
class Reference {
 public:
  /// @param pass number of the pass for its random numbers: 0 photometric, 1 planar prior, 2 and more geometric
  Reference(const PatchMatchProblem& problem, const PatchMatchOptions& options, Pass stage, uint32_t pass)
      : problem_(problem),
        options_(options),
        stage_(stage),
        weighs_as_acmh_(!IsOurs() && (stage == Pass::kPhotometric || options.method == Method::kAcmh)),
        pass_(pass),
        width_(problem.reference.camera.width),
        height_(problem.reference.camera.height) {}

  /// Steps 3, 14, or the start of steps 22-30.
  Outcome Initialize(const Maps& maps, int col, int row) {
    StartPixel();
    return RateByBestViews(Start(maps, col, row), col, row);
  }

  /// The same in ours for a pixel that is updated first: without a comparison.
  Outcome InitializeUnmatched(const Maps& maps, int col, int row) {
    StartPixel();
    return Done({Start(maps, col, row).plane});
  }

  /// Steps 5-7, 16-18 or 25-27 in iteration 0, 1, ...
  Outcome Update(const Maps& maps, int col, int row, int iteration) {
    StartPixel();
    Random random(options_.seed, static_cast<uint32_t>(row * width_ + col),
                  pass_ * 64 + static_cast<uint32_t>(iteration) + 1);

    // Hypothesis sampling and propagation. Later passes of ours: from near and far regions in turns, by blocks of 2 x 2
    // px.
    const bool in_turns = IsOurs() && stage_ != Pass::kPhotometric;
    const bool is_far = (static_cast<uint32_t>(col / 2 + row / 2 + iteration) + pass_) % 2 != 0;
    const Regions regions = in_turns ? Regions{is_far ? 4u : 0u, 4} : Regions{0, 8};
    const uint32_t views = in_turns ? ViewsOfNeighbours(maps, col, row) : ~0u;
    if (in_turns && IsSurfaceBroken(maps, col, row)) window_options_.sigma_color = options_.edge_sigma_color;
    std::vector<Hypothesis> candidates = Propagate(maps, col, row, regions);
    candidates.push_back(At(reference::ToDouble(maps.planes(col, row)), col, row));  // theta_0
    std::vector<std::vector<double>> costs;
    for (const Hypothesis& candidate : candidates) costs.push_back(MatchingCosts(candidate, views, col, row));

    // View weights.
    const std::vector<double> weights =
        weighs_as_acmh_ ? WeighAsAcmh(costs, maps.views(col, row), iteration)
        : IsOurs()      ? WeighAsOurs(costs, maps, views, in_turns ? 2 : 3, col, row, iteration, &random)
                        : WeighAsAcmp(costs, maps, col, row, &random);
    Outcome outcome = {candidates.back().plane};
    for (size_t view = 0; view < weights.size(); ++view) outcome.views |= (weights[view] > 0 ? 1u : 0u) << view;
    if (outcome.views == 0) return Done(outcome);
    const uint32_t weighed = outcome.views;
    if (weighs_as_acmh_) {
      size_t most = 0;
      for (size_t view = 1; view < weights.size(); ++view) {
        if (Less(weights[most], weights[view], kCostTolerance)) most = view;
      }
      outcome.views = 1u << most;
    }

    // Hypothesis updating. The pixel's own plane wins ties.
    Hypothesis best = candidates.back();
    Rating rating = Rate(best, costs.back(), weights, maps, col, row);
    for (size_t i = 0; i + 1 < candidates.size(); ++i) {
      const Rating other = Rate(candidates[i], costs[i], weights, maps, col, row);
      if (!Less(other.energy, rating.energy, kCostTolerance)) continue;
      best = candidates[i];
      rating = other;
    }

    for (const auto& [depth, normal] : Refinements(best, maps, col, row, iteration, &random)) {
      if (!InRange(depth)) continue;
      const Hypothesis hypothesis = Through(normal, depth, col, row);
      const Rating other = Rate(hypothesis, MatchingCosts(hypothesis, weighed, col, row), weights, maps, col, row);
      if (!Less(other.energy, rating.energy, kCostTolerance)) continue;
      best = hypothesis;
      rating = other;
    }
    outcome.plane = best.plane;
    outcome.cost = rating.cost;
    return Done(outcome);
  }

  /// Ours after the last iteration: the plane is moved to the median depth over the pixel, those of the other colour
  /// within 3 px, that is, the 16 nearest, and four 5 px along the axes; of their own depths, or of those of their
  /// planes here, where the middle half of these is narrower.
  Outcome Filter(const Maps& maps, int col, int row) {
    StartPixel();
    constexpr double kFar = 1e30;  // of a plane that leaves the depth range
    std::vector<double> own, extended;
    for (int dy = -5; dy <= 5; ++dy) {
      for (int dx = -5; dx <= 5; ++dx) {
        const bool is_self = dx == 0 && dy == 0, is_axis_end = dx * dy == 0 && dx * dx + dy * dy == 25;
        const bool is_near_of_other_color = (dx + dy) % 2 != 0 && dx * dx + dy * dy <= 9;
        if (!is_self && !is_near_of_other_color && !is_axis_end) continue;
        if (!maps.planes.View().Contains(col + dx, row + dy)) continue;
        const reference::Plane plane = reference::ToDouble(maps.planes(col + dx, row + dy));
        own.push_back(At(plane, col + dx, row + dy).depth);
        const double depth = At(plane, col, row).depth;
        extended.push_back(InRange(depth) ? depth : kFar);
      }
    }
    const auto at = [](std::vector<double>* depths, size_t quarters) {
      std::sort(depths->begin(), depths->end());
      return (*depths)[quarters * depths->size() / 4];  // of an even number the upper middle one
    };
    const bool keeps_slope =
        at(&extended, 2) < kFar && Less(at(&extended, 3) - at(&extended, 1), at(&own, 3) - at(&own, 1), 1e-5);
    const Eigen::Vector3d normal = reference::ToDouble(maps.planes(col, row)).normal;
    Outcome outcome = {Through(normal, at(keeps_slope ? &extended : &own, 2), col, row).plane};
    outcome.cost = maps.cost(col, row);
    outcome.views = maps.views(col, row);
    return Done(outcome);
  }

  /// ACMM's detail restorer after a photometric pass; leaves the views as they are.
  /// @param coarser estimate of the next coarser scale, whose camera is the problem's halved
  Outcome Restore(const Maps& maps, const PlaneMap& coarser, int col, int row) {
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

 private:
  static constexpr double kPi = 3.14159265358979323846;
  static constexpr double kRadPerDeg = kPi / 180;
  static constexpr double kWorst = 2;  // of a view that does not see the point

  // Differences below which float arithmetic may decide otherwise; see kCostTolerance. At the least variance of 0.01
  // costs are off by up to 2.2e-3, where a window reaches over an edge: positions that are off by 1e-5 px change its
  // grey values by a hundredth of its deviation. Random draws: 24 bits times a sum of some probabilities.
  static constexpr double kWeakVariance = 0.02, kWeakCostTolerance = 3e-3;
  static constexpr double kDrawTolerance = 2e-4;
  static constexpr double kPixelTolerance = 2e-3;
  static constexpr double kRelativeDepthTolerance = 2e-6;
  /// Differences of costs below which float arithmetic may decide otherwise: measured over these tests, normalised
  /// correlations in float are off by up to 3e-5 where windows have a variance of 0.02 grey levels^2 or more.
  static constexpr double kCostTolerance = 3e-4;

  struct Hypothesis {
    reference::Plane plane;
    double depth;  ///< at the pixel
  };
  struct Rating {
    double cost;    ///< eq. 1 or 13
    double energy;  ///< eq. 1, 7 or 13
  };
  struct Regions {
    size_t first, count;
  };

  /// The n-th number is a function of seed, pixel, step and n alone: PCG hashes of their sums.
  class Random {
   public:
    Random(uint32_t seed, uint32_t pixel, uint32_t step) : key_(Hash(Hash(Hash(seed) + pixel) + step)) {}
    /// In [0, 1), of 24 bits.
    double operator()() { return (Hash(key_ + 0x9e3779b9u * drawn_++) >> 8) / 16777216.0; }
    double operator()(double low, double high) { return low + (high - low) * (*this)(); }

   private:
    static uint32_t Hash(uint32_t x) {
      const uint32_t state = x * 747796405u + 2891336453u;
      const uint32_t word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737u;
      return (word >> 22) ^ word;
    }
    uint32_t key_, drawn_ = 0;
  };

  Outcome Done(Outcome outcome) const {
    outcome.cost_tolerance = least_variance_ < kWeakVariance ? kWeakCostTolerance : kCostTolerance;
    outcome.is_near_tie = is_near_tie_;
    return outcome;
  }

  bool Less(double a, double b, double tolerance) {
    NearTieIf(std::abs(a - b) < tolerance);
    return a < b;
  }

  bool InRange(double depth) {
    const double low = problem_.depth_range.min, high = problem_.depth_range.max;
    return !Less(depth, low, kRelativeDepthTolerance * low) && !Less(high, depth, kRelativeDepthTolerance * high);
  }

  Eigen::Vector3d Ray(int col, int row) const {
    return problem_.reference.camera.Unproject({1.0 * col, 1.0 * row}, 1.0);
  }

  Hypothesis At(const reference::Plane& plane, int col, int row) const {
    return {plane, reference::Intersect(problem_.reference.camera, {1.0 * col, 1.0 * row}, plane).z()};
  }

  Hypothesis Through(const Eigen::Vector3d& normal, double depth, int col, int row) const {
    return {{normal, -depth * normal.dot(Ray(col, row))}, depth};
  }

  double RandomDepth(Random* random) const {
    const double low = problem_.depth_range.min, high = problem_.depth_range.max;
    return 1 / ((*random)(1 / low, 1 / high));
  }

  Eigen::Vector3d RandomNormal(const Eigen::Vector3d& ray, Random* random) const {
    const double z = (*random)(-1, 1), angle = (*random)(0, 2 * kPi);
    const double radius = std::sqrt(1 - z * z);
    const Eigen::Vector3d normal(radius * std::cos(angle), radius * std::sin(angle), z);
    return normal.dot(ray) < 0 ? normal : Eigen::Vector3d(-normal);
  }

  Eigen::Vector3d PerturbNormal(const Eigen::Vector3d& normal, const Eigen::Vector3d& ray, double most,
                                Random* random) {
    const double x = (*random)(-most, most), y = (*random)(-most, most), z = (*random)(-most, most);
    const Eigen::Vector3d turned =
        Eigen::AngleAxisd(z, Eigen::Vector3d::UnitZ()) *
        (Eigen::AngleAxisd(y, Eigen::Vector3d::UnitY()) * (Eigen::AngleAxisd(x, Eigen::Vector3d::UnitX()) * normal));
    return Less(turned.dot(ray), 0, 1e-6) ? turned : normal;
  }

  double MatchingCost(const Hypothesis& hypothesis, int col, int row, int view) {
    const reference::Cost cost =
        reference::PhotometricCost(problem_, window_options_, hypothesis.plane, col, row, view);
    const PinholeCamera& camera = problem_.sources[view].camera;
    double z;
    const Eigen::Vector2d center =
        reference::Transfer(problem_.reference, problem_.sources[view], hypothesis.plane, {1.0 * col, 1.0 * row}, &z);
    for (const double border : {center.x() + 0.5, center.y() + 0.5, camera.width - 0.5 - center.x(),
                                camera.height - 0.5 - center.y(), cost.min_z}) {
      Less(border, 0, kPixelTolerance);
    }
    // A window that reaches behind the source's camera shows nothing.
    if (!(cost.min_z > 0) || cost.kind == reference::CostKind::kNoCorrespondence) return kWorst;
    least_variance_ = std::min({least_variance_, cost.reference_variance, cost.source_variance});
    Less(cost.reference_variance, options_.min_variance, 0.1 * options_.min_variance);
    Less(cost.source_variance, options_.min_variance, 0.1 * options_.min_variance);
    return cost.value;
  }

  /// Delta e_j of eq. 13, truncated.
  double ReprojectionError(const Hypothesis& hypothesis, int col, int row, int view) {
    const double worst = options_.geometric_max_px;
    if (IsOurs()) {
      const auto error = [&](double factor) {
        return std::min(worst, reference::ReprojectionError(problem_, factor * hypothesis.depth, col, row, view));
      };
      NearTieIf(std::abs(error(1 + 2e-5) - error(1 - 2e-5)) > kPixelTolerance);  // another source pixel, or none
      return error(1);
    }
    const MatchView& reference = problem_.reference;
    const MatchView& source = problem_.sources[view];
    if (source.depth.empty()) return worst;
    const Eigen::Vector3d point = hypothesis.depth * Ray(col, row);
    const Eigen::Vector3d in_source = source.cam_from_world * (reference.cam_from_world.inverse() * point);
    if (!Less(0, in_source.z(), 1e-6)) return worst;
    const Eigen::Vector2d forward = source.camera.Project(in_source);
    const Eigen::Vector2d nearest(std::floor(forward.x() + 0.5), std::floor(forward.y() + 0.5));
    for (int i = 0; i < 2; ++i) Less(std::abs(forward[i] - nearest[i]), 0.5, kPixelTolerance);
    if (!source.depth.Contains(static_cast<int>(nearest.x()), static_cast<int>(nearest.y()))) return worst;
    const double depth = source.depth(static_cast<int>(nearest.x()), static_cast<int>(nearest.y()));
    if (!(depth > 0)) return worst;
    const Eigen::Vector3d back =
        reference.cam_from_world * (source.cam_from_world.inverse() * source.camera.Unproject(forward, depth));
    if (!Less(0, back.z(), 1e-6)) return worst;
    return std::min(worst, (reference.camera.Project(back) - Eigen::Vector2d(col, row)).norm());
  }

  /// Adaptive checkerboard sampling: the plane of least cost of each of four Vs and four strips, or of some of them.
  std::vector<Hypothesis> Propagate(const Maps& maps, int col, int row, const Regions& wanted) {
    std::vector<std::vector<Eigen::Vector2i>> regions;
    const Eigen::Vector2i directions[] = {{0, -1}, {0, 1}, {-1, 0}, {1, 0}};
    for (const Eigen::Vector2i& along : directions) {
      const Eigen::Vector2i across(along.y() != 0 ? 1 : 0, along.y() != 0 ? 0 : 1);
      std::vector<Eigen::Vector2i> v = {along};
      for (int i = 1; i <= 3; ++i) {
        v.emplace_back((i + 1) * along - i * across);
        v.emplace_back((i + 1) * along + i * across);
      }
      regions.push_back(v);
    }
    for (const Eigen::Vector2i& along : directions) {
      std::vector<Eigen::Vector2i> strip;
      for (int i = 3; i <= 23; i += 2) strip.emplace_back(i * along);
      regions.push_back(strip);
    }
    std::vector<Hypothesis> candidates;
    for (size_t i = wanted.first; i < wanted.first + wanted.count; ++i) {
      Eigen::Vector2i best(-1, -1);
      for (const Eigen::Vector2i& offset : regions[i]) {
        const Eigen::Vector2i at = Eigen::Vector2i(col, row) + offset;
        if (!maps.cost.View().Contains(at.x(), at.y())) continue;
        // Both are floats: no near ties here.
        if (best.x() < 0 || maps.cost(at.x(), at.y()) < maps.cost(best.x(), best.y())) best = at;
      }
      if (best.x() < 0) continue;
      const Hypothesis candidate = At(reference::ToDouble(maps.planes(best.x(), best.y())), col, row);
      if (InRange(candidate.depth)) candidates.push_back(candidate);
    }
    return candidates;
  }

  /// Mean confidence of a view's good costs over the propagated hypotheses, without the pixel's own; 0 where `decisive`
  /// or more are bad, `otherwise` where so many are neither.
  double Confidence(const std::vector<std::vector<double>>& costs, size_t view, int iteration, int decisive,
                    double otherwise) {
    constexpr double kTau0 = 0.8, kTau1 = 1.2, kAlpha = 90;
    const double beta = options_.sigma_view, tau = kTau0 * std::exp(-iteration * iteration / kAlpha);
    double sum = 0;
    int good = 0, bad = 0;
    for (size_t i = 0; i + 1 < costs.size(); ++i) {
      const double cost = costs[i][view];
      if (Less(cost, tau, kCostTolerance)) {
        sum += std::exp(-cost * cost / (2 * beta * beta));
        ++good;
      }
      if (Less(kTau1, cost, kCostTolerance)) ++bad;
    }
    if (bad >= decisive) return 0;
    return good >= decisive ? sum / good : otherwise;
  }

  /// Multi-hypothesis joint view selection of ACMH, section 3.
  std::vector<double> WeighAsAcmh(const std::vector<std::vector<double>>& costs, uint32_t before, int iteration) {
    constexpr int kN1AndOneMore = 3;  // and n_2
    std::vector<double> weights;
    for (size_t view = 0; view < problem_.sources.size(); ++view) {
      const bool is_before = (before >> view & 1) != 0;
      const double confidence = Confidence(costs, view, iteration, kN1AndOneMore, 0);
      weights.push_back(confidence > 0 ? (1 + is_before) * confidence : 0.2 * is_before);
    }
    return weights;
  }

  /// Eq. 10 of ACMP, summed over the neighbours.
  double Smoothness(const Maps& maps, size_t view, int col, int row) const {
    const double eta = options_.view_smoothness;
    double smoothness = 0;
    for (const Eigen::Vector2i& step : {Eigen::Vector2i(0, -1), {0, 1}, {-1, 0}, {1, 0}}) {
      if (!maps.views.View().Contains(col + step.x(), row + step.y())) continue;
      smoothness += (maps.views(col + step.x(), row + step.y()) >> view & 1) != 0 ? eta : 1 - eta;
    }
    return smoothness;
  }

  /// The Monte-Carlo draws of ACMP: how often each view is drawn; no draws where all probabilities are zero.
  std::vector<double> DrawWeights(const std::vector<double>& probability, Random* random) {
    const double total = std::accumulate(probability.begin(), probability.end(), 0.0);
    std::vector<double> weights(probability.size(), 0.0);
    if (!(total > 0)) return weights;
    size_t last = probability.size() - 1;
    while (!(probability[last] > 0)) --last;
    for (int draw = 0; draw < options_.view_draws; ++draw) {
      const double drawn = (*random)() * total;
      double up_to = probability[0];
      size_t chosen = 0;
      while (chosen < last && !Less(drawn, up_to, kDrawTolerance * total)) up_to += probability[++chosen];
      ++weights[chosen];
    }
    return weights;
  }

  /// Eqs. 8-11 of ACMP and the draws.
  std::vector<double> WeighAsAcmp(const std::vector<std::vector<double>>& costs, const Maps& maps, int col, int row,
                                  Random* random) {
    const double sigma = options_.sigma_view;
    std::vector<double> probability;
    for (size_t view = 0; view < problem_.sources.size(); ++view) {
      double likelihood = 0;
      for (const auto& of_hypothesis : costs) {
        likelihood += std::exp(-of_hypothesis[view] * of_hypothesis[view] / (2 * sigma * sigma));
      }
      probability.push_back(likelihood * Smoothness(maps, view, col, row));
    }
    return DrawWeights(probability, random);
  }

  /// ACMP's draws from ACMH's confidences: where a view's costs are neither good nor bad, that of a cost just good
  /// enough with a deviation of 0.4.
  /// @param views bits of those that may be drawn
  std::vector<double> WeighAsOurs(const std::vector<std::vector<double>>& costs, const Maps& maps, uint32_t views,
                                  int decisive, int col, int row, int iteration, Random* random) {
    const double tau = 0.8 * std::exp(-iteration * iteration / 90.0),
                 just_good = std::exp(-tau * tau / (2 * 0.4 * 0.4));
    std::vector<double> probability;
    for (size_t view = 0; view < problem_.sources.size(); ++view) {
      const double confidence =
          (views >> view & 1) != 0 ? Confidence(costs, view, iteration, decisive, just_good) : 0.0;
      probability.push_back(confidence * Smoothness(maps, view, col, row));
    }
    return DrawWeights(probability, random);
  }

  /// The views that at least min_neighbours_per_view of the pixel and its four neighbours use; all where there is none,
  /// or the option is 0.
  uint32_t ViewsOfNeighbours(const Maps& maps, int col, int row) const {
    uint32_t views = 0, all = 0;
    for (size_t view = 0; view < problem_.sources.size(); ++view) {
      int users = 0;
      for (const Eigen::Vector2i& step : {Eigen::Vector2i(0, 0), {0, -1}, {0, 1}, {-1, 0}, {1, 0}}) {
        if (!maps.views.View().Contains(col + step.x(), row + step.y())) continue;
        users += (maps.views(col + step.x(), row + step.y()) >> view & 1) != 0 ? 1 : 0;
      }
      views |= (users >= options_.min_neighbours_per_view ? 1u : 0u) << view;
      all |= 1u << view;
    }
    return views != 0 ? views : all;
  }

  /// Of the present planes around the pixel.
  bool IsSurfaceBroken(const Maps& maps, int col, int row) {
    const auto with_factor = [&](float factor) {
      PatchMatchOptions options = options_;
      options.edge_bend *= factor;
      return reference::IsSurfaceBroken(problem_.reference.camera, maps.planes, options, col, row);
    };
    NearTieIf(with_factor(1.001f) != with_factor(0.999f));
    return with_factor(1);
  }

  /// @param views bits of those that are asked for; the others' costs are those of no view seeing it
  std::vector<double> MatchingCosts(const Hypothesis& hypothesis, uint32_t views, int col, int row) {
    std::vector<double> costs(problem_.sources.size(), kWorst);
    for (size_t view = 0; view < costs.size(); ++view) {
      if ((views >> view & 1) != 0) costs[view] = MatchingCost(hypothesis, col, row, static_cast<int>(view));
    }
    return costs;
  }

  /// @param costs MatchingCosts of the views with weights
  Rating Rate(const Hypothesis& hypothesis, const std::vector<double>& costs, const std::vector<double>& weights,
              const Maps& maps, int col, int row) {
    double sum = 0, total = 0;
    for (size_t j = 0; j < weights.size(); ++j) {
      if (!(weights[j] > 0)) continue;
      double cost = costs[j];
      if (stage_ == Pass::kGeometric) {
        cost += options_.geometric_weight * ReprojectionError(hypothesis, col, row, static_cast<int>(j));
      }
      sum += weights[j] * cost;
      total += weights[j];
    }
    const double cost = sum / total;
    if (stage_ != Pass::kPlanarPrior) return {cost, cost};
    double compatibility = 0;  // the product of eq. 6
    const PlaneHypothesis prior_plane = maps.prior(col, row);
    if (prior_plane.d > 0) {
      const Hypothesis prior = At(reference::ToDouble(prior_plane), col, row);
      const double lambda_d =
          (static_cast<double>(problem_.depth_range.max) - problem_.depth_range.min) / options_.prior_depth_divisor;
      const double lambda_n = options_.prior_sigma_normal_deg * kRadPerDeg;
      const double difference = hypothesis.depth - prior.depth;
      const double angle = std::acos(std::clamp(hypothesis.plane.normal.dot(prior.plane.normal), -1.0, 1.0));
      // Ours reads both as standard deviations.
      compatibility = std::exp(-difference * difference / (2 * lambda_d * (IsOurs() ? lambda_d : 1))) *
                      std::exp(-angle * angle / (2 * lambda_n * (IsOurs() ? lambda_n : 1)));
    }
    return {cost, cost * cost / options_.prior_alpha - std::log(options_.prior_gamma + compatibility)};
  }

  /// Ours: near the prior where there is one and the estimate is not credible.
  Hypothesis StartNearPrior(const Hypothesis& present, const Maps& maps, int col, int row, Random* random) {
    constexpr double kDepthSpread = 0.06, kNormalSpread = 5.4 * kRadPerDeg;
    const PlaneHypothesis prior_plane = maps.prior(col, row);
    if (!(prior_plane.d > 0) || maps.cost(col, row) < options_.prior_start_cost) return present;
    const Hypothesis prior = At(reference::ToDouble(prior_plane), col, row);
    const double depth = std::clamp<double>(prior.depth * (1 + kDepthSpread * (*random)(-1, 1)),
                                            problem_.depth_range.min, problem_.depth_range.max);
    return Through(PerturbNormal(prior.plane.normal, Ray(col, row), kNormalSpread, random), depth, col, row);
  }

  Hypothesis Start(const Maps& maps, int col, int row) {
    Random random(options_.seed, static_cast<uint32_t>(row * width_ + col), pass_ * 64);
    const bool is_random = stage_ == Pass::kPhotometric || (stage_ == Pass::kPlanarPrior && !IsOurs());
    if (is_random) {
      const double depth = RandomDepth(&random);
      return Through(RandomNormal(Ray(col, row), &random), depth, col, row);
    }
    const Hypothesis present = At(reference::ToDouble(maps.planes(col, row)), col, row);
    return stage_ == Pass::kPlanarPrior ? StartNearPrior(present, maps, col, row, &random) : present;
  }

  /// Mean of the four least costs.
  Outcome RateByBestViews(const Hypothesis& start, int col, int row) {
    std::vector<std::pair<double, int>> costs;  // of the views that see it
    for (size_t view = 0; view < problem_.sources.size(); ++view) {
      const int j = static_cast<int>(view);
      double cost = MatchingCost(start, col, row, j);
      if (!Less(cost, kWorst, kCostTolerance)) continue;
      if (stage_ == Pass::kGeometric) cost += options_.geometric_weight * ReprojectionError(start, col, row, j);
      costs.emplace_back(cost, j);
    }
    constexpr size_t kTop = 4;
    std::sort(costs.begin(), costs.end());
    for (size_t i = 0; i + 1 < costs.size(); ++i) Less(costs[i].first, costs[i + 1].first, kCostTolerance);
    costs.resize(std::min(kTop, costs.size()));
    Outcome outcome = {start.plane};
    if (costs.empty()) return Done(outcome);
    double sum = 0;
    for (const auto& [cost, view] : costs) {
      sum += cost;
      if (!weighs_as_acmh_ || view == costs[0].second) outcome.views |= 1u << view;
    }
    outcome.cost = sum / static_cast<double>(costs.size());
    return Done(outcome);
  }

  /// Refinement, eq. 12: depths and normals. Ours only perturbs in geometric passes and after the first iteration of
  /// the planar-prior pass, whose random ones lie about the prior.
  std::vector<std::pair<double, Eigen::Vector3d>> Refinements(const Hypothesis& current, const Maps& maps, int col,
                                                              int row, int iteration, Random* random) {
    const Eigen::Vector3d ray = Ray(col, row), n_c = current.plane.normal;
    const bool perturbs_only =
        IsOurs() && (stage_ == Pass::kGeometric || (stage_ == Pass::kPlanarPrior && iteration > 0));
    double d_r = 0;
    Eigen::Vector3d n_r = n_c;
    if (!perturbs_only) {
      d_r = RandomDepth(random);
      n_r = RandomNormal(ray, random);
    }
    if (IsOurs() && stage_ == Pass::kPlanarPrior && !perturbs_only && maps.prior(col, row).d > 0) {
      const Hypothesis prior = At(reference::ToDouble(maps.prior(col, row)), col, row);
      const double sigma_d =
          (static_cast<double>(problem_.depth_range.max) - problem_.depth_range.min) / options_.prior_depth_divisor;
      d_r = prior.depth + 3 * sigma_d * (*random)(-1, 1);
      n_r = PerturbNormal(prior.plane.normal, ray, 0.5 * options_.prior_sigma_normal_deg * kRadPerDeg, random);
    }
    const double d_c = current.depth, d_p = d_c * (1 + (*random)(-options_.perturb_depth, options_.perturb_depth));
    const Eigen::Vector3d n_p = PerturbNormal(n_c, ray, options_.perturb_normal_deg * kRadPerDeg, random);
    std::vector<std::pair<double, Eigen::Vector3d>> refined = {{d_p, n_c}, {d_c, n_p}, {d_p, n_p}};
    if (!perturbs_only) refined.insert(refined.end(), {{d_r, n_c}, {d_c, n_r}, {d_r, n_r}});
    return refined;
  }

  /// Joint bilateral upsampling: the mean of the coarser scale's depths in 5 x 5 px, weighted by distance (deviation
  /// 0.5 px there) and by difference of grey values here (a tenth of their range). The normal is that of the pixel that
  /// covers this one; it faces the camera where that does not.
  Hypothesis Upsample(const PlaneMap& coarser, int col, int row) {
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

  void StartPixel() {
    is_near_tie_ = false;
    least_variance_ = kWeakVariance;
    window_options_ = options_;
  }

  bool IsOurs() const { return options_.method == Method::kOurs; }
  void NearTieIf(bool is_near) { is_near_tie_ = is_near_tie_ || is_near; }

  const PatchMatchProblem& problem_;
  const PatchMatchOptions& options_;
  PatchMatchOptions window_options_;  ///< with the sigma of the pixel's window
  Pass stage_;
  bool weighs_as_acmh_;
  uint32_t pass_;
  int width_, height_;
  bool is_near_tie_ = false;
  double least_variance_ = 0;  ///< of the windows compared for the pixel
};

}  // namespace acmp::paper
