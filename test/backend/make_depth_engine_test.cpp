#include "acmp_mapping/backend/make_depth_engine.h"

#include <string>

#include "support/error_text.h"

namespace acmp {
namespace {

TEST(ParseDeviceTest, KnowsThreeNames) {
  EXPECT_EQ(ParseDevice("auto"), Device::kAuto);
  EXPECT_EQ(ParseDevice("cuda"), Device::kCuda);
  EXPECT_EQ(ParseDevice("cpu"), Device::kCpu);
  for (const char* name : {"", "CUDA", "cuda:0", "cpu "}) {
    EXPECT_REFUSED(ParseDevice(name), Concat("\"", name, "\""), "auto, cuda or cpu");
  }
}

/// Why there is no GPU of this index to use; empty if there is one.
std::string ReasonAgainstCuda(int index) {
  const std::string error = ErrorOf([&] { MakeDepthEngine(Device::kCuda, index); });
  return error == "no error" ? "" : error;
}

TEST(MakeDepthEngineTest, CpuIsAlwaysThere) {
  const DepthEngineBackend made = MakeDepthEngine(Device::kCpu);
  EXPECT_THAT(made.fallback_reason, IsEmpty());
  EXPECT_THAT(made.engine->device_name(), AllOf(StartsWith("cpu ("), HasSubstr(" thread")));
}

TEST(MakeDepthEngineTest, AutoTakesTheGpuOrSaysWhyNot) {
  const std::string reason = ReasonAgainstCuda(0);
  const DepthEngineBackend made = MakeDepthEngine(Device::kAuto);
  if (reason.empty()) {
    EXPECT_THAT(made.engine->device_name(), HasSubstr("(cuda:0)"));
    EXPECT_THAT(made.fallback_reason, IsEmpty());
  } else {
    EXPECT_THAT(made.engine->device_name(), StartsWith("cpu"));
    EXPECT_THAT(made.fallback_reason, Not(IsEmpty()));
    EXPECT_THAT(reason, HasSubstr(made.fallback_reason));
  }
}

TEST(MakeDepthEngineTest, CudaWithoutGpuIsAnError) {
  const std::string reason = ReasonAgainstCuda(0);
  if (reason.empty()) GTEST_SKIP() << "this machine has a GPU";
  EXPECT_THAT(reason, StartsWith("device = cuda: "));
}

TEST(MakeDepthEngineTest, IndexOutOfRangeIsAnErrorThatNamesIt) {
  if (!ReasonAgainstCuda(0).empty()) GTEST_SKIP() << ReasonAgainstCuda(0);
  for (const int index : {-1, 1000}) {
    EXPECT_THAT(ReasonAgainstCuda(index), HasSubstr(Concat("index = ", index)));
    const DepthEngineBackend made = MakeDepthEngine(Device::kAuto, index);
    EXPECT_THAT(made.engine->device_name(), StartsWith("cpu"));
    EXPECT_THAT(made.fallback_reason, HasSubstr(Concat("index = ", index)));
  }
}

}  // namespace
}  // namespace acmp
