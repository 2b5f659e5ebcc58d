#include "cuda_fusion.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_estimate.h"
#include "cuda_image.h"

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
    static_assert(kUnfusedStamp == 0xffff, "both bytes are set to 0xff");
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

size_t PixelsOf(const FusionSetup<DeviceFusionView>& setup) {
  return static_cast<size_t>(setup.reference().depth.width) * setup.reference().depth.height;
}

CudaStamps& CastCudaStamps(FusionStamps* stamps) {
  auto* gpu_stamps = dynamic_cast<CudaStamps*>(stamps);
  if (gpu_stamps == nullptr) throw InvalidInputError("stamps: null or not of a GPU");
  return *gpu_stamps;
}

}  // namespace

PosedCamera PosedCameraOf(const EngineView& view) {
  if (!view.frame) throw InvalidInputError("frame: must not be null");
  return {view.frame->camera, view.cam_from_world()};
}

DeviceFusionView GeometryMapsOf(const EngineView& view, DeviceQueue* queue) {
  const PosedCamera camera = PosedCameraOf(view);
  const CudaEstimate& estimate = queue->Cast<CudaEstimate>(view.estimate);
  CheckSize("estimate", estimate.width, estimate.height, camera.camera);
  return {estimate.DepthView(), estimate.PlaneView(), estimate.CostView(), {}};
}

DeviceFusionView FusionMapsOf(const EngineView& view, DeviceQueue* queue) {
  DeviceFusionView maps = GeometryMapsOf(view, queue);
  maps.color = ColorOf(view, queue);
  return maps;
}

FusionSetup<DeviceFusionView> SetUpViews(const EngineView& reference, const std::vector<EngineView>& sources,
                                         const FusionLimits& limits,
                                         DeviceFusionView (*maps_of)(const EngineView&, DeviceQueue*),
                                         DeviceQueue* queue) {
  FusionSetup<DeviceFusionView> setup(PosedCameraOf(reference), maps_of(reference, queue), limits,
                                      RigidTransform::Identity());
  for (const EngineView& source : sources) {
    if (source.estimate) setup.AddSource(PosedCameraOf(source), maps_of(source, queue));
  }
  return setup;
}

DeviceFusionContext CudaFusion::Upload(const Setup& setup) {
  const size_t count = setup.sources().size();
  sources_.Reserve(queue_.device(), count);
  if (count > 0) sources_.Upload(setup.sources().data(), count, queue_.stream());
  log_odds_.Reserve(queue_.device(), PixelsOf(setup));
  return LaunchOdds(setup.Context(sources_.data()), log_odds_.data(), queue_.stream().get());
}

ImageView<float> CudaFusion::ReserveConfidence(const Setup& setup) {
  const int width = setup.reference().depth.width, height = setup.reference().depth.height;
  confidence_.Reserve(queue_.device(), PixelsOf(setup));
  return {confidence_.data(), width, height, width};
}

template <class Launch>
PointCloud CudaFusion::Collect(size_t pixels, const Launch& launch) {
  constexpr size_t kLeastPart = 1 << 15, kMostParts = 16;
  const size_t part = std::max(kLeastPart, (pixels + kMostParts - 1) / kMostParts);
  const size_t parts = (pixels + part - 1) / part;
  of_pixels_.Reserve(queue_.device(), part);
  accepted_.Reserve(queue_.device(), part);
  if (points_.size() < part) {
    points_.Reserve(queue_.device(), part);
    // A part comes to the host as a whole, before its count is known: also what is unset behind that.
    CudaCheck(cudaMemsetAsync(points_.data(), 0, part * sizeof(SurfacePoint), queue_.stream().get()), "reset points");
  }
  count_.Reserve(queue_.device(), 1);
  scratch_.Reserve(queue_.device(), PointScratchBytes(part));
  const PointOutput output = {of_pixels_.data(), accepted_.data(), points_.data(),
                              count_.data(),     scratch_.data(),  scratch_.size()};
  auto* staged = points_on_host_.Reserve<SurfacePoint>(2 * part);
  auto* counts = counts_on_host_.Reserve<unsigned>(2);
  PointCloud points;
  points.reserve(pixels);
  for (size_t k = 0; k <= parts; ++k) {
    if (k < parts) {
      const PixelRange range = {k * part, std::min(part, pixels - k * part)};
      launch(range, output);
      count_.Download(counts + k % 2, 1, queue_.stream());
      points_.Download(staged + k % 2 * part, range.count, queue_.stream());
      filled_[k % 2].Record(queue_.stream());
    }
    if (k > 0) {
      const size_t before = (k - 1) % 2;
      filled_[before].Wait();
      points.insert(points.end(), staged + before * part, staged + before * part + counts[before]);
    }
  }
  return points;
}

