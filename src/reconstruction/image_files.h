#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "colmap_output.h"
#include "run.h"

namespace acmp {

/// The files of one image: maps, their pictures, and its part of COLMAP's workspace.
class ImageFiles {
 public:
  /// Makes the folders. @param run not null; outlives this
  explicit ImageFiles(const ReconstructRun* run);

  bool HasConfidence() const { return Writes("confidence"); }
  const std::optional<ColmapOutput>& colmap() const { return colmap_; }  ///< where it is asked for
  bool any() const { return colmap_ || !run_.options.maps.empty(); }

  /// @param confidence empty where it is not written
  /// @return pixels that are too deep for depth/*.png
  size_t Write(int index, const FinalMaps& maps, const ConfidenceMap& confidence) const;

  /// The maps and pictures that Write makes; COLMAP's files are not among them.
  std::vector<std::filesystem::path> FilesOf(int index) const;

 private:
  bool Writes(const std::string& kind) const;

  const ReconstructRun& run_;
  std::optional<ColmapOutput> colmap_;
};

}  // namespace acmp
