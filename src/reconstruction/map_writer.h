#pragma once

#include <map>
#include <optional>
#include <vector>

#include "image_files.h"
#include "run.h"

namespace acmp {

/// Writes the files of images with final estimates in the run's store: confidence is measured on the images' devices,
/// the files by other threads.
class MapWriter {
 public:
  /// Makes the folders. @param run not null; outlives this
  explicit MapWriter(ReconstructRun* run);

  /// Adds an image's files to the graph. Announces to the store that confidence reads the estimates.
  /// @param after tasks after which the final estimates of the image and its source views are there
  /// @return the task after which the files are there
  int AddTasks(const ImagePlan& image, std::vector<int> after, TaskGraph* graph);

  /// At the end: what the files could not hold.
  void WarnOfDepthsTooFar() const;

  const ImageFiles& files() const { return files_; }
  const std::optional<ColmapOutput>& colmap() const { return files_.colmap(); }  ///< where it is asked for

 private:
  void WriteFiles(int index);
  ConfidenceMap TakeConfidence(int index);

  ReconstructRun& run_;
  const ImageFiles files_;
  const bool measures_confidence_;

  // Under times_mutex while tasks run.
  size_t too_far_ = 0;  ///< pixels
  std::map<int, ConfidenceMap> confidences_;
};

}  // namespace acmp
