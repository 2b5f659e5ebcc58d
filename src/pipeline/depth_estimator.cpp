#include "acmp_mapping/pipeline/depth_estimator.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"

namespace acmp {
namespace {

MatchView MakeView(const Frame& frame) {
  MatchView view;
  view.gray = frame.gray.View();
  view.camera = frame.camera;
  view.cam_from_world = frame.cam_from_world;
  return view;
}

PatchMatchProblem MakeProblem(const Frame& reference, const std::vector<FramePtr>& sources, const DepthRange& range) {
  PatchMatchProblem problem;
  problem.reference = MakeView(reference);
  problem.sources.reserve(sources.size());
  for (const FramePtr& source : sources) problem.sources.push_back(MakeView(*source));
  problem.depth_range = range;
  return problem;
}

}  // namespace

DepthEstimator::DepthEstimator(PatchMatch* patch_match, const PipelineOptions& options) : patch_match_(patch_match) {
  set_options(options);
}

void DepthEstimator::set_options(const PipelineOptions& options) {
  Validate(options);
  options_ = options;
}

PatchMatchResult DepthEstimator::EstimateInitial(const Frame& reference, const std::vector<FramePtr>& sources,
                                                 const DepthRange& range) {
  times_ = {};
  const PatchMatchProblem problem = MakeProblem(reference, sources, range);

  Timer timer;
  PatchMatchResult estimate = patch_match_->RunPhotometric(problem, options_.patch_match);
  times_.photometric_ms = timer.Lap();
  times_.kernels_ms = patch_match_->last_timing().kernels_ms;
  if (!options_.use_planar_prior) return estimate;

  const DepthMap depth = ToDepthMap(estimate.planes, reference.camera);
  const auto points = FindSupportPoints(depth.View(), estimate.cost.View(), range, options_.planar_prior);
  const auto triangles = TriangulateSupportPoints(points);
  const PlaneMap prior = MakePlanarPrior(reference.camera, points, triangles, range, options_.planar_prior);
  times_.prior_construction_ms = timer.Lap();

  estimate = patch_match_->RunPlanarPrior(problem, options_.patch_match, estimate, prior.View());
  times_.planar_prior_ms = timer.Lap();
  times_.kernels_ms += patch_match_->last_timing().kernels_ms;
  return estimate;
}

PatchMatchResult DepthEstimator::RefineGeometric(const Frame& reference, const std::vector<FramePtr>& sources,
                                                 const std::vector<const DepthMap*>& source_depths,
                                                 const DepthRange& range, const PatchMatchResult& start, int pass) {
  if (source_depths.size() != sources.size()) {
    throw InvalidInputError(
        Concat("source_depths: ", source_depths.size(), " maps for ", sources.size(), " source views"));
  }
  times_ = {};
  PatchMatchProblem problem = MakeProblem(reference, sources, range);
  for (size_t i = 0; i < sources.size(); ++i) {
    if (source_depths[i] != nullptr) problem.sources[i].depth = source_depths[i]->View();
  }
  Timer timer;
  PatchMatchResult refined = patch_match_->RunGeometric(problem, options_.patch_match, start, pass);
  times_.geometric_ms = timer.Lap();
  times_.kernels_ms = patch_match_->last_timing().kernels_ms;
  return refined;
}

}  // namespace acmp
