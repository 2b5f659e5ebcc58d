#include "acmp_mapping/pipeline/schedule.h"

#include <string>

#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::string StepsOf(const PipelineOptions& options) {
  std::string names;
  for (const KeyframeStep& step : ScheduleOf(options)) {
    if (!names.empty()) names += ", ";
    switch (step.kind) {
      case KeyframeStep::Kind::kInitial:
        names += "initial";
        break;
      case KeyframeStep::Kind::kNextScale:
        names += "next scale";
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
    if (step.level > 0) names += Concat(" at level ", step.level);
  }
  return names;
}

std::string StepsOf(bool fills, int geometric_passes) {
  PipelineOptions options;
  options.fill.enabled = fills;
  options.geometric_passes = geometric_passes;
  return StepsOf(options);
}

TEST(ScheduleTest, GeometricPassesFollowTheInitialEstimate) {
  EXPECT_EQ(StepsOf(false, 0), "initial");
  EXPECT_EQ(StepsOf(false, 2), "initial, pass 0, pass 1");
}

TEST(ScheduleTest, WhatIsUnverifiedIsFilledBeforeAndAfterThePasses) {
  EXPECT_EQ(StepsOf(true, 0), "initial, fill") << "nothing checks what would be offered to passes";
  EXPECT_EQ(StepsOf(true, 2), "initial, fill for passes, pass 0, pass 1, fill");
}

TEST(ScheduleTest, AcmmTakesAllStepsAtEachScale) {
  EXPECT_EQ(StepsOf(MakePreset("acmm")),
            "initial at level 2, pass 0 at level 2, pass 1 at level 2, "
            "next scale at level 1, pass 0 at level 1, pass 1 at level 1, next scale, pass 0, pass 1");
}

}  // namespace
}  // namespace acmp
