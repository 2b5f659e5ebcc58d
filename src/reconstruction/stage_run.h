#pragma once

#include <functional>
#include <ostream>
#include <string>
#include <utility>

#include "acmp_mapping/reconstruction/reconstruct.h"
#include "devices.h"
#include "frame_store.h"
#include "output_folder.h"
#include "progress.h"
#include "scene_part.h"

namespace acmp {

/// A plan as far as it has been read, and its images.
struct PlannedScene {
  PlannedScene(const ReconstructOptions& options, std::string input)
      : input(std::move(input)),
        plans(options.output, options.scene, options.chunk_images),
        part(&plans),
        frames(part.scene(), MakeFrameOptions(options), options.MemoryBytes(options.kImageShare),
               FrameStore::Changes::kRead) {}

  const std::string input;  ///< of the folder's run: another plan has another one
  const ChunkPlans plans;
  ScenePart part;
  FrameStore frames;
};

/// Does options.stage for options.images. Throws as Reconstruct does.
/// @param folder with its plan; not finished
/// @param planned of that plan
/// @param devices is called if the stage needs them: not null
void DoStage(const ReconstructOptions& options, const OutputFolder& folder, PlannedScene* planned,
             const std::function<Devices*()>& devices, StopRequest* interrupt, std::ostream* out, Progress* progress);

}  // namespace acmp
