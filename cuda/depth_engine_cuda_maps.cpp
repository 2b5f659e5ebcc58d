// CudaDepthEngine: maps and states to and from the device.

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "cuda_depth_engine.h"

namespace acmp {

EstimateMaps CudaDepthEngine::Download(const EngineEstimatePtr& estimate) {
  const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
  return OnDevice([&] {
    const size_t pixels = maps.Pixels();
    EstimateMaps result = {DepthMap(maps.width, maps.height), NormalMap(maps.width, maps.height),
                           CostMap(maps.width, maps.height)};
    download_.Run(maps.depth, pixels, stream(), result.depth.data());
    download_.Run(maps.cost, pixels, stream(), result.cost.data());
    download_.Run(maps.planes, pixels, stream(), [&](size_t begin, const PlaneHypothesis* planes, size_t size) {
      Vec3f* normals = result.normal.data() + begin;
      tbb::parallel_for(tbb::blocked_range<size_t>(0, size, 1 << 15), [&](const tbb::blocked_range<size_t>& range) {
        for (size_t i = range.begin(); i < range.end(); ++i) normals[i] = planes[i].normal();
      });
    });
    return result;
  });
}

DepthMap CudaDepthEngine::DownloadDepth(const EngineEstimatePtr& estimate) {
  const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
  return OnDevice([&] {
    DepthMap depth(maps.width, maps.height);
    download_.Run(maps.depth, maps.Pixels(), stream(), depth.data());
    return depth;
  });
}

EstimateState CudaDepthEngine::DownloadState(const EngineEstimatePtr& estimate) {
  const CudaEstimate& maps = Cast<CudaEstimate>(estimate);
  return OnDevice([&] {
    EstimateState state = {PlaneMap(maps.width, maps.height), CostMap(maps.width, maps.height)};
    download_.Run(maps.planes, maps.Pixels(), stream(), state.planes.data());
    download_.Run(maps.cost, maps.Pixels(), stream(), state.cost.data());
    return state;
  });
}

EngineEstimatePtr CudaDepthEngine::UploadState(EstimateState state, const PinholeCamera& camera) {
  CheckUpload(state, camera);
  return OnDevice([&] {
    auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
    const size_t pixels = estimate->Pixels();
    estimate->planes.Upload(state.planes.data(), pixels, stream());
    estimate->cost.Upload(state.cost.data(), pixels, stream());
    QueueDepths(camera, estimate.get());
    stream().Synchronize();
    return estimate;
  });
}

EngineEstimatePtr CudaDepthEngine::Import(const EngineEstimatePtr& estimate) {
  const auto* from = dynamic_cast<const CudaEstimate*>(estimate.get());
  if (from == nullptr) throw InvalidInputError("a handle is null or not of a GPU");
  if (from->device == runner_.device().get()) return estimate;
  return OnDevice([&] {
    auto copy = std::make_shared<CudaEstimate>(runner_.device(), from->width, from->height);
    copy->planes.CopyFromPeer(from->planes, copy->Pixels(), stream());
    copy->cost.CopyFromPeer(from->cost, copy->Pixels(), stream());
    copy->depth.CopyFromPeer(from->depth, copy->Pixels(), stream());
    stream().Synchronize();
    return copy;
  });
}

EngineEstimatePtr CudaDepthEngine::UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) {
  CheckUpload(maps, camera);
  return OnDevice([&] {
    auto estimate = std::make_shared<CudaEstimate>(runner_.device(), camera);
    const size_t pixels = estimate->Pixels();
    auto* planes = staging_.Reserve<PlaneHypothesis>(pixels + pixels / 2 + 1);
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
    estimate->planes.Upload(planes, pixels, stream());
    estimate->depth.Upload(depth, pixels, stream());
    estimate->cost.Upload(cost, pixels, stream());
    stream().Synchronize();
    return estimate;
  });
}

}  // namespace acmp
