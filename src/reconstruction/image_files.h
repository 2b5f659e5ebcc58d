#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "reconstruct_colmap.h"
#include "reconstruct_run.h"

namespace acmp {

/// The files of one image: maps, their pictures, and its part of COLMAP's workspace.
class ImageFiles {
 public:
  /// Makes the folders. @param run not null; outlives this
  explicit ImageFiles(const ReconstructRun* run);

  bool HasConfidence() const { return Writes("confidence"); }
  const std::optional<ColmapOutput>& colmap() const { return colmap_; }  ///< where it is asked for

  bool AllExist(int index) const;

  /// @param confidence empty where it is not written
  /// @return pixels that are too deep for depth/*.png
  size_t Write(int index, const StoredFinalMaps& maps, const ImageView<const float>& confidence) const;

 private:
  bool Writes(const std::string& kind) const;
  bool WritesPicture(const std::string& kind) const { return Writes(kind) && !run_.options.no_pictures; }
  std::vector<std::filesystem::path> FilesOf(int index) const;
  std::filesystem::path Picture(const std::string& kind, int index) const;
  size_t WriteDepth(int index, const ImageView<const float>& depth) const;

  const ReconstructRun& run_;
  std::optional<ColmapOutput> colmap_;
};

}  // namespace acmp
