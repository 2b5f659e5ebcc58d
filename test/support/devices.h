#pragma once

#include <memory>
#include <ostream>
#include <string>

#include "gtest/gtest.h"

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"

namespace acmp {

inline void PrintTo(Device device, std::ostream* out) { *out << (device == Device::kCuda ? "cuda" : "cpu"); }

/// The engine of a device into `engine`, or a skip of the test with what is missing.
inline void MakeEngineOrSkip(Device device, std::unique_ptr<DepthEngine>* engine) {
  try {
    *engine = MakeDepthEngine(device).engine;
  } catch (const InvalidInputError& error) {
    GTEST_SKIP() << error.what();
  }
}

/// Base of tests that run on every device.
class EngineTest : public ::testing::TestWithParam<Device> {
 protected:
  void SetUp() override { MakeEngineOrSkip(GetParam(), &engine_); }

  std::unique_ptr<DepthEngine> engine_;
};

inline std::string DeviceName(const ::testing::TestParamInfo<Device>& info) {
  return info.param == Device::kCuda ? "cuda" : "cpu";
}

}  // namespace acmp
