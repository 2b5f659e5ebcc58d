#include "acmp_mapping/mesh/voxel_size.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {

double MedianFootprint(const PinholeCamera& camera, const ImageView<const float>& depth) {
  std::vector<float> known;
  for (int row = 0; row < depth.height; ++row) {
    for (int col = 0; col < depth.width; ++col) {
      if (depth(col, row) > 0) known.push_back(depth(col, row));
    }
  }
  return known.empty() ? 0.0 : Median(std::move(known)) / std::sqrt(camera.fx * camera.fy);
}

double DefaultVoxelSize(std::vector<double> footprints) {
  footprints.erase(std::remove_if(footprints.begin(), footprints.end(), [](double f) { return !(f > 0); }),
                   footprints.end());
  if (footprints.empty()) throw InvalidInputError("mesh: no image has depth, of which there could be a surface");
  return kVoxelPixels * Median(std::move(footprints));
}

}  // namespace acmp
