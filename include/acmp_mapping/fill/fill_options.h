#pragma once

namespace acmp {

/// Planes for pixels that hardly any source view confirms: blank surfaces, what only the reference sees, and what is
/// beside something nearer.
struct FillOptions {
  bool enabled = true;
  /// A geometric pass follows, which checks what it is offered. So pixels stay only where views confirm them closely,
  /// the planes of seeds that more views confirm closely go before those of nearer ones, and where these disagree a
  /// pixel takes the plane on which most of the seeds around it lie. The schedule sets it.
  bool for_passes = true;
  bool weighted_median = true;  ///< then filter the map where surfaces meet (WeightedMedianPixel)
  /// After the passes: what has no texture and would hide what has (RemoveUnsupportedPixel) makes no points: a sky,
  /// above all.
  bool remove_unsupported = true;
};

/// What the external depth is.
struct PriorDepthOptions {
  bool metric = false;  ///< in the unit of the poses, as it is; else scale and shift of the inverse depths are fitted
};

}  // namespace acmp
