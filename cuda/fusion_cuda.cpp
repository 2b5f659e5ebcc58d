#include "acmp_mapping/backend/fusion_cuda.h"

#include <memory>

#include "acmp_mapping/fusion/fusion_setup.h"
#include "cuda_device.h"
#include "cuda_resources.h"
#include "fusion_kernels.h"

namespace acmp {
namespace {

/// An image on the device, without padding.
template <class T>
class DeviceImage {
 public:
  void Resize(int width, int height) {
    buffer_.Resize(static_cast<size_t>(width) * height);
    view_ = {buffer_.data(), width, height, width};
  }

  /// Resizes and copies; the image must stay valid until the stream has been synchronised.
  void Upload(const ImageView<const T>& image, const CudaStream& stream) {
    Resize(image.width, image.height);
    if (image.empty()) return;
    const size_t row_bytes = static_cast<size_t>(image.width) * sizeof(T);
    CudaCheck(cudaMemcpy2DAsync(view_.data, row_bytes, image.data, static_cast<size_t>(image.stride) * sizeof(T),
                                row_bytes, static_cast<size_t>(image.height), cudaMemcpyHostToDevice, stream.get()),
              "upload map");
  }

  Image<T> Download(const CudaStream& stream) const {
    Image<T> image(view_.width, view_.height);
    buffer_.Download(image.data(), stream);
    stream.Synchronize();
    return image;
  }

  const ImageView<T>& View() const { return view_; }

 private:
  DeviceBuffer<T> buffer_;
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

/// One view's maps and stamps.
class UploadedView {
 public:
  UploadedView(const FusionView& view, bool with_stamps, const CudaStream& stream) : camera_(CameraOf(view)) {
    const PlaneMap planes = PlanesWithNormals(view.normal);
    depth_.Upload(view.depth, stream);
    normal_.Upload(planes.View(), stream);
    cost_.Upload(view.cost, stream);
    color_.Upload(view.color, stream);
    if (with_stamps) ResetStamps(view.depth.width, view.depth.height, stream);
    stream.Synchronize();
  }

  const PosedCamera& camera() const { return camera_; }
  DeviceFusionView maps() const { return {depth_.View(), normal_.View(), cost_.View(), color_.View()}; }
  const ImageView<Stamp>& stamps() const { return stamps_.View(); }

 private:
  void ResetStamps(int width, int height, const CudaStream& stream) {
    static_assert(kUnusedStamp == 0xffff, "both bytes are set to 0xff");
    stamps_.Resize(width, height);
    CudaCheck(
        cudaMemsetAsync(stamps_.View().data, 0xff, static_cast<size_t>(width) * height * sizeof(Stamp), stream.get()),
        "reset stamps");
  }

  PosedCamera camera_;
  DeviceImage<float> depth_, cost_;
  DeviceImage<PlaneHypothesis> normal_;
  DeviceImage<Rgb> color_;
  DeviceImage<Stamp> stamps_;
};

/// Points and the memory to collect them, for views of any size.
class PointBuffers {
 public:
  PointBuffers() { count_.Resize(1); }

  PointOutput Reserve(int width, int height) {
    points_.Resize(static_cast<size_t>(width) * height);
    scratch_.Resize(PointScratchBytes(width, height));
    return {points_.data(), count_.data(), scratch_.data()};
  }

  void AppendTo(PointCloud* points, const CudaStream& stream) const {
    unsigned count = 0;
    count_.Download(&count, stream);
    stream.Synchronize();
    const size_t before = points->size();
    points->resize(before + count);
    CudaCheck(cudaMemcpyAsync(points->data() + before, points_.data(), count * sizeof(SurfacePoint),
                              cudaMemcpyDeviceToHost, stream.get()),
              "download points");
    stream.Synchronize();
  }

 private:
  DeviceBuffer<SurfacePoint> points_;
  DeviceBuffer<unsigned> count_;
  DeviceBuffer<unsigned char> scratch_;
};

/// The setup's context with its sources on the device.
DeviceFusionContext UploadContext(const FusionSetup<DeviceFusionView>& setup, DeviceBuffer<DeviceFusionSource>* sources,
                                  const CudaStream& stream) {
  sources->Resize(setup.sources().size());
  sources->Upload(setup.sources().data(), stream);
  stream.Synchronize();
  return setup.Context(sources->data());
}

}  // namespace

ConsistencyResult FilterByConsistencyCuda(const FusionView& reference, const std::vector<FusionView>& sources,
                                          const FusionOptions& options, int cuda_index) {
  const FusionLimits limits = MakeFusionLimits(options);
  if (reference.depth.empty()) return {};
  CheckConsistencyInput(reference, sources, kMaxCudaFusionSources);
  SelectDevice(cuda_index);
  const CudaStream stream;
  const UploadedView uploaded_reference(reference, false, stream);
  FusionSetup<DeviceFusionView> setup(CameraOf(reference), uploaded_reference.maps(), limits,
                                      RigidTransform::Identity());
  std::vector<std::unique_ptr<UploadedView>> uploaded;
  for (const FusionView& source : sources) {
    if (source.depth.empty()) continue;
    uploaded.push_back(std::make_unique<UploadedView>(source, false, stream));
    setup.AddSource(CameraOf(source), uploaded.back()->maps());
  }
  DeviceBuffer<DeviceFusionSource> device_sources;
  const DeviceFusionContext context = UploadContext(setup, &device_sources, stream);

  const int width = reference.depth.width, height = reference.depth.height;
  DeviceImage<unsigned char> consistent_views;
  DeviceImage<float> confidence;
  consistent_views.Resize(width, height);
  confidence.Resize(width, height);
  PointBuffers points;
  LaunchFilterByConsistency(context, consistent_views.View(), confidence.View(), points.Reserve(width, height),
                            stream.get());
  ConsistencyResult result = {consistent_views.Download(stream), confidence.Download(stream), {}};
  points.AppendTo(&result.points_in_camera, stream);
  return result;
}

PointCloud FuseDepthMapsCuda(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                             const FusionOptions& options, int cuda_index) {
  const FusionLimits limits = MakeFusionLimits(options);
  CheckFusionInput(views, neighbors, kMaxCudaFusionSources);
  SelectDevice(cuda_index);
  const CudaStream stream;
  std::vector<std::unique_ptr<UploadedView>> uploaded;
  uploaded.reserve(views.size());
  for (const FusionView& view : views) {
    uploaded.push_back(view.depth.empty() ? nullptr : std::make_unique<UploadedView>(view, true, stream));
  }

  PointCloud points_in_world;
  PointBuffers points;
  DeviceBuffer<DeviceFusionSource> device_sources;
  for (size_t i = 0; i < views.size(); ++i) {
    const FusionView& view = views[i];
    if (view.depth.empty()) continue;
    FusionSetup<DeviceFusionView> setup(uploaded[i]->camera(), uploaded[i]->maps(), limits,
                                        view.cam_from_world.inverse());
    setup.SetStamps(uploaded[i]->stamps(), static_cast<Stamp>(i));
    for (int source : neighbors[i]) {
      if (views[source].depth.empty()) continue;
      setup.AddSource(uploaded[source]->camera(), uploaded[source]->maps(), uploaded[source]->stamps());
    }
    const DeviceFusionContext context = UploadContext(setup, &device_sources, stream);
    LaunchFuseView(context, points.Reserve(view.depth.width, view.depth.height), stream.get());
    points.AppendTo(&points_in_world, stream);
  }
  return points_in_world;
}

}  // namespace acmp
