#include "acmp_mapping/pipeline/depth_estimator.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"

namespace acmp {

StageTimes& StageTimes::operator+=(const StageTimes& other) {
  photometric_ms += other.photometric_ms;
  prior_construction_ms += other.prior_construction_ms;
  planar_prior_ms += other.planar_prior_ms;
  geometric_ms += other.geometric_ms;
  kernels_ms += other.kernels_ms;
  return *this;
}

DepthEstimator::DepthEstimator(DepthEngine* engine, const PipelineOptions& options) : engine_(engine) {
  if (engine == nullptr) throw InvalidInputError("engine: must not be null");
  set_options(options);
}

void DepthEstimator::set_options(const PipelineOptions& options) {
  Validate(options);
  options_ = options;
}

EngineEstimatePtr DepthEstimator::EstimateInitial(const EngineProblem& problem) {
  times_ = {};
  engine_->TakeDeviceMs();
  const int level = options_.start_level;
  Timer timer;
  EngineEstimatePtr coarse = engine_->RunPhotometric(problem, options_.patch_match, level);
  EngineEstimatePtr estimate = level > 0 ? engine_->Upsample(coarse, problem.reference.frame, level) : coarse;
  times_.photometric_ms = timer.Lap();

  if (options_.use_planar_prior) {
    PinholeCamera camera = problem.reference.frame->camera;
    for (int i = 0; i < level; ++i) camera = camera.Halved();
    const PriorMesh prior = MakePriorMesh(
        camera, engine_->FindSupportPoints(coarse, problem.depth_range, options_.planar_prior), level,
        options_.planar_prior);
    times_.prior_construction_ms = timer.Lap();
    estimate = engine_->RunPlanarPrior(problem, options_.patch_match, estimate, prior);
    times_.planar_prior_ms = timer.Lap();
  }
  times_.kernels_ms = engine_->TakeDeviceMs();
  return estimate;
}

EngineEstimatePtr DepthEstimator::RefineGeometric(const EngineProblem& problem, const EngineEstimatePtr& start,
                                                  int pass) {
  times_ = {};
  engine_->TakeDeviceMs();
  Timer timer;
  EngineEstimatePtr refined = engine_->RunGeometric(problem, options_.patch_match, start, pass);
  times_.geometric_ms = timer.Lap();
  times_.kernels_ms = engine_->TakeDeviceMs();
  return refined;
}

}  // namespace acmp
