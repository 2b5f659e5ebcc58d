#pragma once

#include <string>

namespace acmp {

/// Where the true depth maps of a scene are and how they are stored: 000007.png, .pfm or .dmb for image 7.
struct GroundTruthOptions {
  std::string folder = "depth";  ///< in the scene, or anywhere
  double png_unit = 1000.0;      ///< counts of .png files per scene unit, > 0
  double max_depth = 0;          ///< what is beyond is left out; 0: none
};

/// Throws InvalidInputError for values out of bounds.
void Validate(const GroundTruthOptions& options);

}  // namespace acmp
