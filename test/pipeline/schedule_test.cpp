#include "acmp_mapping/pipeline/schedule.h"

#include <string>

#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::string StepsOf(bool fills, int geometric_passes) {
  PipelineOptions options;
  options.completion.enabled = fills;
  options.geometric_passes = geometric_passes;
  std::string names;
  for (const KeyframeStep& step : ScheduleOf(options)) {
    if (!names.empty()) names += ", ";
    switch (step.kind) {
      case KeyframeStep::Kind::kInitial:
        names += "initial";
        break;
      case KeyframeStep::Kind::kFillForPasses:
        names += "fill for passes";
        break;
      case KeyframeStep::Kind::kGeometricPass:
        names += Concat("pass ", step.pass);
        break;
      case KeyframeStep::Kind::kFillUnverified:
        names += "fill";
        break;
    }
  }
  return names;
}

TEST(ScheduleTest, GeometricPassesFollowTheInitialEstimate) {
  EXPECT_EQ(StepsOf(false, 0), "initial");
  EXPECT_EQ(StepsOf(false, 2), "initial, pass 0, pass 1");
}

TEST(ScheduleTest, WhatIsUnverifiedIsFilledBeforeAndAfterThePasses) {
  EXPECT_EQ(StepsOf(true, 0), "initial, fill") << "nothing checks what would be offered to passes";
  EXPECT_EQ(StepsOf(true, 2), "initial, fill for passes, pass 0, pass 1, fill");
}

}  // namespace
}  // namespace acmp
