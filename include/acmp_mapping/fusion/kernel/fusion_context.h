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
  double max_squared_px;  ///< of the forward-backward error
  double max_relative_depth;
  double min_normal_cosine;
  int min_consistent_views;
  double min_confidence;

  /// Else as the papers: agreeing views count alike, and unconfirmed pixels are no points.
  ACMP_HOST_DEVICE bool ByProbability() const { return min_consistent_views == 0; }
};

/// From the reference's pixels to the frame in which points are wanted ("target"): its own or the world.
struct ReferenceGeometry {
  Mat3d target_from_pixel;   ///< takes z (u, v, 1) to the point's offset from the camera centre
  Mat3d target_from_camera;  ///< rotation
  Vec3d center;              ///< of the camera, target frame
};

/// Maps between the pixels of the reference (r) and of one source (s), homogeneous, with z as third coordinate:
/// z_s (u_s, v_s, 1) = to_source z_r (u_r, v_r, 1) + to_source_offset, and back.
struct SourceGeometry {
  Mat3d to_source, to_reference;
  Vec3d to_source_offset, to_reference_offset;
  Mat3d target_from_camera;  ///< rotation
  Vec3d center;              ///< of the camera, target frame
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
