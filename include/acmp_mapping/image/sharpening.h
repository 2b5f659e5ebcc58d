#pragma once

#include "acmp_mapping/image/image.h"

namespace acmp {

constexpr double kMaxSharpening = 10;

/// Standard deviation of white noise in grey values, from differences of second differences (Immerkaer, "Fast noise
/// variance estimation", 1996): the lower quartile of their means over blocks of 8 x 8 px, so that three quarters of
/// the image may have texture. It lies some 13 % low where there is none. Blocks that touch black or white do not
/// count: noise is cut off there. At least what rounding colours to 8 bits gives, 0.19.
double EstimateNoise(const GrayImage& gray);

/// Adaptive Wiener filter that also sharpens: `gray` becomes b + g max(0, 1 - 2 n^2 / v) (gray - b), cut off at 0 and
/// 255, with b a blur of 0.7 px, n^2 the variance that noise has in gray - b, and v the mean of (gray - b)^2 over 5 x 5
/// px. Fine detail decides where windows match best, as far as it is more than noise. g falls from `gain` where detail
/// is faint to 1 where it is strong, half of the way at v = 16: the overshoot beside the edge of a thing would move
/// with the thing.
/// @param gain 0: leaves the image as it is; 1: denoises only. InvalidInputError unless in 0..kMaxSharpening
void Sharpen(double gain, GrayImage* gray);

}  // namespace acmp
