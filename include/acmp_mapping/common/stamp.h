#pragma once

#include <cinttypes>
#include <cstdint>
#include <string>

#include "acmp_mapping/common/classic_locale.h"

namespace acmp {

/// Nanoseconds as messages show them: "1403636579.763555500", exact.
inline std::string FormatStamp(int64_t stamp_ns) {
  constexpr int64_t kNsPerS = 1000000000;
  return StringPrintf("%" PRId64 ".%09" PRId64, stamp_ns / kNsPerS, stamp_ns % kNsPerS);
}

}  // namespace acmp
