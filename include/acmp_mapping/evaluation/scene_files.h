#pragma once

#include <filesystem>
#include <vector>

#include "acmp_mapping/evaluation/synthetic_scene.h"

namespace acmp {

/// Writes a synthetic scene as a dataset folder: images/, cameras.txt, sparse/ (COLMAP text model) and sparse.ply,
/// cams/ and pair.txt (MVSNet / ACMP layout), depth/ (ground truth, 16-bit millimetres), low_texture/ (white: blank
/// walls and floor), masks/ (of what moves, where something does; named as COLMAP names them), surface.ply
/// (ground-truth cloud, points `surface_spacing_m` apart). Throws ProcessingError with the system's reason when
/// something cannot be written.
void WriteSceneFiles(const std::filesystem::path& folder, const std::vector<SyntheticView>& views,
                     float surface_spacing_m);

}  // namespace acmp
