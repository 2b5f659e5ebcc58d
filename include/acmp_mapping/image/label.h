#pragma once

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Class of what a pixel or a point shows (semantic segmentation), 1..kMaxLabel; 0: unknown.
using Label = unsigned char;
using LabelImage = Image<Label>;
constexpr int kMaxLabel = 255;

}  // namespace acmp
