#pragma once

#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "acmp_mapping/reconstruction/reconstruct.h"
#include "output_folder.h"
#include "plan.h"
#include "progress.h"

namespace acmp {

// A run whose parts are done by many processes: PlanStages once, then StageRunner for each stage of each chunk, and at
// last kFinishStage for all. Files are whole or absent and depend on the input alone, so that any stage may be done
// again, at the same time or after a crash.

constexpr const char* kMapsStage = "maps";      ///< confidence, map files and pictures
constexpr const char* kFuseStage = "fuse";      ///< points of a chunk's images
constexpr const char* kFinishStage = "finish";  ///< cloud, cameras and summary

/// The stages of each chunk in their order: the steps of the schedule, and what comes after.
std::vector<std::string> StagesOfChunk(const ReconstructOptions& options);

/// The key of run.txt by which a folder is one of stages that are not finished.
constexpr const char* kChunkImagesKey = "chunk-images";

/// Writes a plan for StageRunner to the output folder, and its tasks to the file options.plan:
/// {"complete": a finished run with the same settings and input is there, and nothing is to do,
///  "tasks": [{"stage": ..., "images": for --images, "after": numbers of the tasks that it waits for, from 0}, ...]},
/// in an order in which one process would do them. Throws InvalidInputError when the folder belongs to another plan.
void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options, Progress* progress,
                std::ostream* out);

/// Does stages, one after the other. Devices, the plan as far as it has been read and images are kept from one to the
/// next: images within their share of the memory limit, and as long as their files are not written.
class StageRunner {
 public:
  /// @param make_devices is called when a stage needs them and there are none. The pointers are not null; they and
  ///     make_devices outlive this
  StageRunner(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
              std::ostream* out, std::ostream* log, bool log_is_terminal);
  ~StageRunner();

  /// Does a stage of images (as --images has them), as far as it is not done. What it reads of other chunks and does
  /// not find, or finds damaged, it makes itself. Throws as Reconstruct does; then nothing is kept.
  void Run(const std::string& stage, const std::string& images);

 private:
  struct Kept;
  void RunStage();

  ReconstructOptions options_;
  const DeviceMaker& make_devices_;
  StopRequest& interrupt_;
  std::ostream& out_;
  std::ostream& log_;
  const bool log_is_terminal_;
  std::unique_ptr<Kept> kept_;
};

}  // namespace acmp