ConsistencyResult CudaFusion::FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                                  const FusionOptions& options) {
  return queue_.OnDevice([&] {
    const Setup setup = SetUpViews(reference, sources, MakeFusionLimits(options), FusionMapsOf, &queue_);
    const DeviceFusionContext context = Upload(setup);
    const ImageView<float> confidences = ReserveConfidence(setup);
    ConsistencyResult result;
    result.points_in_camera = Collect(PixelsOf(setup), [&](const PixelRange& range, const PointOutput& output) {
      LaunchFilterByConsistency(context, range, confidences, output, queue_.stream().get());
    });
    const int width = setup.reference().depth.width, height = setup.reference().depth.height;
    result.confidence = ConfidenceMap(width, height);
    download_.Run(confidence_, result.confidence.size(), queue_.stream(), result.confidence.data());
    return result;
  });
}

ConfidenceMap CudaFusion::MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                            const FusionOptions& options) {
  return queue_.OnDevice([&] {
    const Setup setup = SetUpViews(reference, sources, MakeFusionLimits(options), FusionMapsOf, &queue_);
    const DeviceFusionContext context = Upload(setup);
    const ImageView<float> confidences = ReserveConfidence(setup);
    LaunchFilterByConsistency(context, {0, PixelsOf(setup)}, confidences, {}, queue_.stream().get());
    ConfidenceMap confidence(setup.reference().depth.width, setup.reference().depth.height);
    download_.Run(confidence_, confidence.size(), queue_.stream(), confidence.data());
    return confidence;
  });
}

std::unique_ptr<FusionStamps> CudaFusion::MakeFusionStamps() { return std::make_unique<CudaStamps>(); }

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
    const DeviceFusionContext context = Upload(setup);
    return Collect(PixelsOf(setup), [&](const PixelRange& range, const PointOutput& output) {
      LaunchFuseView(context, range, output, queue_.stream().get());
    });
  });
}

Image<unsigned char> CudaFusion::FusedPixels(const Frame& frame, FusionStamps* stamps) {
  CudaStamps& gpu_stamps = CastCudaStamps(stamps);
  return queue_.OnDevice([&] {
    const ImageView<Stamp> on_device = gpu_stamps.Of(frame, queue_);
    Image<Stamp> on_host(on_device.width, on_device.height);
    CudaCheck(cudaMemcpyAsync(on_host.data(), on_device.data, on_host.size() * sizeof(Stamp), cudaMemcpyDeviceToHost,
                              queue_.stream().get()),
              "download stamps");
    queue_.stream().Synchronize();
    return FusedOf({on_host.data(), on_host.width(), on_host.height(), on_host.width()});
  });
}

void CudaFusion::SetFusedPixels(const Frame& frame, const Image<unsigned char>& used, FusionStamps* stamps) {
  CudaStamps& gpu_stamps = CastCudaStamps(stamps);
  const Image<Stamp> on_host = StampsOfFused(used, frame.camera);
  queue_.OnDevice([&] {
    const ImageView<Stamp> on_device = gpu_stamps.Of(frame, queue_);
    CudaCheck(cudaMemcpyAsync(on_device.data, on_host.data(), on_host.size() * sizeof(Stamp), cudaMemcpyHostToDevice,
                              queue_.stream().get()),
              "upload stamps");
    queue_.stream().Synchronize();
  });
}

}  // namespace acmp
