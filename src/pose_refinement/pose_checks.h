#pragma once

#include <optional>

#include "bundle.h"

namespace acmp {

/// PoseChecks::contradiction of an adjusted bundle.
/// @param known_scale as FitSimilarity's, from refined to received poses
std::optional<double> MeasureContradiction(const Bundle& bundle, double known_scale);

/// PoseChecks::stamp_offset_s of an adjusted bundle whose times are stamps in seconds.
std::optional<double> FindStampOffset(const Bundle& bundle);

}  // namespace acmp
