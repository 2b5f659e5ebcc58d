#include "acmp_mapping/backend/make_depth_engine.h"

#include <ostream>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

TEST(ParseDeviceTest, KnowsThreeNames) {
  EXPECT_EQ(ParseDevice("auto"), Device::kAuto);
  EXPECT_EQ(ParseDevice("cuda"), Device::kCuda);
  EXPECT_EQ(ParseDevice("cpu"), Device::kCpu);
}

TEST(ParseDeviceTest, RefusesOthersByName) {
  for (const char* name : {"", "CUDA", "gpu", "cuda:0", " cpu", "cpu "}) {
    try {
      ParseDevice(name);
      ADD_FAILURE() << "accepted \"" << name << '"';
    } catch (const InvalidInputError& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr(Concat("\"", name, "\"")), HasSubstr("auto, cuda or cpu")));
    }
  }
}

/// What a factory made, of single passes or of whole engines.
struct Made {
  std::string device_name;  ///< empty: nothing
  std::string fallback_reason;
};

Made MakePasses(Device device, int cuda_index) {
  const PatchMatchBackend backend = MakePatchMatch(device, cuda_index);
  return {backend.patch_match ? backend.patch_match->device_name() : "", backend.fallback_reason};
}

Made MakeEngine(Device device, int cuda_index) {
  const DepthEngineBackend backend = MakeDepthEngine(device, cuda_index);
  return {backend.engine ? backend.engine->device_name() : "", backend.fallback_reason};
}

struct Factory {
  const char* name;
  Made (*make)(Device device, int cuda_index);
};
void PrintTo(const Factory& factory, std::ostream* out) { *out << factory.name; }

class BackendTest : public ::testing::TestWithParam<Factory> {
 protected:
  static Made Make(Device device, int index = 0) { return GetParam().make(device, index); }

  /// Why there is no GPU to use; empty if there is one.
  static std::string ReasonAgainstCuda(int index) {
    try {
      Make(Device::kCuda, index);
    } catch (const InvalidInputError& error) {
      return error.what();
    }
    return "";
  }
};

TEST_P(BackendTest, CpuIsAlwaysThere) {
  const Made made = Make(Device::kCpu);
  EXPECT_THAT(made.fallback_reason, IsEmpty());
  EXPECT_THAT(made.device_name, AllOf(StartsWith("cpu ("), HasSubstr(" thread")));
}

TEST_P(BackendTest, AutoTakesTheGpuOrSaysWhyNot) {
  const std::string reason = ReasonAgainstCuda(0);
  const Made made = Make(Device::kAuto);
  if (reason.empty()) {
    EXPECT_THAT(made.device_name, HasSubstr("(cuda:0)"));
    EXPECT_THAT(made.fallback_reason, IsEmpty());
  } else {
    EXPECT_THAT(made.device_name, StartsWith("cpu"));
    EXPECT_THAT(made.fallback_reason, Not(IsEmpty()));
    EXPECT_THAT(reason, HasSubstr(made.fallback_reason));
  }
}

TEST_P(BackendTest, CudaWithoutGpuIsAnError) {
  const std::string reason = ReasonAgainstCuda(0);
  if (reason.empty()) GTEST_SKIP() << "this machine has a GPU";
  EXPECT_THAT(reason, StartsWith("device = cuda: "));
}

TEST_P(BackendTest, IndexOutOfRangeIsAnErrorThatNamesIt) {
  if (!ReasonAgainstCuda(0).empty()) GTEST_SKIP() << ReasonAgainstCuda(0);
  for (const int index : {-1, 1000}) {
    EXPECT_THAT(ReasonAgainstCuda(index), HasSubstr(Concat("index = ", index)));
    const Made made = Make(Device::kAuto, index);
    EXPECT_THAT(made.device_name, StartsWith("cpu"));
    EXPECT_THAT(made.fallback_reason, HasSubstr(Concat("index = ", index)));
  }
}

INSTANTIATE_TEST_SUITE_P(Factories, BackendTest,
                         ::testing::Values(Factory{"passes", &MakePasses}, Factory{"engine", &MakeEngine}),
                         [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace acmp
