#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "run_tasks.h"

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

  /// Cameras, poses, points of the cloud and the lists of images: last, since the online schedule decides late what
  /// gets a map, and the maps tell which images see a point.
  /// @param images with maps, by scene index
  /// @param clouds of each of the images, from the plan's origin
  void WriteModel(const std::vector<int>& images, const std::vector<PointCloud>& clouds) const;

 private:
  std::filesystem::path DepthFile(const std::string& name) const;
  std::vector<std::vector<size_t>> SourcesWithin(const std::vector<int>& images) const;

  const ReconstructRun& run_;
  std::filesystem::path folder_;
};

/// The maps and pictures of an image that are made; COLMAP's files are not among them.
std::vector<std::filesystem::path> FilesOfImage(const ReconstructOptions& options, const OutputFolder& folder,
                                                int index);

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

 private:
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
