#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "cuda_estimate.h"
#include "cuda_image.h"
#include "fusion_kernels.h"
#include "staged_copy.h"

namespace acmp {

/// A view's maps without colours. Throws InvalidInputError without an estimate of this GPU.
inline FusionMaps DeviceMapsOf(const EngineView& view, const DeviceQueue& queue) {
  const CudaEstimate& estimate = queue.Cast<CudaEstimate>(view.estimate);
  return {estimate.DepthView(), estimate.PlaneView(), estimate.CostView(), {}};
}

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

/// What is made of finished estimates on the GPU, with the memory of one reference view at a time.
class CudaFusion : public virtual DepthEngine {
 public:
  /// @param queue outlives this
  explicit CudaFusion(DeviceQueue* queue) : queue_(*queue) {}

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    return Check(reference, sources, options, true);
  }
  ConfidenceMap MeasureConfidence(const EngineView& reference, const std::vector<EngineView>& sources,
                                  const FusionOptions& options) override {
    return Check(reference, sources, options, false).confidence;
  }
  std::unique_ptr<FusionStamps> MakeFusionStamps() override { return std::make_unique<CudaStamps>(); }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    CudaStamps& gpu_stamps = CastStamps(stamps);
    const auto stamps_of = [&](const Frame& frame) { return gpu_stamps.Of(frame, queue_); };
    return queue_.OnDevice([&] {
      const FusionSetup setup =
          SetUpFusion(reference, sources, MakeFusionLimits(options), ColoredMaps(), stamps_of, StampOfRank(rank));
      const FusionContext context = Upload(setup);
      return Collect(PixelsOf(setup), [&](const PixelRange& range, const PointOutput& output) {
        LaunchFuseView(context, range, output, queue_.stream().get());
      });
    });
  }

 private:
  static CudaStamps& CastStamps(FusionStamps* stamps) {
    auto* gpu_stamps = dynamic_cast<CudaStamps*>(stamps);
    if (gpu_stamps == nullptr) throw InvalidInputError("stamps: null or not of a GPU");
    return *gpu_stamps;
  }
  static size_t PixelsOf(const FusionSetup& setup) {
    return static_cast<size_t>(setup.camera().width) * setup.camera().height;
  }

  /// What gives a view's maps with its colours, where the frame has some.
  std::function<FusionMaps(const EngineView&)> ColoredMaps() {
    return [this](const EngineView& view) {
      FusionMaps maps = DeviceMapsOf(view, queue_);
      maps.color = ColorOf(view, &queue_);
      return maps;
    };
  }
  /// The setup on the device, with the odds of its depths queued.
  FusionContext Upload(const FusionSetup& setup) {
    const size_t count = setup.sources().size();
    sources_.Reserve(queue_.device(), count);
    if (count > 0) sources_.Upload(setup.sources().data(), count, queue_.stream());
    log_odds_.Reserve(queue_.device(), PixelsOf(setup));
    return LaunchOdds(setup.Context(sources_.data()), log_odds_.data(), queue_.stream().get());
  }
  /// @param with_points else the confidences alone
  ConsistencyResult Check(const EngineView& reference, const std::vector<EngineView>& sources,
                          const FusionOptions& options, bool with_points) {
    return queue_.OnDevice([&] {
      const FusionSetup setup = SetUpFusion(reference, sources, MakeFusionLimits(options), ColoredMaps());
      const int width = setup.camera().width, height = setup.camera().height;
      const FusionContext context = Upload(setup);
      confidence_.Reserve(queue_.device(), PixelsOf(setup));
      const auto launch = [&](const PixelRange& range, const PointOutput& output) {
        LaunchFilterByConsistency(context, range, {confidence_.data(), width, height, width}, output,
                                  queue_.stream().get());
      };
      ConsistencyResult result;
      if (with_points) {
        result.points_in_camera = Collect(PixelsOf(setup), launch);
      } else {
        launch({0, PixelsOf(setup)}, {});
      }
      result.confidence = ConfidenceMap(width, height);
      download_.Run(confidence_, result.confidence.size(), queue_.stream(), result.confidence.data());
      return result;
    });
  }
  /// launch(range, output) for all pixels, a part after the other, so that the device needs room for the points of one
  /// part. The host takes those of the part before meanwhile.
  template <class Launch>
  PointCloud Collect(size_t pixels, const Launch& launch) {
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

  DeviceQueue& queue_;
  PinnedBuffer points_on_host_, counts_on_host_;
  CudaEvent filled_[2];
  StagedDownload download_;
  DeviceArray<FusionSource> sources_;
  DeviceArray<SurfacePoint> of_pixels_, points_;
  DeviceArray<unsigned char> accepted_, scratch_;
  DeviceArray<unsigned> count_;
  DeviceArray<float> confidence_, log_odds_;
};

}  // namespace acmp
