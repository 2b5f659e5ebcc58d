#include "acmp_mapping/common/memory_limit.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>

namespace acmp {

double DefaultMemoryLimitGb() {
  constexpr double kShare = 0.25, kStepsPerGb = 10;
  double bytes = static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  // What a container may take; "max", which is no number, where there is no limit.
  for (const char* limit_file : {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    double limit = 0;
    if (std::ifstream(limit_file) >> limit && limit > 0) bytes = std::min(bytes, limit);
  }
  return std::floor(kShare * bytes / 1e9 * kStepsPerGb) / kStepsPerGb;
}

}  // namespace acmp
