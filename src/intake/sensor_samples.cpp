#include "acmp_mapping/intake/sensor_samples.h"

#include <cinttypes>
#include <cstdio>

namespace acmp {

std::string FormatStamp(int64_t stamp_ns) {
  constexpr int64_t kNsPerS = 1000000000;
  char text[40];
  std::snprintf(text, sizeof(text), "%" PRId64 ".%09" PRId64, stamp_ns / kNsPerS, stamp_ns % kNsPerS);
  return text;
}

}  // namespace acmp
