#pragma once

#include "acmp_mapping/fill/fill.h"
#include "acmp_mapping/fill/free_space_check.h"
#include "cuda_device.h"
#include "fill_kernels.h"

namespace acmp {

/// The memory of one completion at a time.
class FillRunner {
 public:
  explicit FillRunner(CudaDevicePtr device) : device_(std::move(device)) {}

  /// Queues FillUnverified on planes and costs in device memory.
  /// @param sources the reference's maps as they were before, and its source views
  /// @param context from MakeFillContext
  void Queue(const FusionSetup<DeviceFusionView>& sources, FillContext context,
             const ImageView<PlaneHypothesis>& planes, float* cost, const CudaStream& stream);

  /// Queues the weighted median of what Queue left.
  /// @param sources,context as they were given to Queue
  /// @param completed the reference's maps now: `normal` its planes, `depth` theirs
  /// @param cost of `completed`, changed
  /// @param filtered what becomes of the planes; another place
  void QueueMedian(const FusionSetup<DeviceFusionView>& sources, const DeviceFusionView& filled,
                   const FillContext& context, float* cost, PlaneHypothesis* filtered, const CudaStream& stream);

  /// Where the evidence of so many cells may be written, until the next call.
  float* ReserveEvidence(size_t cells);
  /// Queues RemoveUnsupported with that.
  /// @param context from MakeTexturedContext, of maps in device memory
  void QueueFreeSpaceCheck(FillContext context, const CudaStream& stream);

 private:
  CudaDevicePtr device_;
  DeviceArray<DeviceFusionSource> sources_;
  DeviceArray<ViewSupport> support_;
  DeviceArray<SeedCell> cells_;
  DeviceArray<NearestSeeds> nearest_;
  DeviceArray<float> evidence_;
};

}  // namespace acmp
