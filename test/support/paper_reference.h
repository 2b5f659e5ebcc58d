#pragma once

#include "support/reference_match.h"

namespace acmp::paper {

/// Algorithm 1 of the ACMP paper, one pixel at a time in plain double arithmetic, with the view weights of ACMH in its
/// photometric pass, and ACMM's step between two scales; and what the presets of our own do otherwise. It shares no
/// code with the kernels; the random numbers' definition is written down again.

enum class Stage { kPhotometric, kPlanarPrior, kGeometric };
enum class System { kAcmh, kAcmp, kOurs };

/// What a pixel reads, as the pass has left it so far.
struct Maps {
  const PlaneMap& planes;
  const CostMap& cost;
  const Image<uint32_t>& views;  ///< of ACMH the one view that weighed most
  const PlaneMap& prior;         ///< zero planes: none
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
  Reference(const PatchMatchProblem& problem, const PatchMatchOptions& options, System system, Stage stage,
            uint32_t pass);

  /// Steps 3, 14, or the start of steps 22-30.
  Outcome Initialize(const Maps& maps, int col, int row);
  /// The same in ours for a pixel that is updated first: without a comparison.
  Outcome InitializeUnmatched(const Maps& maps, int col, int row);
  /// Steps 5-7, 16-18 or 25-27 in iteration 0, 1, ...
  Outcome Update(const Maps& maps, int col, int row, int iteration);
  /// ACMM's detail restorer after a photometric pass; leaves the views as they are.
  /// @param coarser estimate of the next coarser scale, whose camera is the problem's halved
  Outcome Restore(const Maps& maps, const PlaneMap& coarser, int col, int row);

 private:
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
  class Random;

  bool IsOurs() const { return system_ == System::kOurs; }
  void StartPixel();
  void NearTieIf(bool is_near) { is_near_tie_ = is_near_tie_ || is_near; }
  Outcome Done(Outcome outcome) const;
  bool Less(double a, double b, double tolerance);
  bool InRange(double depth);
  Eigen::Vector3d Ray(int col, int row) const;
  Hypothesis At(const reference::Plane& plane, int col, int row) const;
  Hypothesis Through(const Eigen::Vector3d& normal, double depth, int col, int row) const;
  double RandomDepth(Random* random) const;
  Eigen::Vector3d RandomNormal(const Eigen::Vector3d& ray, Random* random) const;
  Eigen::Vector3d PerturbNormal(const Eigen::Vector3d& normal, const Eigen::Vector3d& ray, double most_rad,
                                Random* random);
  Hypothesis Start(const Maps& maps, int col, int row);
  Hypothesis StartNearPrior(const Hypothesis& present, const Maps& maps, int col, int row, Random* random);
  bool IsSurfaceBroken(const Maps& maps, int col, int row);

  double MatchingCost(const Hypothesis& hypothesis, int col, int row, int view);
  /// @param views bits of those that are asked for; the others' costs are those of no view seeing it
  std::vector<double> MatchingCosts(const Hypothesis& hypothesis, uint32_t views, int col, int row);
  double ReprojectionError(const Hypothesis& hypothesis, int col, int row, int view);
  Outcome RateByBestViews(const Hypothesis& hypothesis, int col, int row);
  Hypothesis Upsample(const PlaneMap& coarser, int col, int row);
  std::vector<Hypothesis> Propagate(const Maps& maps, int col, int row, const Regions& regions);
  uint32_t ViewsOfNeighbours(const Maps& maps, int col, int row) const;
  double Confidence(const std::vector<std::vector<double>>& costs, size_t view, int iteration, int decisive,
                    double otherwise);
  std::vector<double> WeighAsAcmh(const std::vector<std::vector<double>>& costs, uint32_t before, int iteration);
  std::vector<double> WeighAsAcmp(const std::vector<std::vector<double>>& costs, const Maps& maps, int col, int row,
                                  Random* random);
  std::vector<double> WeighAsOurs(const std::vector<std::vector<double>>& costs, const Maps& maps, uint32_t views,
                                  int decisive, int col, int row, int iteration, Random* random);
  double Smoothness(const Maps& maps, size_t view, int col, int row) const;
  std::vector<double> DrawWeights(const std::vector<double>& probability, Random* random);
  std::vector<std::pair<double, Eigen::Vector3d>> Refinements(const Hypothesis& current, const Maps& maps, int col,
                                                              int row, int iteration, Random* random);
  /// @param costs MatchingCosts of the views with weights
  Rating Rate(const Hypothesis& hypothesis, const std::vector<double>& costs, const std::vector<double>& weights,
              const Maps& maps, int col, int row);

  const PatchMatchProblem& problem_;
  const PatchMatchOptions& options_;
  PatchMatchOptions window_options_;  ///< with the sigma of the pixel's window
  System system_;
  Stage stage_;
  bool weighs_as_acmh_;
  uint32_t pass_;
  int width_, height_;
  bool is_near_tie_ = false;
  double least_variance_ = 0;  ///< of the windows compared for the pixel
};

}  // namespace acmp::paper
