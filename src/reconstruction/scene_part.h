#pragma once

#include <map>
#include <set>
#include <vector>

#include "chunk_plans.h"

namespace acmp {

/// As much of a planned scene as somebody has asked for: its images keep their indices.
class ScenePart {
 public:
  /// @param plans outlives this
  explicit ScenePart(const ChunkPlans* plans) : plans_(*plans) {}

  /// Takes in the plan of a chunk. Moves the images of the plan and the scene.
  void Load(int chunk);
  /// Images whose estimates a refinement of the image reads; loads its chunk.
  std::vector<int> ImagesRead(int index);

  Scene& scene() { return scene_; }
  /// Of images of chunks that are not loaded it knows only whether they get a map.
  ReconstructPlan& plan() { return plan_; }
  bool IsLoaded(int chunk) const { return chunks_.count(chunk) > 0; }
  /// Images of a loaded chunk that take part.
  std::vector<int> ImagesOf(int chunk) const;
  uint64_t GeometryOf(int index) const { return geometry_.at(index); }
  /// See ChunkPlan; of a loaded chunk.
  const std::map<int, int>& FusedBefore(int chunk) const { return chunks_.at(chunk); }

 private:
  const ImagePlan* Find(int index) const;

  const ChunkPlans& plans_;
  Scene scene_;
  ReconstructPlan plan_;
  std::map<int, std::map<int, int>> chunks_;  ///< loaded, with ChunkPlan::fused_before
  std::map<int, uint64_t> geometry_;          ///< by scene index
};

}  // namespace acmp
