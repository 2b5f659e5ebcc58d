#include "acmp_mapping/pipeline/depth_estimator.h"

#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/fill/prior_depth.h"

namespace acmp {

StageTimes& StageTimes::operator+=(const StageTimes& other) {
  photometric_ms += other.photometric_ms;
  prior_construction_ms += other.prior_construction_ms;
  planar_prior_ms += other.planar_prior_ms;
  geometric_ms += other.geometric_ms;
  fill_ms += other.fill_ms;
  kernels_ms += other.kernels_ms;
  photometric_kernels_ms += other.photometric_kernels_ms;
  return *this;
}

DepthEstimator::DepthEstimator(DepthEngine* engine, const PipelineOptions& options) : engine_(engine) {
  if (engine == nullptr) throw InvalidInputError("engine: must not be null");
  set_options(options);
}

void DepthEstimator::set_options(const PipelineOptions& options) {
  Validate(options);
  options_ = options;
  schedule_ = ScheduleOf(options);
}

EngineEstimatePtr DepthEstimator::Run(const KeyframeStep& step, EngineProblem problem) {
  using Kind = KeyframeStep::Kind;
  times_ = {};
  prior_depth_rejection_.clear();
  engine_->PopDeviceTime();
  Timer timer;
  EngineEstimatePtr estimate = std::exchange(problem.reference.estimate, nullptr);
  switch (step.kind) {
    case Kind::kInitial:
      estimate = EstimateInitial(problem);
      break;
    case Kind::kNextScale: {
      EngineEstimatePtr own = engine_->RunPhotometric(problem, options_.patch_match, step.level);
      estimate = engine_->RestoreDetails(problem, options_.patch_match, std::move(own), estimate);
      times_.photometric_ms = timer.Lap();
      times_.photometric_kernels_ms = engine_->PopDeviceTime();
      break;
    }
    case Kind::kGeometricPass:
      estimate = engine_->RunGeometric(problem, options_.patch_match, std::move(estimate), step.pass);
      times_.geometric_ms = timer.Lap();
      break;
    case Kind::kFillForPasses:
      estimate = Fill(problem, std::move(estimate), true);
      times_.fill_ms = timer.Lap();
      break;
    case Kind::kFillUnverified:
      estimate = Fill(problem, std::move(estimate), false);
      if (options_.fill.remove_unsupported) estimate = engine_->RemoveUnsupported(problem, std::move(estimate));
      times_.fill_ms = timer.Lap();
      break;
  }
  times_.kernels_ms = times_.photometric_kernels_ms + engine_->PopDeviceTime();
  return estimate;
}

EngineEstimatePtr DepthEstimator::Fill(const EngineProblem& problem, EngineEstimatePtr start, bool for_passes) {
  FillOptions fill = options_.fill;
  fill.for_passes = for_passes;
  EngineEstimatePtr filled = engine_->FillUnverified(problem, std::move(start), fill);
  const Frame& frame = *problem.reference.frame;
  if (frame.prior_depth.empty()) return filled;
  EstimateState state = engine_->DownloadState(filled);
  prior_depth_rejection_ = UsePriorDepth(frame, !problem.reference.refined_pose, problem.depth_range,
                                         options_.prior_depth, state.cost.View(), state.planes.View());
  if (!prior_depth_rejection_.empty()) return filled;
  filled.reset();
  return engine_->UploadState(std::move(state), frame.camera);
}

EngineEstimatePtr DepthEstimator::EstimateInitial(const EngineProblem& problem) {
  Timer timer;
  EngineEstimatePtr estimate = EstimatePhotometric(problem);
  times_.photometric_ms = timer.Lap();
  times_.photometric_kernels_ms = engine_->PopDeviceTime();
  if (!options_.use_planar_prior) return estimate;
  if (options_.patch_match.method == Method::kOurs) {
    estimate = engine_->RunGridPrior(problem, options_.patch_match, std::move(estimate), options_.planar_prior);
  } else {
    const PriorMesh prior = MakePriorMesh(
        problem.reference.frame->camera,
        engine_->FindSupportPoints(estimate, problem.depth_range, options_.planar_prior), options_.planar_prior);
    times_.prior_construction_ms = timer.Lap();
    estimate = engine_->RunPlanarPrior(problem, options_.patch_match, std::move(estimate), prior);
  }
  times_.planar_prior_ms = timer.Lap();
  return estimate;
}

EngineEstimatePtr DepthEstimator::EstimatePhotometric(const EngineProblem& problem) {
  const int level = options_.start_level;
  EngineEstimatePtr start = engine_->RunPhotometric(problem, options_.patch_match, level);
  if (level == 0 || options_.multi_scale) return start;
  EngineEstimatePtr full = engine_->Upsample(start, problem.reference.frame, level);
  if (options_.full_size_iterations == 0) return full;
  // Without prior planes eq. 7 decides as eq. 1 does.
  PatchMatchOptions options = options_.patch_match;
  options.planar_prior_iterations = options_.full_size_iterations;
  options.seed = HashWord(options.seed);  // the planar-prior pass draws other numbers
  return engine_->RunPlanarPrior(problem, options, std::move(full), {});
}

}  // namespace acmp
