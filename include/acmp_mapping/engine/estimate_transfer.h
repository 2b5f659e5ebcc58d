#pragma once

#include "acmp_mapping/engine/matching_engine.h"

namespace acmp {

/// Maps of an estimate in host memory.
struct EstimateMaps {
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
};

/// Views of such maps.
struct EstimateMapViews {
  ImageView<const float> depth;
  ImageView<const Vec3f> normal;
  ImageView<const float> cost;
};

/// The way of estimates to the host, back, and from one device to another.
class EstimateTransfer {
 public:
  virtual ~EstimateTransfer() = default;

  virtual EstimateMaps Download(const EngineEstimatePtr& estimate) = 0;
  /// Only the depths of the same: a sixth of what has to come from a device.
  virtual DepthMap DownloadDepth(const EngineEstimatePtr& estimate) { return Download(estimate).depth; }
  virtual EstimateState DownloadState(const EngineEstimatePtr& estimate) = 0;
  virtual EngineEstimatePtr UploadState(EstimateState state, const PinholeCamera& camera) = 0;

  /// The estimate where this engine can use it: copied from another GPU, else as it is.
  virtual EngineEstimatePtr Import(const EngineEstimatePtr& estimate) { return estimate; }

  /// An estimate with these depths and normals, for the consistency check and fusion.
  virtual EngineEstimatePtr UploadMaps(const EstimateMapViews& maps, const PinholeCamera& camera) = 0;
};

/// Throw InvalidInputError unless the maps have the camera's size.
void CheckUpload(const EstimateState& state, const PinholeCamera& camera);
void CheckUpload(const EstimateMapViews& maps, const PinholeCamera& camera);

}  // namespace acmp
