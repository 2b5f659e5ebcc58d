#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <memory>
#include <mutex>
#include <shared_mutex>
#include <string>
#include <utility>
#include <vector>

#include "cuda_handles.h"
#include "kernels.h"
#include "staged_copy.h"

namespace acmp {

/// What all of an engine's work on a GPU takes: device, stream, clock and copies; and the ways of images and estimates
/// to the device, back, and from one GPU to another.
class CudaTransfers : public DepthEngine {
 public:
  explicit CudaTransfers(CudaDevicePtr device) : device_(std::move(device)) {}

  size_t DeviceBytes() const override { return device_->Bytes(); }
  size_t FreeDeviceBytes() const override {
    device_->MakeCurrent();
    size_t free = 0, total = 0;
    CudaCheck(cudaMemGetInfo(&free, &total), "read free memory");
    return free;
  }
  std::string device_name() const override {
    return Concat(device_->properties().name, " (cuda:", device_->index(), ")");
  }
  double PopDeviceTime() override { return std::exchange(counted_ms_, 0.0); }

  EngineImagePtr Load(const FramePtr& frame, int levels) override {
    CheckLoad(frame, levels);
    return OnDevice([&] {
      auto image = std::make_shared<CudaImage>(device_);
      PinholeCamera camera = frame->camera;
      for (int level = 0; level <= levels; ++level, camera = camera.Halved()) {
        image->layers.push_back(
            device_->images(level).Acquire(camera.width, camera.height, stream_, &device_->images_mutex()));
      }
      const std::shared_lock<FairSharedMutex> images(device_->images_mutex());
      device_->images(0).Upload(frame->gray.View(), image->Layer(0), &staging_, stream_);
      for (int level = 1; level <= levels; ++level) {
        device_->images(level).QueueHalf(device_->images(level - 1), image->Layer(level - 1), image->Layer(level),
                                         stream_);
      }
      stream_.Synchronize();
      if (frame->mask.empty()) return EngineImagePtr(image);
      for (const MaskDistanceMap& of_level : MakeMaskDistances(*frame, levels)) {
        image->mask_distances.push_back(CopyToDevice(of_level));
      }
      return EngineImagePtr(image);
    });
  }
  EstimateMaps Download(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] {
      EstimateMaps result;
      std::vector<StagedDownload::Block> blocks;
      AddFetch(maps.depth, &result.depth, &blocks);
      StagedDownload::AddBlocks(
          maps.planes.pixels, maps.Pixels(),
          [&](size_t begin, const PlaneHypothesis* planes, size_t size) {
            if (begin == 0) result.normal = NormalMap(maps.width, maps.height);
            Vec3f* normals = result.normal.data() + begin;
            tbb::parallel_for(tbb::blocked_range<size_t>(0, size, 1 << 15),
                              [&](const tbb::blocked_range<size_t>& range) {
                                for (size_t i = range.begin(); i < range.end(); ++i) normals[i] = planes[i].normal();
                              });
          },
          &blocks);
      AddFetch(maps.cost, &result.cost, &blocks);
      download_.Run(blocks, stream_);
      return result;
    });
  }
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] { return Fetch(maps.depth); });
  }
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
    return OnDevice([&] { return EstimateState{Fetch(maps.planes), Fetch(maps.cost)}; });
  }
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override {
    CheckUpload(state, camera);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> estimate = NewEstimate(camera);
      estimate->planes.pixels.Upload(state.planes.data(), estimate->Pixels(), stream_);
      estimate->cost.pixels.Upload(state.cost.data(), estimate->Pixels(), stream_);
      QueueDepths(camera, estimate.get());
      stream_.Synchronize();
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override {
    const PlaneMap planes = MakePlanes(maps, camera);
    const DepthMap depth = Clone(maps.depth);
    const CostMap cost = Clone(maps.cost);
    return OnDevice([&] {
      const std::shared_ptr<CudaEstimate> estimate = NewEstimate(camera);
      estimate->planes.pixels.Upload(planes.data(), planes.size(), stream_);
      estimate->depth.pixels.Upload(depth.data(), depth.size(), stream_);
      estimate->cost.pixels.Upload(cost.data(), cost.size(), stream_);
      stream_.Synchronize();
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override {
    const auto* from = dynamic_cast<const CudaEstimate*>(estimate.get());
    if (from == nullptr) throw InvalidInputError("a handle is null or not of a GPU");
    if (from->device == device_) return estimate;
    return OnDevice([&] {
      auto copy = std::make_shared<CudaEstimate>(device_, from->width, from->height);
      copy->planes.pixels.CopyFromPeer(from->planes.pixels, copy->Pixels(), stream_);
      copy->cost.pixels.CopyFromPeer(from->cost.pixels, copy->Pixels(), stream_);
      copy->depth.pixels.CopyFromPeer(from->depth.pixels, copy->Pixels(), stream_);
      stream_.Synchronize();
      return EngineEstimatePtr(copy);
    });
  }

 protected:
  /// Throws InvalidInputError for null and for what belongs to another device.
  template <class Handle, class Base>
  const Handle& Cast(const std::shared_ptr<const Base>& handle) const {
    const auto* cast = dynamic_cast<const Handle*>(handle.get());
    if (cast == nullptr || cast->device != device_) {
      throw InvalidInputError("a handle is null or belongs to another device");
    }
    return *cast;
  }
  /// Runs `work` with the device selected for this thread; after a failure nothing is left under way.
  template <class Work>
  auto OnDevice(const Work& work) -> decltype(work()) {
    device_->MakeCurrent();
    try {
      return work();
    } catch (...) {
      cudaStreamSynchronize(stream_.get());  // queued work must not outlive the memory it uses
      cudaGetLastError();
      throw;
    }
  }
  void StartClock() { begin_.Record(stream_); }
  /// Waits for all that was queued and counts the device's time since StartClock.
  void FinishClock() {
    end_.Record(stream_);
    stream_.Synchronize();
    counted_ms_ += CudaEvent::ElapsedMs(begin_, end_);
  }

  /// Adds the copy of a map to host memory.
  /// @param fetched allocated with the first block, while the next one is copied
  template <class T>
  static void AddFetch(const DeviceMap<T>& map, Image<T>* fetched, std::vector<StagedDownload::Block>* blocks) {
    const int width = map.width, height = map.height;
    StagedDownload::AddBlocks(
        map.pixels, static_cast<size_t>(width) * height,
        [=](size_t begin, const T* block, size_t size) {
          if (begin == 0) *fetched = Image<T>(width, height);
          ParallelCopy(block, size, fetched->data() + begin);
        },
        blocks);
  }
  /// The map in host memory.
  template <class T>
  Image<T> Fetch(const DeviceMap<T>& map) {
    Image<T> fetched;
    std::vector<StagedDownload::Block> blocks;
    AddFetch(map, &fetched, &blocks);
    download_.Run(blocks, stream_);
    return fetched;
  }
  /// The map on the device; waits for the copy.
  template <class T>
  DeviceMap<T> CopyToDevice(const Image<T>& map) {
    DeviceMap<T> copy(device_, map.width(), map.height());
    T* staged = staging_.Reserve<T>(map.size());
    ParallelCopy(map.data(), map.size(), staged);
    copy.pixels.Upload(staged, map.size(), stream_);
    stream_.Synchronize();
    return copy;
  }
  /// The view's colours; empty where the frame has none.
  ImageView<const Rgb> ColorOf(const EngineView& view) {
    if (view.frame->color.empty()) return {};
    const CudaImage& image = Cast<CudaImage>(view.image);
    const std::lock_guard<std::mutex> lock(image.color_mutex);
    if (image.color.width == 0) image.color = CopyToDevice(view.frame->color);
    return std::as_const(image.color).View();
  }

  std::shared_ptr<CudaEstimate> NewEstimate(const PinholeCamera& camera) const {
    return std::make_shared<CudaEstimate>(device_, camera.width, camera.height);
  }
  /// An estimate with the start's planes and costs: itself if nobody else holds it, else a copy that is queued.
  std::shared_ptr<CudaEstimate> Continue(const EngineEstimatePtr& start) const {
    const CudaEstimate& from = Cast<CudaEstimate>(start);
    if (IsUnique(start)) {
      // It was not made const, and nobody is left to see it.
      auto used_up = std::const_pointer_cast<CudaEstimate>(std::static_pointer_cast<const CudaEstimate>(start));
      used_up->inverse_depth = {};
      return used_up;
    }
    auto copy = std::make_shared<CudaEstimate>(device_, from.width, from.height);
    copy->planes.pixels.CopyFrom(from.planes.pixels, from.Pixels(), stream_);
    copy->cost.pixels.CopyFrom(from.cost.pixels, from.Pixels(), stream_);
    return copy;
  }
  /// Queues the depths of the estimate's planes.
  void QueueDepths(const PinholeCamera& camera, CudaEstimate* estimate) const {
    LaunchToDepth(estimate->planes.View(), MakeRayGrid(camera), estimate->depth.View(), stream_.get());
  }

  const CudaDevicePtr device_;
  const CudaStream stream_;
  PinnedBuffer staging_;  ///< for one copy at a time, which is waited for before the next use
  StagedDownload download_;

 private:
  CudaEvent begin_, end_;
  double counted_ms_ = 0;
};

}  // namespace acmp
