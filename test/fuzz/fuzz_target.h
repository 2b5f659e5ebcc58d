#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

namespace acmp::fuzz {

using Target = int (*)(const uint8_t* data, size_t size);

/// Of this program, by name.
inline std::map<std::string, Target>& Targets() {
  static std::map<std::string, Target> targets;
  return targets;
}

struct Registration {
  Registration(const char* name, Target target) { Targets()[name] = target; }
};

}  // namespace acmp::fuzz

/// The head of a target's function of `data` and `size`: libFuzzer has a program for each, the tests one for all.
#ifdef ACMP_FUZZ
#define ACMP_FUZZ_TARGET(name) extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
#else
#define ACMP_FUZZ_TARGET(name)                                                         \
  static int FuzzTarget_##name(const uint8_t* data, size_t size);                      \
  static const acmp::fuzz::Registration registration_##name(#name, FuzzTarget_##name); \
  static int FuzzTarget_##name(const uint8_t* data, size_t size)
#endif
