#pragma once

#include "acmp_mapping/completion/completion.h"
#include "acmp_mapping/completion/refutation.h"
#include "completion_kernels.h"
#include "cuda_device.h"

namespace acmp {

/// The memory of one completion at a time.
class CompletionRunner {
 public:
  explicit CompletionRunner(CudaDevicePtr device) : device_(std::move(device)) {}

  /// Queues CompleteUnconfirmed on planes and costs in device memory.
  /// @param sources the reference's maps as they were before, and its source views
  /// @param context from MakeCompletionContext
  void Queue(const FusionSetup<DeviceFusionView>& sources, CompletionContext context,
             const ImageView<PlaneHypothesis>& planes, float* cost, const CudaStream& stream);

  /// Queues the weighted median of what Queue left.
  /// @param sources,context as they were given to Queue
  /// @param completed the reference's maps now: `normal` its planes, `depth` theirs
  /// @param cost of `completed`, changed
  /// @param filtered what becomes of the planes; another place
  void QueueMedian(const FusionSetup<DeviceFusionView>& sources, const DeviceFusionView& completed,
                   const CompletionContext& context, float* cost, PlaneHypothesis* filtered, const CudaStream& stream);

  /// Where the evidence of so many cells may be written, until the next call.
  float* ReserveEvidence(size_t cells);
  /// Queues RefuteUnsupported with that.
  /// @param context from MakeEvidentContext, of maps in device memory
  void QueueRefutation(CompletionContext context, const CudaStream& stream);

 private:
  CudaDevicePtr device_;
  DeviceArray<DeviceFusionSource> sources_;
  DeviceArray<Sightings> sightings_;
  DeviceArray<AnchorCell> cells_;
  DeviceArray<NearestAnchors> nearest_;
  DeviceArray<float> evidence_;
};

}  // namespace acmp
