#pragma once

#include <cstdint>

#include "acmp_mapping/image/image.h"

namespace acmp {

/// One view's maps where the kernels read them. A source with an empty depth map takes no part; without colours points
/// are black.
struct FusionMaps {
  ImageView<const float> depth;             ///< z, 0 = unknown
  ImageView<const PlaneHypothesis> planes;  ///< their normals
  ImageView<const float> cost;              ///< see CostMap
  ImageView<const Rgb> color;

  ACMP_HOST_DEVICE Vec3f Normal(int col, int row) const { return planes(col, row).normal(); }
  /// Whether the pixel is unconfirmed: filled where no view had confirmed it (FillUnverified). It confirms no other.
  ACMP_HOST_DEVICE bool IsUnconfirmed(int col, int row) const { return cost(col, row) >= kWorstCost; }
  /// Whether what other images show speaks against the pixel: it never is a point, nor part of one.
  ACMP_HOST_DEVICE bool IsUnsupported(int col, int row) const { return cost(col, row) > kWorstCost; }
};

/// FusionOptions as the kernels compare them.
struct FusionLimits {
  float max_squared_px;  ///< of the forward-backward error
  float max_relative_depth;
  float min_normal_cosine;
  int min_consistent_views;
  float min_confidence;

  /// Else as the papers: agreeing views count alike, and unconfirmed pixels are no points.
  ACMP_HOST_DEVICE bool ByProbability() const { return min_consistent_views == 0; }
};

// Matrices are composed in double on the host, from poses relative to the reference's: world coordinates may be large.
// What is left per pixel is arithmetic in the reference's and the sources' frames, of which float keeps 1e-7 of the
// depth and some 1e-7 of the image's width in pixels; the narrowest limits are a thousandth and two thirds of a pixel.

/// From the reference's pixels to the frame in which points are wanted ("target"): its own or the world.
struct ReferenceGeometry {
  Mat3f target_from_pixel;   ///< takes z (u, v, 1) to the point's offset from the camera centre
  Mat3f target_from_camera;  ///< rotation
  Vec3f center;              ///< of the camera, target frame: points alone have it, as accurate as these are
  RayGrid rays;              ///< of the reference's pixels
};

/// Maps between the pixels of the reference (r) and of one source (s), homogeneous, with z as third coordinate:
/// z_s (u_s, v_s, 1) = to_source z_r (u_r, v_r, 1) + to_source_offset, and back.
struct SourceGeometry {
  Mat3f to_source, to_reference;
  Vec3f to_source_offset, to_reference_offset;
  Mat3f target_from_camera;  ///< rotation
  Vec3f baseline;            ///< from the reference's camera centre to the source's, axes of the target frame
  RayGrid rays;              ///< of the source's pixels
};

/// Per pixel of a view, which view's points used it first, by its place in the order of fusion.
using Stamp = uint16_t;
constexpr Stamp kUnfusedStamp = 0xffff;

constexpr int kMaxFusionSources = 32;  ///< as many as the matcher takes

struct FusionSource {
  SourceGeometry geometry;
  FusionMaps view;
  ImageView<Stamp> stamps;  ///< fusion only
};

/// Everything that the kernels read or write for one reference view; passed to them by value.
struct FusionContext {
  ReferenceGeometry geometry;
  FusionMaps reference;
  ImageView<Stamp> stamps;  ///< the reference's; fusion only
  const FusionSource* sources;
  int num_sources;  ///< at most kMaxFusionSources
  Stamp current;    ///< the reference's place in the order of fusion
  FusionLimits limits;
  ImageView<const float> log_odds;  ///< LogOdds of the reference's pixels
};

}  // namespace acmp
