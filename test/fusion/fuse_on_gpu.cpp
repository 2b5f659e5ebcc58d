#include "fusion/fuse_on_gpu.h"

#include <memory>
#include <utility>

#include "acmp_mapping/fusion/fusion_setup.h"
#include "fusion_runner.h"

namespace acmp {
namespace {

/// A copy of an image on the device, without padding.
template <class T>
class DeviceCopy {
 public:
  DeviceCopy() = default;
  DeviceCopy(const Image<T>& image, const CudaDevicePtr& device, const CudaStream& stream)
      : DeviceCopy(image.View(), device, stream) {}
  DeviceCopy(const ImageView<const T>& image, const CudaDevicePtr& device, const CudaStream& stream)
      : array_(device, static_cast<size_t>(image.width) * image.height) {
    if (image.empty()) return;
    view_ = {array_.data(), image.width, image.height, image.width};
    const size_t row_bytes = static_cast<size_t>(image.width) * sizeof(T);
    CudaCheck(cudaMemcpy2DAsync(array_.data(), row_bytes, image.data, static_cast<size_t>(image.stride) * sizeof(T),
                                row_bytes, static_cast<size_t>(image.height), cudaMemcpyHostToDevice, stream.get()),
              "upload map");
    stream.Synchronize();
  }
  const ImageView<T>& View() const { return view_; }

 private:
  DeviceArray<T> array_;
  ImageView<T> view_;
};

PlaneMap PlanesWithNormals(const ImageView<const Vec3f>& normals) {
  PlaneMap planes(normals.width, normals.height);
  for (int row = 0; row < normals.height; ++row) {
    for (int col = 0; col < normals.width; ++col) {
      const Vec3f& normal = normals(col, row);
      planes(col, row) = {normal.x, normal.y, normal.z, 0};  // fusion reads no distances
    }
  }
  return planes;
}

/// One view's maps and unused stamps.
struct UploadedView {
  UploadedView(const FusionView& view, const CudaDevicePtr& device, const CudaStream& stream)
      : camera(CameraOf(view)),
        depth(view.depth, device, stream),
        normal(PlanesWithNormals(view.normal), device, stream),
        cost(view.cost, device, stream),
        color(view.color, device, stream),
        stamps(Image<Stamp>(view.depth.width, view.depth.height, kUnusedStamp), device, stream) {}

  DeviceFusionView maps() const { return {depth.View(), normal.View(), cost.View(), color.View()}; }

  PosedCamera camera;
  DeviceCopy<float> depth;
  DeviceCopy<PlaneHypothesis> normal;
  DeviceCopy<float> cost;
  DeviceCopy<Rgb> color;
  DeviceCopy<Stamp> stamps;
};

/// run(runner, setup, stream) with everything uploaded; an empty result without reference.
template <class Run>
auto RunOnGpu(const FusionView& reference, const std::vector<FusionView>& sources, const FusionOptions& options,
              int cuda_index, const Run& run) {
  using Result = decltype(run(std::declval<FusionRunner&>(), std::declval<FusionSetup<DeviceFusionView>&>(),
                              std::declval<CudaStream&>()));
  const FusionLimits limits = MakeFusionLimits(options);
  if (reference.depth.empty()) return Result();
  CheckConsistencyInput(reference, sources, kMaxCudaFusionSources);
  const auto device = std::make_shared<CudaDevice>(cuda_index);
  const CudaStream stream;
  const UploadedView uploaded_reference(reference, device, stream);
  FusionSetup<DeviceFusionView> setup(CameraOf(reference), uploaded_reference.maps(), limits,
                                      RigidTransform::Identity());
  std::vector<std::unique_ptr<UploadedView>> uploaded;
  for (const FusionView& source : sources) {
    if (source.depth.empty()) continue;
    uploaded.push_back(std::make_unique<UploadedView>(source, device, stream));
    setup.AddSource(CameraOf(source), uploaded.back()->maps());
  }
  FusionRunner runner(device);
  return run(runner, setup, stream);
}

}  // namespace

ConsistencyResult FilterByConsistencyCuda(const FusionView& reference, const std::vector<FusionView>& sources,
                                          const FusionOptions& options, int cuda_index) {
  return RunOnGpu(
      reference, sources, options, cuda_index,
      [](FusionRunner& runner, const auto& setup, const auto& stream) { return runner.Filter(setup, stream); });
}

ConfidenceMap MeasureConfidenceCuda(const FusionView& reference, const std::vector<FusionView>& sources,
                                    const FusionOptions& options) {
  return RunOnGpu(reference, sources, options, 0, [](FusionRunner& runner, const auto& setup, const auto& stream) {
    return runner.MeasureConfidence(setup, stream);
  });
}

PointCloud FuseDepthMapsCuda(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                             const FusionOptions& options, int cuda_index) {
  const FusionLimits limits = MakeFusionLimits(options);
  CheckFusionInput(views, neighbors, kMaxCudaFusionSources);
  const auto device = std::make_shared<CudaDevice>(cuda_index);
  const CudaStream stream;
  std::vector<std::unique_ptr<UploadedView>> uploaded;
  uploaded.reserve(views.size());
  for (const FusionView& view : views) {
    uploaded.push_back(view.depth.empty() ? nullptr : std::make_unique<UploadedView>(view, device, stream));
  }
  FusionRunner runner(device);
  PointCloud points_in_world;
  for (size_t i = 0; i < views.size(); ++i) {
    const FusionView& view = views[i];
    if (view.depth.empty()) continue;
    FusionSetup<DeviceFusionView> setup(uploaded[i]->camera, uploaded[i]->maps(), limits,
                                        view.cam_from_world.inverse());
    setup.SetStamps(uploaded[i]->stamps.View(), static_cast<Stamp>(i));
    for (int source : neighbors[i]) {
      if (views[source].depth.empty()) continue;
      setup.AddSource(uploaded[source]->camera, uploaded[source]->maps(), uploaded[source]->stamps.View());
    }
    const PointCloud points = runner.Fuse(setup, view.depth.width, view.depth.height, stream);
    points_in_world.insert(points_in_world.end(), points.begin(), points.end());
  }
  return points_in_world;
}

}  // namespace acmp
