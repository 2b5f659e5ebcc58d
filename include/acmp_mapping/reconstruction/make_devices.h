#pragma once

#include <ostream>
#include <vector>

#include "acmp_mapping/reconstruction/reconstruct.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"

namespace acmp {

/// The devices that the options name: `jobs_per_gpu` engines on each GPU; where the CPU has to do, one, which uses all
/// cores itself. Throws InvalidInputError for an unknown device, and for one that is asked for and cannot be used.
/// @param log is told why "auto" settled for the CPU, unless the options are `quiet`; not null
std::vector<ReconstructDevice> MakeDevices(const ReconstructOptions& options, std::ostream* log);

}  // namespace acmp
