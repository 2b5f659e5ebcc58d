#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "output_folder.h"
#include "plan.h"

namespace acmp {

/// What a process needs to do any stage of a chunk: images of successive scene indices.
struct ChunkPlan {
  struct View {
    SceneImage image;       ///< without landmarks and ranking, which only the plan is made of
    std::string no_map;     ///< why it gets no map; empty when it gets one
    uint64_t geometry = 0;  ///< HashOfGeometry
  };

  std::vector<ImagePlan> images;                     ///< that take part
  std::map<int, View> views;                         ///< these images and all their source views, by scene index
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< ReconstructPlan::origin
  std::map<int, int> fused_before;  ///< the last earlier chunk whose points use pixels of a view, by scene index
};

/// A run's plan cut into chunks: chunk k has the images [k n, (k + 1) n) of the scene that take part. Each chunk is a
/// file, so that a stage reads the same little of a scene of any size.
class ChunkPlans {
 public:
  /// @param output folder with the plan
  /// @param scene_root images below it are found wherever it lies
  /// @param chunk_images n, at least 1
  ChunkPlans(const std::filesystem::path& output, const std::filesystem::path& scene_root, int chunk_images)
      : output_(output), scene_root_(scene_root), chunk_images_(chunk_images) {}

  int ChunkOf(int index) const { return index / chunk_images_; }
  /// Throws InvalidInputError if there is no whole plan of that chunk.
  ChunkPlan Read(int chunk) const;
  /// Numbers of all chunks that the plan has.
  std::vector<int> Chunks() const;

  /// The files of all chunks, by number, for Write.
  static std::map<int, std::string> Format(const Scene& scene, const std::filesystem::path& scene_root,
                                           const ReconstructPlan& plan, int chunk_images);
  /// Those that are not there yet. An index of them last: without it there is no plan.
  void Write(const std::map<int, std::string>& files) const;

 private:
  std::filesystem::path FileOf(int chunk) const { return OutputFolder::WorkFile(output_, "plan", chunk); }
  std::filesystem::path IndexFile() const;

  const std::filesystem::path output_;
  const std::filesystem::path scene_root_;
  const int chunk_images_;
};

}  // namespace acmp
