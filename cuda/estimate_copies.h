#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "acmp_mapping/engine/depth_engine.h"
#include "cuda_estimate.h"
#include "staged_copy.h"

namespace acmp {

/// The way of estimates to the host, back, and from one GPU to another.
class EstimateCopies : public virtual DepthEngine {
 public:
  /// @param queue outlives this
  explicit EstimateCopies(DeviceQueue* queue) : queue_(*queue) {}

  EstimateMaps Download(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = queue_.Cast<CudaEstimate>(estimate);
    return queue_.OnDevice([&] {
      const size_t pixels = maps.Pixels();
      EstimateMaps result = {DepthMap(maps.width, maps.height), NormalMap(maps.width, maps.height),
                             CostMap(maps.width, maps.height)};
      download_.Run(maps.depth, pixels, queue_.stream(), result.depth.data());
      download_.Run(maps.cost, pixels, queue_.stream(), result.cost.data());
      download_.Run(maps.planes, pixels, queue_.stream(),
                    [&](size_t begin, const PlaneHypothesis* planes, size_t size) {
                      Vec3f* normals = result.normal.data() + begin;
                      tbb::parallel_for(tbb::blocked_range<size_t>(0, size, 1 << 15),
                                        [&](const tbb::blocked_range<size_t>& range) {
                                          for (size_t i = range.begin(); i < range.end(); ++i)
                                            normals[i] = planes[i].normal();
                                        });
                    });
      return result;
    });
  }
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = queue_.Cast<CudaEstimate>(estimate);
    return queue_.OnDevice([&] {
      DepthMap depth(maps.width, maps.height);
      download_.Run(maps.depth, maps.Pixels(), queue_.stream(), depth.data());
      return depth;
    });
  }
  EstimateState DownloadState(const EngineEstimatePtr& estimate) override {
    const CudaEstimate& maps = queue_.Cast<CudaEstimate>(estimate);
    return queue_.OnDevice([&] {
      EstimateState state = {PlaneMap(maps.width, maps.height), CostMap(maps.width, maps.height)};
      download_.Run(maps.planes, maps.Pixels(), queue_.stream(), state.planes.data());
      download_.Run(maps.cost, maps.Pixels(), queue_.stream(), state.cost.data());
      return state;
    });
  }
  EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) override {
    CheckUpload(state, camera);
    return queue_.OnDevice([&] {
      auto estimate = std::make_shared<CudaEstimate>(queue_.device(), camera);
      const size_t pixels = estimate->Pixels();
      estimate->planes.Upload(state.planes.data(), pixels, queue_.stream());
      estimate->cost.Upload(state.cost.data(), pixels, queue_.stream());
      QueueDepths(camera, estimate.get(), queue_.stream());
      queue_.stream().Synchronize();
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) override {
    CheckUpload(maps, camera);
    return queue_.OnDevice([&] {
      auto estimate = std::make_shared<CudaEstimate>(queue_.device(), camera);
      const size_t pixels = estimate->Pixels();
      auto* planes = queue_.staging()->Reserve<PlaneHypothesis>(pixels + pixels / 2 + 1);
      auto* depth = reinterpret_cast<float*>(planes + pixels);
      float* cost = depth + pixels;
      const RayGrid rays = MakeRayGrid(camera);
      tbb::parallel_for(0, camera.height, [&](int row) {
        const size_t begin = static_cast<size_t>(row) * camera.width;
        std::copy_n(&maps.depth(0, row), camera.width, depth + begin);
        std::copy_n(&maps.cost(0, row), camera.width, cost + begin);
        for (int col = 0; col < camera.width; ++col) {
          const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
          planes[begin + col] = PlaneThrough(maps.normal(col, row), ray, maps.depth(col, row));
        }
      });
      estimate->planes.Upload(planes, pixels, queue_.stream());
      estimate->depth.Upload(depth, pixels, queue_.stream());
      estimate->cost.Upload(cost, pixels, queue_.stream());
      queue_.stream().Synchronize();
      return EngineEstimatePtr(estimate);
    });
  }
  EngineEstimatePtr Import(const EngineEstimatePtr& estimate) override {
    const auto* from = dynamic_cast<const CudaEstimate*>(estimate.get());
    if (from == nullptr) throw InvalidInputError("a handle is null or not of a GPU");
    if (from->device == queue_.device().get()) return estimate;
    return queue_.OnDevice([&] {
      auto copy = std::make_shared<CudaEstimate>(queue_.device(), from->width, from->height);
      copy->planes.CopyFromPeer(from->planes, copy->Pixels(), queue_.stream());
      copy->cost.CopyFromPeer(from->cost, copy->Pixels(), queue_.stream());
      copy->depth.CopyFromPeer(from->depth, copy->Pixels(), queue_.stream());
      queue_.stream().Synchronize();
      return EngineEstimatePtr(copy);
    });
  }

 private:
  DeviceQueue& queue_;
  StagedDownload download_;
};

}  // namespace acmp
