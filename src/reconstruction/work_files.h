#pragma once

#include <filesystem>
#include <memory>
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

/// Views of final maps, which are in memory or in a file. The file is mapped into memory, so that a scene of any size
/// can be written: the system loads and drops pages as they are needed.
class StoredFinalMaps {
 public:
  /// Throws ProcessingError when the file is damaged.
  explicit StoredFinalMaps(const std::filesystem::path& path);
  explicit StoredFinalMaps(std::shared_ptr<const FinalMaps> maps);
  ~StoredFinalMaps();
  StoredFinalMaps(StoredFinalMaps&& other) noexcept;
  StoredFinalMaps& operator=(StoredFinalMaps&&) = delete;
  StoredFinalMaps(const StoredFinalMaps&) = delete;
  StoredFinalMaps& operator=(const StoredFinalMaps&) = delete;

  int width() const { return depth_.width; }
  int height() const { return depth_.height; }
  ImageView<const float> depth() const { return depth_; }
  ImageView<const Vec3f> normal() const { return normal_; }
  ImageView<const float> cost() const { return cost_; }
  ImageView<const float> confidence() const { return confidence_; }  ///< may be empty
  ImageView<const Rgb> color() const { return color_; }
  const std::vector<int>& sources() const { return sources_; }

 private:
  std::shared_ptr<const FinalMaps> owner_;
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
