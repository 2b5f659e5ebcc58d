#pragma once

#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// A source pixel that agrees with a reference pixel.
struct PixelMatch {
  int source;  ///< index into the checker's sources
  int col, row;
  Vec3f point;          ///< the source pixel's point, reference camera frame
  Vec3f normal;         ///< unit, reference camera frame
  float angle_versine;  ///< 1 - cos of the angle between the rays from both cameras to the reference pixel's point
  float agreement;      ///< exp(-(px + 200 rel + 10 rad)), 0..1; 0 unless the options ask for dynamic_consistency
};

/// Geometry of one reference view against its source views. Const functions may run in parallel.
class ConsistencyChecker {
 public:
  /// Throws InvalidInputError for bad options, cameras and poses, maps of unequal size within a view, and more than 255
  /// sources. Empty sources take no part. The maps must outlive the checker.
  ConsistencyChecker(const FusionView& reference, const std::vector<const FusionView*>& sources,
                     const FusionOptions& options);

  /// True when the reference has a positive, finite depth there.
  bool HasDepth(int col, int row) const;

  /// Appends the agreeing source pixels in the order of the sources, at most one per source. None where depth or normal
  /// is unknown.
  void FindMatches(int col, int row, std::vector<PixelMatch>* matches) const;

  /// True when the matches suffice to keep the pixel.
  bool Accepts(const std::vector<PixelMatch>& matches) const;

  /// ComputeConfidence for a pixel with depth and its matches.
  float Confidence(int col, int row, const std::vector<PixelMatch>& matches) const;

  /// Mean of a pixel and its matches, reference camera frame.
  SurfacePoint Average(int col, int row, const std::vector<PixelMatch>& matches) const;

 private:
  /// Maps between the pixels of the reference (r) and of one source (s), homogeneous, with z as third coordinate:
  /// z_s (u_s, v_s, 1) = z_r to_source (u_r, v_r, 1) + to_source_offset, and back.
  struct Pair {
    int source;
    FusionView view;
    Eigen::Matrix3d to_source, to_reference, reference_from_source_rotation;
    Eigen::Vector3d to_source_offset, to_reference_offset, source_center;  // centre in the reference frame
  };

  struct ReferencePixel {
    Eigen::Vector3d homogeneous;    ///< (col, row, 1)
    Eigen::Vector3d point, normal;  ///< camera frame
    double depth;
  };

  static Pair MakePair(int source, const FusionView& reference, const FusionView& view);
  bool Match(const Pair& pair, const ReferencePixel& pixel, PixelMatch* match) const;

  FusionView reference_;
  std::vector<Pair> pairs_;
  std::vector<const FusionView*> sources_;
  FusionOptions options_;
  double min_normal_cosine_;
};

}  // namespace acmp
