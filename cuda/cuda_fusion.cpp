#include "cuda_fusion.h"

#include <map>
#include <mutex>
#include <utility>

#include "fusion_views.h"

namespace acmp {
namespace {

/// Each frame's stamps are on the GPU that used them last.
class CudaStamps final : public FusionStamps {
 public:
  /// A frame's stamps on the queue's GPU. They are not locked: views that are fused at the same time have no frame in
  /// common.
  ImageView<Stamp> Of(const Frame& frame, const DeviceQueue& queue) {
    const int width = frame.camera.width, height = frame.camera.height;
    DeviceArray<Stamp>& stamps = ArrayOf(frame.id);
    if (stamps.size() == 0) {
      stamps = Unused(static_cast<size_t>(width) * height, queue);
    } else if (stamps.device() != queue.device()) {
      Move(&stamps, queue);
    }
    return {stamps.data(), width, height, width};
  }

 private:
  /// Empty at first; stays where it is.
  DeviceArray<Stamp>& ArrayOf(int64_t frame) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return by_frame_[frame];
  }

  static DeviceArray<Stamp> Unused(size_t pixels, const DeviceQueue& queue) {
    static_assert(kUnusedStamp == 0xffff, "both bytes are set to 0xff");
    DeviceArray<Stamp> stamps(queue.device(), pixels);
    CudaCheck(cudaMemsetAsync(stamps.data(), 0xff, pixels * sizeof(Stamp), queue.stream().get()), "reset stamps");
    return stamps;
  }

  /// Replaces another GPU's stamps by a copy on this one.
  static void Move(DeviceArray<Stamp>* stamps, const DeviceQueue& queue) {
    {
      DeviceArray<Stamp> moved(queue.device(), stamps->size());
      moved.CopyFromPeer(*stamps, stamps->size(), queue.stream());
      queue.stream().Synchronize();  // before the other GPU gets its memory back
      *stamps = std::move(moved);
    }
    queue.device()->MakeCurrent();  // freeing selected the other GPU
  }

  std::mutex mutex_;
  std::map<int64_t, DeviceArray<Stamp>> by_frame_;
};

}  // namespace

ConsistencyResult CudaFusion::FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                                  const FusionOptions& options) {
  return queue_.OnDevice([&] {
    return runner_.Filter(SetUpViews(reference, sources, MakeFusionLimits(options), FusionMapsOf, &queue_),
                          queue_.stream());
  });
}

ConfidenceMap CudaFusion::MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                            const FusionOptions& options) {
  return queue_.OnDevice([&] {
    return runner_.MeasureConfidence(SetUpViews(reference, sources, MakeFusionLimits(options), FusionMapsOf, &queue_),
                                     queue_.stream());
  });
}

std::unique_ptr<FusionStamps> CudaFusion::MakeStamps() { return std::make_unique<CudaStamps>(); }

PointCloud CudaFusion::FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                                const FusionOptions& options, int rank, FusionStamps* stamps) {
  auto* gpu_stamps = dynamic_cast<CudaStamps*>(stamps);
  if (gpu_stamps == nullptr) throw InvalidInputError("stamps: null or not of a GPU");
  const Stamp stamp = StampOfRank(rank);
  return queue_.OnDevice([&] {
    FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), FusionMapsOf(reference, &queue_),
                                        MakeFusionLimits(options), reference.cam_from_world().inverse());
    setup.SetStamps(gpu_stamps->Of(*reference.frame, queue_), stamp);
    for (const EngineView& source : sources) {
      if (!source.estimate) continue;
      setup.AddSource(PosedCameraOf(source), FusionMapsOf(source, &queue_), gpu_stamps->Of(*source.frame, queue_));
    }
    return runner_.Fuse(setup, reference.frame->camera.width, reference.frame->camera.height, queue_.stream());
  });
}

}  // namespace acmp
