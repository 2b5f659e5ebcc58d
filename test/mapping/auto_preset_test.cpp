#include "acmp_mapping/mapping/auto_preset.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

constexpr int kEnough = 100;  ///< keyframes after which it must have settled

/// Keyframes of a machine that takes `fixed_ms`, and `best_ms` times the setting's cost to the power of `exponent`,
/// until the choice is settled. @return what it said last
std::string Settle(double fixed_ms, double best_ms, double exponent, double interval_s, AutoPreset* choice) {
  std::string said;
  for (int i = 0; i < kEnough && !choice->is_settled(); ++i) {
    const double ms = fixed_ms + best_ms * std::pow(choice->setting().cost, exponent);
    said = choice->Add(ms, interval_s).value_or(said);
  }
  return said;
}

TEST(AutoPreset, WaitsUntilItKnowsBothTimes) {
  AutoPreset choice;
  for (int i = 0; i < kEnough; ++i) EXPECT_FALSE(choice.Add(1, std::nullopt));
  AutoPreset early;
  for (int i = 0; i < 7; ++i) EXPECT_FALSE(early.Add(1, 0.1)) << i;
  EXPECT_TRUE(early.Add(1, 0.1));
}

TEST(AutoPreset, AFastMachineGetsTheBest) {
  AutoPreset choice;
  const std::string said = Settle(0, 20, 1, 0.1, &choice);
  EXPECT_TRUE(choice.is_settled());
  EXPECT_TRUE(choice.keeps_up());
  EXPECT_STREQ(choice.setting().preset, "balanced");
  EXPECT_THAT(said, HasSubstr("balanced, 100 % of max_image_size, at most 10 source views"));
  EXPECT_THAT(said, HasSubstr("every 0.1 s and took 0.02 s"));
}

TEST(AutoPreset, ASlowMachineGetsTheCheapestAndASayThatItIsTooSlow) {
  AutoPreset choice;
  const std::string said = Settle(0, 60000, 1, 0.2, &choice);
  EXPECT_TRUE(choice.is_settled());
  EXPECT_FALSE(choice.keeps_up());
  EXPECT_EQ(choice.index(), AutoPreset::Settings().size() - 1);
  EXPECT_THAT(said, HasSubstr("too long for all of them"));
}

TEST(AutoPreset, SettlesWhereItKeepsUpHoweverWrongTheCostsAre) {
  int between = 0;
  for (const double fixed_ms : {0.0, 1.0, 10.0, 100.0}) {
    for (double best_ms = 1; best_ms < 1e5; best_ms *= 1.7) {
      for (const double exponent : {0.5, 0.8, 1.0, 1.25, 2.0}) {
        AutoPreset choice;
        Settle(fixed_ms, best_ms, exponent, 0.2, &choice);
        ASSERT_TRUE(choice.is_settled()) << fixed_ms << " " << best_ms << " " << exponent;
        const double ms = fixed_ms + best_ms * std::pow(choice.setting().cost, exponent);
        if (choice.keeps_up()) {
          EXPECT_LE(ms, 100) << fixed_ms << " " << best_ms << " " << exponent;
        } else {
          EXPECT_EQ(choice.index(), AutoPreset::Settings().size() - 1);
        }
        between += choice.index() > 0 && choice.keeps_up() ? 1 : 0;
        for (int i = 0; i < kEnough; ++i) EXPECT_FALSE(choice.Add(ms, 0.2)) << "it has settled";
      }
    }
  }
  EXPECT_GT(between, 50);  // of 400
}

}  // namespace
}  // namespace acmp
