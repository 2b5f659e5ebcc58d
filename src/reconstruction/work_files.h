#pragma once

#include <filesystem>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

enum class WorkFileState {
  kMissing,
  kWhole,
  kDamaged,  ///< of another length or content than was written, or not a work file of this version
};

/// Reads the whole file and compares its checksum (CRC-32, some GB/s). After a power cut a file that was not on the
/// disk yet can be there without its content.
WorkFileState CheckWorkFile(const std::filesystem::path& path);

/// Intermediate result of one image, as it is in memory: for this machine and this run only.
void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate);
/// Throws ProcessingError when the file is damaged or has another size.
EstimateState ReadEstimate(const std::filesystem::path& path, int width, int height);

/// Final maps of one image, for fusion and output.
struct FinalMaps {
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
  ConfidenceMap confidence;  ///< empty: measured later against the source views' maps
  ColorImage color;
};
void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps);
/// Throws ProcessingError when the file is damaged.
FinalMaps ReadFinalMaps(const std::filesystem::path& path);

}  // namespace acmp
