#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "colmap_output.h"
#include "run_tasks.h"

namespace acmp {

/// The files of images with final estimates in the run's store: maps, their pictures, and their part of COLMAP's
/// workspace.
class ImageFiles {
 public:
  /// Makes the folders. @param run not null, with a folder; outlives this
  explicit ImageFiles(ReconstructRun* run);

  /// Adds the tasks that measure an image's confidence, where it is asked for and does not come with the maps, and
  /// write its files. Returns the number of the last one.
  int AddTasks(const ImagePlan& image, RunTasks* tasks);
  /// At the end: what the files could not hold.
  void WarnOfDepthsTooFar() const;

  const std::optional<ColmapOutput>& colmap() const { return colmap_; }  ///< where it is asked for
  /// The maps and pictures that are made; COLMAP's files are not among them.
  std::vector<std::filesystem::path> FilesOf(int index) const;

 private:
  bool Writes(const std::string& kind) const;
  void WriteFiles(int index, const ConfidenceMap& measured);
  /// @param confidence empty where it is not written
  /// @return pixels that are too deep for depth/*.png
  size_t Write(int index, const FinalMaps& maps, const ConfidenceMap& confidence) const;

  ReconstructRun& run_;
  std::optional<ColmapOutput> colmap_;
  const bool measures_confidence_;
  size_t too_far_ = 0;  ///< pixels; under the run's mutex while tasks run
};

}  // namespace acmp
