#pragma once

#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/pipeline/depth_engine.h"
#include "reconstruct_folder.h"
#include "reconstruct_interrupt.h"

namespace acmp {

/// Carries an error through DenseMapper, which would take any std::exception for the failure of one keyframe and go on.
struct RunAborted {
  std::exception_ptr reason;
};

/// Keeps the result of every pass of another engine on disk. The mapper is deterministic: fed with the same frames
/// again it asks for the same passes in the same order, so a run that was interrupted gets the results it already had
/// from here, at the cost of reading a file each. So that the order holds, a failure of any step ends the run.
class RecordingDepthEngine final : public DepthEngine {
 public:
  /// @param engine not null; all outlive this
  RecordingDepthEngine(DepthEngine* engine, const ReconstructFolder* folder, const InterruptWatcher* interrupt);

  /// Refused: the order of the passes of two engines would not be the same in every run.
  std::unique_ptr<DepthEngine> Share() override;

  EngineImagePtr Load(const FramePtr& frame, int levels) override;
  EngineEstimatePtr RunPhotometric(const EngineProblem& problem, const PatchMatchOptions& options, int level) override;
  EngineEstimatePtr Upsample(const EngineEstimatePtr& estimate, const FramePtr& frame, int level) override;
  std::vector<SupportPoint> FindSupportPoints(const EngineEstimatePtr& estimate, const DepthRange& range,
                                              const PlanarPriorOptions& options) override;
  EngineEstimatePtr RunPlanarPrior(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const PriorMesh& prior) override;
  EngineEstimatePtr RunGeometric(const EngineProblem& problem, const PatchMatchOptions& options,
                                 EngineEstimatePtr start, int pass) override;
  EngineEstimatePtr RestoreDetails(const EngineProblem& problem, const PatchMatchOptions& options,
                                   EngineEstimatePtr start, const EngineEstimatePtr& coarser) override;
  EngineEstimatePtr Complete(const EngineProblem& problem, const CompletionOptions& options) override;
  EngineEstimatePtr RefuteUnsupported(const EngineProblem& problem, EngineEstimatePtr start) override;
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override;
  std::unique_ptr<FusionStamps> MakeFusionStamps() override;
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override;
  EstimateMaps Download(const EngineEstimatePtr& estimate) override;
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override;
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override;
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override;
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override;
  double TakeDeviceMs() override { return engine_->TakeDeviceMs(); }
  size_t DeviceBytes() const override { return engine_->DeviceBytes(); }
  size_t FreeDeviceBytes() const override { return engine_->FreeDeviceBytes(); }
  std::string device_name() const override { return engine_->device_name(); }

  /// Passes that were really run, not read.
  int passes_run() const { return passes_run_; }

  static constexpr const char* kStage = "passes";

 private:
  template <class Pass>
  EngineEstimatePtr Recorded(const EngineProblem& problem, int level, const Pass& pass);

  DepthEngine* engine_;
  const ReconstructFolder* folder_;
  const InterruptWatcher* interrupt_;
  int next_pass_ = 0;
  int passes_run_ = 0;
};

}  // namespace acmp
