#pragma once

#include "acmp_mapping/image/image.h"

namespace acmp {

/// Which pixels of an image count: 0 = ignore (moving things, the robot itself, a sky), anything else = use. Empty: all
/// count.
using Mask = Image<unsigned char>;

/// Chessboard distance of every pixel from the nearest one that is ignored, px, at most kMaxMaskDistance; 0: ignored
/// itself. Empty: all pixels count.
using MaskDistanceMap = Image<unsigned char>;
constexpr int kMaxMaskDistance = 255;

/// Whether the mask ignores some pixel, and whether it ignores all. An empty one does neither.
bool IgnoresSome(const Mask& mask);
bool IgnoresAll(const Mask& mask);

/// The mask of the resized image (Resize): a pixel that is made of an ignored one is ignored. Empty for an empty mask.
Mask ResizeMask(const Mask& mask, int width, int height);

/// The mask of the image halved to means of 2 x 2 pixels: a pixel that covers an ignored one (CoveringPixel: an odd
/// last row or column belongs to the one before) is ignored. Empty for an empty mask.
Mask HalveMask(const Mask& mask);

/// Ignores what either ignores. An empty mask gives the other one. Throws InvalidInputError where the sizes differ.
Mask IntersectMasks(Mask a, const Mask& b);

/// Empty for an empty mask.
MaskDistanceMap MakeMaskDistance(const Mask& mask);

}  // namespace acmp
