#pragma once

#include <map>
#include <ostream>
#include <string>
#include <vector>

#include "acmp_mapping/reconstruction/reconstruct.h"
#include "engine_store.h"
#include "plan.h"
#include "progress.h"

namespace acmp {

// A run whose parts are done by many processes: PlanStages once, then each stage of each chunk, the last one being
// kFinishStage. A chunk is images of successive scene indices: chunk k has those of [k n, (k + 1) n) that take part.
// All files are whole or absent and depend on the input alone, so that any of it may be done again, at the same time or
// after a crash.

constexpr const char* kMapsStage = "maps";      ///< confidence, map files and pictures
constexpr const char* kFinishStage = "finish";  ///< all that is missing of the run: with the stages before, the cloud

/// The stages of each chunk in their order: the steps of the schedule, and maps.
std::vector<std::string> StagesOfChunk(const ReconstructOptions& options);

/// Writes a plan to the output folder, and its tasks to the file options.plan:
/// {"complete": a finished run with the same settings and input is there, and nothing is to do,
///  "tasks": [{"stage": ..., "images": for --images, "after": numbers of the tasks that it waits for, from 0}, ...]}.
/// Throws InvalidInputError when the folder belongs to another plan.
/// @param frames gets the images without a map, which no stage may read: a damaged one is found now
void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options,
                const StopRequest& interrupt, FrameStore* frames, Progress* progress, std::ostream* out);

/// Does options.stage for options.images, as far as it is not done. What it reads of other chunks and does not find, or
/// finds damaged, it makes itself. Throws as Reconstruct does.
void DoStage(const ReconstructOptions& options, const RunContext& context);

/// The plan in an output folder, and its images, which keep their indices. Stays where it is made.
struct PlannedScene {
  /// Reads it. Throws InvalidInputError where there is none.
  /// @param options name the folder, and the scene, which may lie elsewhere than it did
  explicit PlannedScene(const ReconstructOptions& options);

  Scene scene;  ///< without landmarks and ranking, which only the plan is made of
  ReconstructPlan plan;
  std::map<int, uint64_t> files;  ///< HashOfFiles when it was planned, by scene index
  FrameStore frames;
};

}  // namespace acmp
