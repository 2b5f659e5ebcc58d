#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

/// OUTPUT/colmap, COLMAP's dense workspace with the maps of a run, for programs that fuse or mesh it. Images keep their
/// names, and their folders below images/, depth_maps/ and normal_maps/.
class ColmapOutput {
 public:
  /// Makes the folders. @param run not null; outlives this
  explicit ColmapOutput(const ReconstructRun* run);

  /// Throws InvalidInputError when the workspace cannot have an image of that name.
  static void CheckNames(const Scene& scene, const std::vector<int>& indices);

  /// Depth and normals where they were measured: pixels of kUnverifiedCost or worse have at most planes from around
  /// them, and a program that fuses the maps would take them for what a camera saw.
  void WriteMaps(int index, const FinalMaps& maps) const;

  /// Cameras, poses, landmarks and the lists of images: last, since the online schedule decides late what gets a map.
  /// @param images with maps, by scene index
  /// @param clouds of each of the images, from the plan's origin
  void WriteModel(const std::vector<int>& images, const std::vector<PointCloud>& clouds) const;

 private:
  std::vector<std::vector<size_t>> SourcesWithin(const std::vector<int>& images) const;

  const ReconstructRun& run_;
  std::filesystem::path folder_;
};

}  // namespace acmp
