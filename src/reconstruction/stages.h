#pragma once

#include <map>
#include <ostream>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/reconstruction/reconstruct.h"
#include "engine_store.h"
#include "output_folder.h"
#include "plan.h"
#include "progress.h"

namespace acmp {

// A run whose parts are done by many processes: PlanStages once, then each stage of each chunk, the last one being
// kFinishStage. A chunk is images of successive scene indices: chunk k has those of [k n, (k + 1) n) that take part.
// All files are whole or absent and depend on the input alone, so that any of it may be done again, at the same time or
// after a crash.

constexpr const char* kMapsStage = "maps";      ///< confidence, map files and pictures
constexpr const char* kFuseStage = "fuse";      ///< points of a chunk's images
constexpr const char* kFinishStage = "finish";  ///< cloud, cameras and summary

/// The stages of each chunk in their order: the steps of the schedule, and what comes after.
std::vector<std::string> StagesOfChunk(const ReconstructOptions& options);

/// The key of run.txt by which a folder is one of stages that are not finished.
constexpr const char* kChunkImagesKey = "chunk-images";

/// Writes a plan to the output folder, and its tasks to the file options.plan:
/// {"complete": a finished run with the same settings and input is there, and nothing is to do,
///  "tasks": [{"stage": ..., "images": for --images, "after": numbers of the tasks that it waits for, from 0}, ...]},
/// in an order in which one process would do them. Throws InvalidInputError when the folder belongs to another plan.
/// @param frames gets the images without a map, which no stage may read: a damaged one is found now
void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options,
                const StopRequest& interrupt, FrameStore* frames, Progress* progress, std::ostream* out);

/// Does options.stage for options.images, as far as it is not done. What it reads of other chunks and does not find, or
/// finds damaged, it makes itself. Throws as Reconstruct does.
void DoStage(const ReconstructOptions& options, const RunContext& context);

/// Images of successive scene indices, and what is made of others for them.
struct Chunk {
  std::vector<const ImagePlan*> images;
  std::set<int> reads;              ///< images whose estimates its own ones' refinements and points are made of
  std::map<int, int> fused_before;  ///< the last earlier chunk whose points use pixels of a view, by its scene index
};

/// @return by number: image / chunk_images. They refer to the plan
std::map<int, Chunk> CutIntoChunks(const ReconstructPlan& plan, int chunk_images);

/// The plan in an output folder, and its images, which keep their indices. Stays where it is made.
struct PlannedScene {
  /// Reads it. Throws InvalidInputError where there is none.
  /// @param options name the folder, the scene, which may lie elsewhere than it did, and the length of the chunks
  explicit PlannedScene(const ReconstructOptions& options);

  std::string NameOf(int index) const { return scene.images[static_cast<size_t>(index)].name; }

  Scene scene;  ///< without landmarks and ranking, which only the plan is made of
  ReconstructPlan plan;
  std::map<int, Chunk> chunks;
  std::map<int, uint64_t> files;  ///< HashOfFiles when it was planned, by scene index
  FrameStore frames;
};

}  // namespace acmp
