#pragma once

#include <filesystem>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/pipeline/depth_engine.h"

namespace acmp {

/// True when the work file exists and has the size its header announces. After a power cut a file that was not on the
/// disk yet can be there without its content; it is then made again.
bool IsWholeWorkFile(const std::filesystem::path& path);

/// Intermediate result of one image, as it is in memory: for this machine and this run only.
void WriteEstimate(const std::filesystem::path& path, const EstimateState& estimate);
/// Throws ProcessingError when the file is damaged or has another size.
EstimateState ReadEstimate(const std::filesystem::path& path, int width, int height);

/// Final maps of one image, for fusion and output.
struct FinalMaps {
  DepthMap depth;
  NormalMap normal;
  CostMap cost;
  ConfidenceMap confidence;  ///< empty: computed from the source views' maps later
  ColorImage color;
  std::vector<int> sources;  ///< scene indices
};
void WriteFinalMaps(const std::filesystem::path& path, const FinalMaps& maps);

/// Views into a file of final maps. The file is mapped into memory, so that a scene of any size can be fused: the
/// system loads and drops pages as they are needed.
class MappedFinalMaps {
 public:
  /// Throws ProcessingError when the file is damaged.
  explicit MappedFinalMaps(const std::filesystem::path& path);
  ~MappedFinalMaps();
  MappedFinalMaps(MappedFinalMaps&& other) noexcept;
  MappedFinalMaps& operator=(MappedFinalMaps&&) = delete;
  MappedFinalMaps(const MappedFinalMaps&) = delete;
  MappedFinalMaps& operator=(const MappedFinalMaps&) = delete;

  int width() const { return depth_.width; }
  int height() const { return depth_.height; }
  ImageView<const float> depth() const { return depth_; }
  ImageView<const Vec3f> normal() const { return normal_; }
  ImageView<const float> cost() const { return cost_; }
  ImageView<const float> confidence() const { return confidence_; }  ///< may be empty
  ImageView<const Rgb> color() const { return color_; }
  const std::vector<int>& sources() const { return sources_; }

 private:
  void* data_ = nullptr;
  size_t bytes_ = 0;
  ImageView<const float> depth_;
  ImageView<const Vec3f> normal_;
  ImageView<const float> cost_;
  ImageView<const float> confidence_;
  ImageView<const Rgb> color_;
  std::vector<int> sources_;
};

}  // namespace acmp
