#pragma once

#include <memory>
#include <vector>

#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_device.h"
#include "patch_match_kernels.h"

namespace acmp {

/// A layer of a device's images, given back at the end.
class ImageLayer {
 public:
  ImageLayer(CudaDevicePtr device, int level, int width, int height, const CudaStream& stream);
  ~ImageLayer();
  ImageLayer(const ImageLayer&) = delete;
  ImageLayer& operator=(const ImageLayer&) = delete;

  int layer() const { return layer_; }

 private:
  CudaDevicePtr device_;
  int level_;
  int layer_;
};

/// What a pass reads and writes, all in device memory.
struct PassData {
  int level = 0;  ///< of the images
  int reference_layer = 0;
  std::vector<int> source_layers;
  std::vector<HalvedDepth> source_depths;           ///< empty ones: no map; ours
  std::vector<ImageView<const float>> full_depths;  ///< the same of the papers' geometric passes
  PlaneHypothesis* planes = nullptr;
  float* cost = nullptr;
  uint32_t* selected_views = nullptr;
  PriorMap prior = {};  ///< planar-prior pass only
};

/// A stream and the memory of one problem at a time: runs passes on device data.
class PassRunner {
 public:
  explicit PassRunner(CudaDevicePtr device) : device_(std::move(device)) {}

  const CudaDevicePtr& device() const { return device_; }
  const CudaStream& stream() const { return stream_; }

  /// The context of a pass, until the next call. Queues the upload of what it points to: whoever then starts a clock on
  /// the stream does not count the host's work. The caller holds images_mutex() shared from here until the stream has
  /// been waited for.
  /// @param problem cameras, poses and depth range at the level of the images
  CudaMatchContext Prepare(const PatchMatchProblem& problem, const PatchMatchOptions& options, const PassData& data,
                           Pass kind, int geometric_pass);

  template <Pass kPass>
  void Queue(const CudaMatchContext& context, int iterations) {
    VisitMethod<kPass>(context.options.method,
                       [&](auto method) { LaunchPass<kPass, method>(context, iterations, stream_.get()); });
  }

  /// Queues RestorePixel for all pixels.
  void QueueRestoreDetails(const CudaMatchContext& context, const CoarserEstimate& coarser) {
    LaunchRestoreDetails(context, coarser, stream_.get());
  }

  /// Queues EvidenceOfCell for all cells.
  /// @param context of a geometric pass
  /// @param evidence in device memory, of CellsOf the reference's size
  void QueueEvidence(const CudaMatchContext& context, int cell_size, const ImageView<float>& evidence) {
    LaunchMeasureEvidence(context, cell_size, evidence, stream_.get());
  }

 private:
  CudaDevicePtr device_;
  CudaStream stream_;
  DeviceArray<SourceView> views_;
  DeviceArray<ImageView<const float>> full_depths_;
  PinnedBuffer host_views_, host_full_depths_;
};

}  // namespace acmp
