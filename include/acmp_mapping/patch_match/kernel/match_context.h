#pragma once

#include <cstdint>

#include "acmp_mapping/geometry/plane_hypothesis.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/patch_match/patch_match_options.h"

namespace acmp {

/// Which cost decides: eq. 1, eq. 7 or eq. 13 of the paper.
enum class Pass { kPhotometric, kPlanarPrior, kGeometric };

/// The depths of a source view as geometric passes read them: an inverse depth per 2 x 2 px in 16 bits, half a byte per
/// pixel. Evenly spaced inverse depths are evenly spaced disparities, so the rounding moves a point by the same part of
/// a pixel at all depths: 1 / 131070 of the largest disparity. Depth maps at full size would be no better: a mean of
/// four has less noise, and within a surface it is interpolated (InverseAt).
struct HalvedDepth {
  ImageView<const uint16_t> inverse;  ///< in steps, 0 = unknown; empty: no map
  float step = 0;                     ///< 1 / scene unit: the greatest inverse depth of the map over kInverseSteps

  ACMP_HOST_DEVICE bool empty() const { return inverse.empty(); }
};

/// What the kernels need of one source view, precomputed once per problem in double. Aligned, so that its first part is
/// read four words at a time.
struct alignas(16) SourceView {
  Mat3f a;              ///< K_j R_j K_ref^-1
  Vec3f b;              ///< K_j t_j
  Mat3f back_a;         ///< K_ref R_j^T K_j^-1
  Vec3f back_b;         ///< -K_ref R_j^T t_j
  float width, height;  ///< px
  HalvedDepth depth;    ///< empty outside geometric passes and in the papers' ones
};

/// The planar prior: planes of triangles, and which of them is each pixel's (RasterizePrior).
struct PriorMap {
  const PlaneHypothesis* planes = nullptr;
  ImageView<const uint32_t> numbers;  ///< of the pixels' planes, from 1; 0 = no prior

  /// All zero: no prior.
  ACMP_HOST_DEVICE PlaneHypothesis operator()(int col, int row) const {
    const uint32_t number = numbers(col, row);
    return number > 0 ? planes[number - 1] : PlaneHypothesis{};
  }
};

/// Everything a pixel update reads or writes; passed to kernels by value. `Sampler` gives grey values:
///   Reference(col, row)   inside the image
///   ImageOf(view)         what SourceAt calls the image of a source view
///   SourceAt(image, x, y) bilinear, clamped to the border, at any finite or infinite position
///   kPixelCenter          where pixel 0 lies in x and y
///   kHasMasks             whether images may have masks: else what asks for them costs nothing
template <class Sampler>
struct MatchContext {
  Sampler sampler;
  const SourceView* sources;
  int num_sources;
  int width, height;  ///< of the reference, px
  RayGrid rays;
  float depth_min, depth_max;
  PatchMatchOptions options;
  uint32_t pass_number;  ///< distinguishes the passes' random numbers

  ImageView<PlaneHypothesis> planes;
  ImageView<float> cost;
  ImageView<uint32_t> selected_views;
  PriorMap prior;                             ///< planar-prior pass only
  const ImageView<const float>* full_depths;  ///< of the sources, z at full size: the papers' geometric passes only

  /// MaskDistanceMap of the reference's mask; empty: all of its pixels count.
  ImageView<const unsigned char> mask_distance;
  /// The same of the sources; null where none has a mask.
  const ImageView<const unsigned char>* source_mask_distances;

  ACMP_HOST_DEVICE bool Contains(int col, int row) const { return col >= 0 && row >= 0 && col < width && row < height; }
  ACMP_HOST_DEVICE bool InRange(float depth) const { return depth >= depth_min && depth <= depth_max; }
  /// Whether the reference's mask ignores the pixel, or one that lies within `reach` px of it along both axes.
  ACMP_HOST_DEVICE bool IsNearMasked(int col, int row, int reach) const {
    return Sampler::kHasMasks && mask_distance.data != nullptr && mask_distance(col, row) <= reach;
  }
  ACMP_HOST_DEVICE bool IsMasked(int col, int row) const { return IsNearMasked(col, row, 0); }
  /// Whether the reference's mask may have left the pixel without a plane.
  ACMP_HOST_DEVICE bool HasNoPlane(int col, int row) const {
    return Sampler::kHasMasks && mask_distance.data != nullptr && !(planes(col, row).d > 0);
  }
};

/// True for a pixel of the reference that its mask ignores: it has no hypothesis.
template <class Sampler, class Group>
ACMP_HOST_DEVICE inline bool LeaveIfMasked(const MatchContext<Sampler>& context, int col, int row, const Group& group) {
  if (!context.IsMasked(col, row)) return false;
  if (group.Rank() == 0) {
    context.planes(col, row) = {};
    context.cost(col, row) = kWorstCost;
    context.selected_views(col, row) = 0;
  }
  return true;
}

constexpr float kUninformedCost = 1.0f;  ///< NCC = 0: the reference window has no texture to compare

}  // namespace acmp
