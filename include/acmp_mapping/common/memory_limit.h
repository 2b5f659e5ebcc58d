#pragma once

namespace acmp {

/// A quarter of this machine's memory, or of what its container may take, GB.
double DefaultMemoryLimitGb();

}  // namespace acmp
