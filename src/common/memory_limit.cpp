#include "acmp_mapping/common/memory_limit.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "acmp_mapping/common/error.h"

namespace acmp {

void CheckMemory(const std::string& what, uint64_t count, uint64_t bytes_each, size_t max_bytes) {
  const double gb = static_cast<double>(count) * static_cast<double>(bytes_each) * 1e-9;
  const double max_gb = static_cast<double>(max_bytes) * 1e-9;
  if (gb <= max_gb) return;
  throw InvalidInputError(
      Concat(what, " would take ", gb, " GB of memory: must be at most ", max_gb, " (memory_limit)"));
}

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
