#pragma once

#include <cuda_runtime_api.h>

#include "acmp_mapping/fill/kernel/fill_grid.h"
#include "acmp_mapping/fill/kernel/weighted_median.h"
#include "acmp_mapping/fusion/kernel/fusion_context.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/patch_match/kernel/match_context.h"
#include "acmp_mapping/patch_match/kernel/photometric_cost.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "acmp_mapping/planar_prior/kernel/planar_prior.h"

namespace acmp {

struct SupportGrid;

// All launches queue work on a stream; pointers and views, also those in contexts, are device memory.

// Passes.

/// Grey levels per unit of what a texture gives.
constexpr float kGrayPerTexel = 255.0f;

/// Grey values through hardware-filtered textures. The filter's fractions have 8 bits, so values differ from exact
/// interpolation by up to 1/512 of the step between neighbouring pixels, and texels are rounded to 1/257 of a grey
/// level.
struct TextureSampler {
  cudaTextureObject_t images;
  int reference;                ///< layer of the reference
  int layers[kMaxSourceViews];  ///< of each source view

  static constexpr float kPixelCenter = 0.5f;
  static constexpr bool kHasMasks = false;
  /// At a pixel's centre the filter gives its texel as it is.
  ACMP_HOST_DEVICE float Reference(int col, int row) const {
    return SourceAt(reference, static_cast<float>(col) + kPixelCenter, static_cast<float>(row) + kPixelCenter);
  }
  ACMP_HOST_DEVICE int ImageOf(int view) const { return layers[view]; }
#ifdef __CUDA_ARCH__
  __device__ float SourceAt(int image, float x, float y) const {
    return kGrayPerTexel * tex2DLayered<float>(images, x, y, image);
  }
#else
  /// Never run: textures can be read on the device only.
  float SourceAt(int /*image*/, float /*x*/, float /*y*/) const { return 0; }
#endif
};

using CudaMatchContext = MatchContext<TextureSampler>;

/// The same for problems with masks: kernels of their own, since the registers that masks take cost time.
struct MaskedTextureSampler : TextureSampler {
  static constexpr bool kHasMasks = true;
};

/// One pass: initialisation, `iterations` checkerboard iterations, our median filter.
template <Pass kPass, Method kMethod>
void LaunchPass(const CudaMatchContext& context, int iterations, cudaStream_t stream);

/// RestorePixel for all pixels.
void LaunchRestoreDetails(const CudaMatchContext& context, const CoarserEstimate& coarser, cudaStream_t stream);

/// EvidenceOfCell for all cells of `cell_size` px.
void LaunchMeasureEvidence(const CudaMatchContext& context, int cell_size, const ImageView<float>& evidence,
                           cudaStream_t stream);

/// Asks the driver to load the kernels: fails when the build holds no code for the current device.
cudaError_t ProbeKernels();

// Maps and images.

/// z of every pixel's plane; 0 where there is none.
void LaunchToDepth(const ImageView<const PlaneHypothesis>& planes, const RayGrid& rays, const ImageView<float>& depth,
                   cudaStream_t stream);

/// HalvedDepth of a depth map.
/// @param largest a float; becomes the greatest inverse depth, 1 / scene unit, 0 where no depth is known
/// @param inverse of HalvedSize in both directions
void LaunchHalveDepth(const ImageView<const float>& depth, float* largest, const ImageView<uint16_t>& inverse,
                      cudaStream_t stream);

/// Plane (UpsamplePlane) and cost of every pixel from the pixel that covers it in maps halved `level` times.
struct HalvedMaps {
  ImageView<const PlaneHypothesis> planes;
  ImageView<const float> cost;
  RayGrid rays;
  int level;
};
void LaunchUpsample(const HalvedMaps& halved, const RayGrid& rays, const ImageView<PlaneHypothesis>& planes,
                    const ImageView<float>& cost, cudaStream_t stream);

/// Credible pixels per cell of `cell_size` px squared (FindSupportPointOfCell).
struct SupportSearch {
  ImageView<const float> depth, cost;
  float depth_min, depth_max, max_cost;
  int cell_size;
};
void LaunchFindSupport(const SupportSearch& search, const ImageView<SupportPoint>& cells, cudaStream_t stream);

/// The triangles of the prior as the GPU draws them.
struct PriorTriangles {
  const TriangleCorners* corners;
  const PlaneHypothesis* planes;  ///< zero: none
  int count;
};

/// Everything of a grid prior (MakeGridMesh) but its first support points (LaunchFindSupport).
void LaunchGridPrior(const SupportGrid& grid, const RayGrid& rays, float min_cosine, const DepthRange& range,
                     const ImageView<uint32_t>& numbers, cudaStream_t stream);

/// Draws the triangles' numbers, from 1, where their planes lie within [depth_min, depth_max]; the other pixels become
/// zero.
void LaunchRasterizePrior(const PriorTriangles& triangles, const RayGrid& rays, float depth_min, float depth_max,
                          const ImageView<uint32_t>& numbers, cudaStream_t stream);

/// A layer of a texture or surface with the size of the image in it, px.
struct LayerImage {
  int layer, width, height;
};

/// Fills a whole layer, `layer_width` x `layer_height` px of 16 bits, from a layer of a texture: `scale` = 1 copies, 2
/// takes the means of 2 x 2 pixels. Beyond the image its last column and row go on.
void LaunchFillLayer(cudaTextureObject_t source, int source_layer, float scale, cudaSurfaceObject_t destination,
                     const LayerImage& image, int layer_width, int layer_height, cudaStream_t stream);

// Filling.

/// CountSupportingViews for all pixels, the first step of FillUnverified.
/// @param sources compares the reference's maps as they were before
/// @param view support of the reference's size
void LaunchLook(const FusionContext& sources, const ImageView<ViewSupport>& support, cudaStream_t stream);

/// The rest of FillUnverified.
void LaunchFill(const FillContext& context, cudaStream_t stream);

/// The weighted median of the completed maps.
/// @param views compares the completed reference
/// @param view support the same as the context's: of the reference before it was completed
void LaunchWeightedMedian(const FusionContext& views, const ImageView<ViewSupport>& support,
                          const MedianContext& context, cudaStream_t stream);

/// RemoveUnsupported.
/// @param context from MakeTexturedContext, with places for its seeds
void LaunchFreeSpaceCheck(const FillContext& context, const ImageView<const float>& evidence, cudaStream_t stream);

// Fusion.

/// Pixels of the reference, in row-major order, whose points one launch makes.
struct PixelRange {
  size_t first, count;
};

/// Where the points of a range's accepted pixels go, in the order of the pixels; as cudaMalloc gives it, with room for
/// one element per pixel where nothing else is said.
struct PointOutput {
  SurfacePoint* of_pixels;  ///< what each pixel would be, for the launch alone; null: points are not wanted
  unsigned char* accepted;  ///< 1 where it is a point, else 0; for the launch alone
  SurfacePoint* points;
  unsigned* count;  ///< a single one, set to the number of points
  void* scratch;    ///< PointScratchBytes
  size_t scratch_bytes;
};

/// Bytes of scratch memory to gather the points of so many pixels.
size_t PointScratchBytes(size_t pixels);

/// LogOdds of all pixels of the reference into `log_odds`.
/// @return the context with them, for the launches below
FusionContext LaunchOdds(FusionContext context, float* log_odds, cudaStream_t stream);

/// FilterByConsistency of a range: fills it in the map of confidences, of the reference's size. The context's stamps
/// are null.
void LaunchFilterByConsistency(const FusionContext& context, const PixelRange& range,
                               const ImageView<float>& confidence, const PointOutput& output, cudaStream_t stream);

/// DepthEngine::FuseView of a range. Stamps of all views start at kUnfusedStamp and go on from view to view.
void LaunchFuseView(const FusionContext& context, const PixelRange& range, const PointOutput& output,
                    cudaStream_t stream);

}  // namespace acmp
