#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "acmp_mapping/engine/host_depth_engine.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"

namespace acmp {

/// A pass that an engine is asked for.
struct PassRequest {
  Pass pass;
  const EngineProblem& problem;
  const PatchMatchOptions& options;
  int level;
  EngineEstimatePtr start;           ///< null in the photometric pass
  int geometric_pass = -1;           ///< which one
  const PriorMesh* prior = nullptr;  ///< of the planar-prior pass, as in EnginePass
  const PlanarPriorOptions* grid_prior = nullptr;

  int64_t reference() const { return problem.reference.frame->id; }
  PinholeCamera camera() const { return CameraAtLevel(problem.reference.frame->camera, level); }
};

/// One plane and cost everywhere.
inline EstimateState UniformState(const PinholeCamera& camera, const PlaneHypothesis& plane, float cost) {
  return {PlaneMap(camera.width, camera.height, plane), CostMap(camera.width, camera.height, cost)};
}

/// The host's engine, but for the passes, which answer what a test wants, and the free-space check, which finds
/// nothing. Each of them says that it has taken kPassMs.
class FakeEngine : public HostDepthEngine {
 public:
  static constexpr double kPassMs = 10;

  std::unique_ptr<DepthEngine> Share() override { throw std::logic_error("fakes are not shared"); }
  EngineEstimatePtr RunPass(const EngineProblem& problem, const PatchMatchOptions& options, EnginePass pass) override {
    const bool is_geometric = pass.kind == Pass::kGeometric;
    if (is_geometric) {
      const DepthMap depth = DownloadDepth(pass.start);
      pass.level = LevelOf(problem, depth.width(), depth.height());
    }
    return Run({pass.kind, problem, options, pass.level, std::move(pass.start), is_geometric ? pass.geometric_pass : -1,
                pass.prior, pass.grid_prior});
  }
  EngineEstimatePtr RemoveUnsupported(const EngineProblem&, EngineEstimatePtr start) override {
    fake_ms_ += kPassMs;
    return start;
  }
  double PopDeviceTime() override { return std::exchange(fake_ms_, 0.0); }
  std::string device_name() const override { return "fake"; }

 protected:
  virtual EstimateState Answer(const PassRequest& request) = 0;

  virtual EngineEstimatePtr Run(const PassRequest& request) {
    MakePatchMatchProblem(request.problem, request.level);  // refuses what a device would
    fake_ms_ += kPassMs;
    return UploadState(Answer(request), request.camera());
  }

  /// What a geometric pass reads of a source view; empty where it has no estimate, and for other passes.
  DepthMap SourceDepth(const PassRequest& request, const EngineView& source) {
    return request.pass == Pass::kGeometric && source.estimate ? DownloadDepth(source.estimate) : DepthMap();
  }

 private:
  double fake_ms_ = 0;
};

}  // namespace acmp
