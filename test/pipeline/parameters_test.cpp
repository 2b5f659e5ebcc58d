#include "acmp_mapping/pipeline/parameters.h"
#include "acmp_mapping/mapping/window_options.h"

#include <set>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::set<std::string> Names() {
  std::set<std::string> names;
  for (const auto& option : PipelineOptionTable()) {
    EXPECT_TRUE(names.insert(option.name()).second) << option.name();
    EXPECT_FALSE(option.description.sentence.empty()) << option.name();
  }
  for (const auto& option : WindowOptionTable()) {
    EXPECT_TRUE(names.insert(option.name()).second) << option.name();
    EXPECT_FALSE(option.description.sentence.empty()) << option.name();
  }
  return names;
}

TEST(ParametersTest, HaveNamesOfTheirOwnAndAreExplained) { EXPECT_FALSE(Names().empty()); }

/// A bound of the option, or the other value of a flag.
OptionValue Extreme(const OptionDescription& option, const OptionValue& like, bool upper) {
  const double bound = upper ? option.max : option.min;
  if (std::holds_alternative<bool>(like)) return upper;
  if (std::holds_alternative<int>(like)) return static_cast<int>(bound);
  return bound;
}

TEST(ParametersTest, EachBoundOfThePipelineIsLegal) {
  for (const std::string& preset : PresetNames()) {
    for (const auto& option : PipelineOptionTable()) {
      for (const bool upper : {false, true}) {
        PipelineOptions options = MakePreset(preset);
        option.set(Extreme(option.description, option.get(options), upper), &options);
        if (options.multi_scale && (options.use_planar_prior || options.fill.enabled)) continue;  // refused
        EXPECT_NO_THROW(Validate(options)) << preset << ", " << option.name();
      }
    }
  }
}

TEST(ParametersTest, EachBoundOfTheWindowIsLegalWithWhatBelongsToIt) {
  for (const auto& option : WindowOptionTable()) {
    for (const bool upper : {false, true}) {
      DenseMapperOptions options;
      options.window_size = upper ? kMaxWindowSize : 3;
      options.lookahead = 0;
      options.min_source_views = 1;
      if (option.name() == "depth_min" && upper) continue;  // nothing is farther
      if (!option.description.choices.empty()) continue;    // no bounds
      if (option.name() == "depth_min") options.fallback_depth_range.max = 0;
      if (option.name() == "depth_max" && upper) options.fallback_depth_range.min = 1;
      option.set(Extreme(option.description, option.get(options), upper), &options);
      EXPECT_NO_THROW(Validate(options)) << option.name();
    }
  }
}

TEST(ParametersTest, SettingOneChangesThatOneAlone) {
  for (const auto& changed : PipelineOptionTable()) {
    PipelineOptions options;
    const bool at_top = changed.get(options) == Extreme(changed.description, changed.get(options), true);
    changed.set(Extreme(changed.description, changed.get(options), !at_top), &options);
    for (const auto& option : PipelineOptionTable()) {
      EXPECT_EQ(option.get(options) == option.default_value(), option.name() != changed.name())
          << changed.name() << ", " << option.name();
    }
  }
}

}  // namespace
}  // namespace acmp
