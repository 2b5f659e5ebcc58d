#pragma once

#include <optional>

#include "bundle.h"

namespace acmp {

/// PoseChecks::contradiction of an adjusted bundle.
std::optional<double> MeasureContradiction(const Bundle& bundle);

}  // namespace acmp
