#pragma once

namespace acmp {

/// Bilinear single-channel texture fetches per second that GPU `cuda_index` reaches (median of 7 runs): the ceiling of
/// PatchMatch, whose floor is its number of samples over this rate. In CUDA builds only.
/// @param multiprocessors as of MakeDepthEngine
double MeasureTextureRate(int cuda_index, int multiprocessors = 0);

}  // namespace acmp
