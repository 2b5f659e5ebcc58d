#pragma once

#include <memory>
#include <ostream>
#include <string>

#include "gtest/gtest.h"

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"

namespace acmp {

inline void PrintTo(Device device, std::ostream* out) { *out << (device == Device::kCuda ? "cuda" : "cpu"); }

/// Base of tests that run on every device; those without hardware are skipped with the reason.
class DeviceTest : public ::testing::TestWithParam<Device> {
 protected:
  void SetUp() override {
    try {
      patch_match_ = MakePatchMatch(GetParam()).patch_match;
    } catch (const InvalidInputError& error) {
      GTEST_SKIP() << error.what();
    }
  }

  std::unique_ptr<PatchMatch> patch_match_;
};

/// The same for tests of whole engines.
class EngineTest : public ::testing::TestWithParam<Device> {
 protected:
  void SetUp() override {
    try {
      engine_ = MakeDepthEngine(GetParam()).engine;
    } catch (const InvalidInputError& error) {
      GTEST_SKIP() << error.what();
    }
  }

  std::unique_ptr<DepthEngine> engine_;
};

inline std::string DeviceName(const ::testing::TestParamInfo<Device>& info) {
  return info.param == Device::kCuda ? "cuda" : "cpu";
}

}  // namespace acmp
