#pragma once

namespace acmp {

/// Planes for pixels that hardly any source view confirms: blank surfaces, what only the reference sees, and what is
/// beside something nearer.
struct FillOptions {
  bool enabled = true;
  int seed_views = 4;                 ///< pixels that so many source views confirm are extended, 1..31; half of all
                                      ///< source views, rounded up, suffice
  float max_reprojection_px = 2.0f;   ///< forward-backward error of a view that confirms a pixel, > 0
  float max_relative_depth = 0.003f;  ///< relative difference of its depth, (0, 1)
  bool near_and_far = true;           ///< before geometric passes, where the surroundings disagree: blocks of 2 x 2 px
                                      ///< take a nearer and a farther plane in turn, and the pass chooses
  bool strong_seeds_first = true;     ///< before geometric passes: pixels have to be confirmed within two thirds of
                                      ///< max_relative_depth, and seeds that more views confirm so go before nearer
                                      ///< ones, since the pass will check what they give
  bool weighted_median = true;        ///< then filter the map where surfaces meet (WeightedMedianPixel)
  bool remove_unsupported = true;     ///< after the passes: what has no texture and would hide what has
                                   ///< (RemoveUnsupportedPixel) becomes a guess of little confidence: a sky, above all
};
/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const FillOptions& options);

}  // namespace acmp
