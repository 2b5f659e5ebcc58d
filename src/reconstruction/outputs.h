#pragma once

#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/fusion/point_cloud.h"
#include "run.h"

namespace acmp {

// OUTPUT/colmap, COLMAP's dense workspace with the maps of a run, for programs that fuse or mesh it. Images keep their
// names, and their folders below images/, depth_maps/ and normal_maps/.

/// All files of the COLMAP workspace, by name in OUTPUT.
std::set<std::string> ColmapFilesOf(const ReconstructRun& run);

/// Depth and normals where they were measured: pixels of kUnverifiedCost or worse have at most planes from around them,
/// and a program that fuses the maps would take them for what a camera saw.
void WriteColmapMaps(const ReconstructRun& run, int index, const FinalMaps& maps);

/// Cameras, poses, points of the cloud and the lists of images: last, since the online schedule decides late what gets
/// a map, and the maps tell which images see a point.
/// @param images with maps, by scene index
/// @param clouds of each of the images, from the plan's origin
void WriteColmapWorkspace(const ReconstructRun& run, const std::set<int>& images,
                          const std::vector<PointCloud>& clouds);

}  // namespace acmp
