#pragma once

#include "acmp_mapping/patch_match/kernel/ncc.h"

namespace acmp {

/// The cost that all passes compare with, on all devices. Another one is another struct like Ncc, of 0..kWorstCost,
/// named here. What is good in its scale stands with the presets (pipeline/presets.cpp): sigma_view, prior_start_cost,
/// geometric_weight, and the prior's max_support_cost. Sums of a cost other than Ncc are made without a CPU's vectors.
using MatchingCost = Ncc;

}  // namespace acmp
