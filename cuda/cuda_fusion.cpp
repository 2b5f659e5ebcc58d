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

CudaStamps& CastCudaStamps(FusionStamps* stamps) {
  auto* gpu_stamps = dynamic_cast<CudaStamps*>(stamps);
  if (gpu_stamps == nullptr) throw InvalidInputError("stamps: null or not of a GPU");
  return *gpu_stamps;
}

}  // namespace

DeviceFusionContext CudaFusion::Upload(const Setup& setup) {
  const size_t count = setup.sources().size();
  sources_.Reserve(queue_.device(), count);
  if (count > 0) sources_.Upload(setup.sources().data(), count, queue_.stream());
  return setup.Context(sources_.data());
}

PointOutput CudaFusion::ReservePoints(int width, int height) {
  const CudaDevicePtr& device = queue_.device();
  points_.Reserve(device, static_cast<size_t>(width) * height);
  count_.Reserve(device, 1);
  scratch_.Reserve(device, PointScratchBytes(width, height));
  log_error_.Reserve(device, static_cast<size_t>(width) * height);
  return {points_.data(), count_.data(), scratch_.data(), log_error_.data()};
}

PointCloud CudaFusion::DownloadPoints() {
  auto* count = count_on_host_.Reserve<unsigned>(1);
  count_.Download(count, 1, queue_.stream());
  queue_.stream().Synchronize();
  PointCloud points(*count);
  download_.Run(points_, points.size(), queue_.stream(), points.data());
  return points;
}

void CudaFusion::QueueFilter(const Setup& setup) {
  const DeviceFusionContext context = Upload(setup);
  const int width = context.reference.depth.width, height = context.reference.depth.height;
  const size_t pixels = static_cast<size_t>(width) * height;
  consistent_views_.Reserve(queue_.device(), pixels);
  confidence_.Reserve(queue_.device(), pixels);
  LaunchFilterByConsistency(context, {consistent_views_.data(), width, height, width},
                            {confidence_.data(), width, height, width}, ReservePoints(width, height),
                            queue_.stream().get());
}

ConsistencyResult CudaFusion::FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                                  const FusionOptions& options) {
  return queue_.OnDevice([&] {
    const Setup setup = SetUpViews(reference, sources, MakeFusionLimits(options), FusionMapsOf, &queue_);
    QueueFilter(setup);
    const int width = setup.reference().depth.width, height = setup.reference().depth.height;
    ConsistencyResult result = {Image<unsigned char>(width, height), ConfidenceMap(width, height), {}};
    download_.Run(confidence_, result.confidence.size(), queue_.stream(), result.confidence.data());
    download_.Run(consistent_views_, result.consistent_views.size(), queue_.stream(), result.consistent_views.data());
    result.points_in_camera = DownloadPoints();
    return result;
  });
}

ConfidenceMap CudaFusion::MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                            const FusionOptions& options) {
  return queue_.OnDevice([&] {
    const Setup setup = SetUpViews(reference, sources, MakeFusionLimits(options), FusionMapsOf, &queue_);
    QueueFilter(setup);
    ConfidenceMap confidence(setup.reference().depth.width, setup.reference().depth.height);
    download_.Run(confidence_, confidence.size(), queue_.stream(), confidence.data());
    return confidence;
  });
}

std::unique_ptr<FusionStamps> CudaFusion::MakeStamps() { return std::make_unique<CudaStamps>(); }

PointCloud CudaFusion::FuseView(const EngineView& reference, const std::vector<EngineView>& sources,
                                const FusionOptions& options, int rank, FusionStamps* stamps) {
  CudaStamps& gpu_stamps = CastCudaStamps(stamps);
  const Stamp stamp = StampOfRank(rank);
  return queue_.OnDevice([&] {
    Setup setup(PosedCameraOf(reference), FusionMapsOf(reference, &queue_), MakeFusionLimits(options),
                reference.cam_from_world().inverse());
    setup.SetStamps(gpu_stamps.Of(*reference.frame, queue_), stamp);
    for (const EngineView& source : sources) {
      if (!source.estimate) continue;
      setup.AddSource(PosedCameraOf(source), FusionMapsOf(source, &queue_), gpu_stamps.Of(*source.frame, queue_));
    }
    const PinholeCamera& camera = reference.frame->camera;
    LaunchFuseView(Upload(setup), ReservePoints(camera.width, camera.height), queue_.stream().get());
    return DownloadPoints();
  });
}

Image<unsigned char> CudaFusion::UsedPixels(const Frame& frame, FusionStamps* stamps) {
  CudaStamps& gpu_stamps = CastCudaStamps(stamps);
  return queue_.OnDevice([&] {
    const ImageView<Stamp> on_device = gpu_stamps.Of(frame, queue_);
    Image<Stamp> on_host(on_device.width, on_device.height);
    CudaCheck(cudaMemcpyAsync(on_host.data(), on_device.data, on_host.size() * sizeof(Stamp), cudaMemcpyDeviceToHost,
                              queue_.stream().get()),
              "download stamps");
    queue_.stream().Synchronize();
    return UsedOf({on_host.data(), on_host.width(), on_host.height(), on_host.width()});
  });
}

void CudaFusion::SetUsedPixels(const Frame& frame, const Image<unsigned char>& used, FusionStamps* stamps) {
  CudaStamps& gpu_stamps = CastCudaStamps(stamps);
  const Image<Stamp> on_host = StampsOfUsed(used, frame.camera);
  queue_.OnDevice([&] {
    const ImageView<Stamp> on_device = gpu_stamps.Of(frame, queue_);
    CudaCheck(cudaMemcpyAsync(on_device.data, on_host.data(), on_host.size() * sizeof(Stamp), cudaMemcpyHostToDevice,
                              queue_.stream().get()),
              "upload stamps");
    queue_.stream().Synchronize();
  });
}

}  // namespace acmp
