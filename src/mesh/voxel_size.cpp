#include "acmp_mapping/mesh/voxel_size.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// Of a list that is not empty; changes its order.
template <class T>
T Median(std::vector<T>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

}  // namespace

double MedianFootprint(const PinholeCamera& camera, const ImageView<const float>& depth) {
  std::vector<float> known;
  for (int row = 0; row < depth.height; ++row) {
    for (int col = 0; col < depth.width; ++col) {
      if (depth(col, row) > 0) known.push_back(depth(col, row));
    }
  }
  return known.empty() ? 0.0 : Median(&known) / std::sqrt(camera.fx * camera.fy);
}

double DefaultVoxelSize(std::vector<double> footprints) {
  footprints.erase(std::remove_if(footprints.begin(), footprints.end(), [](double f) { return !(f > 0); }),
                   footprints.end());
  if (footprints.empty()) throw InvalidInputError("mesh: no image has depth, of which there could be a surface");
  return kVoxelPixels * Median(&footprints);
}

}  // namespace acmp
