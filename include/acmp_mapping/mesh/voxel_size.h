#pragma once

#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/image.h"

namespace acmp {

/// Voxels of a mesh by default: so many pixels wide where a surface is at the median depth. Noise of depth is larger
/// than a pixel, so that smaller voxels only make more triangles.
constexpr double kVoxelPixels = 2.5;

/// What a pixel covers at the map's median depth, unit of the depths. 0 for a map without depth.
double MedianFootprint(const PinholeCamera& camera, const ImageView<const float>& depth);

/// kVoxelPixels of the median footprint. Throws InvalidInputError when none is positive.
double DefaultVoxelSize(std::vector<double> footprints);

}  // namespace acmp
