#include <set>

#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mapping/window_options.h"
#include "acmp_mapping/pipeline/presets.h"

namespace acmp {
namespace {

/// A bound of the option, or the other value of a flag.
OptionValue Extreme(const Option& option, bool upper) {
  const double bound = upper ? option.max : option.min;
  if (std::holds_alternative<bool>(option.get())) return upper;
  if (std::holds_alternative<int>(option.get())) return static_cast<int>(bound);
  return bound;
}

TEST(ParametersTest, EachBoundOfThePipelineIsLegal) {
  for (const std::string& preset : PresetNames()) {
    PipelineOptions options;
    for (const Option& option : OptionsOf(&options)) {
      for (const bool upper : {false, true}) {
        options = MakePreset(preset);
        option.set(Extreme(option, upper));
        if (options.multi_scale && (options.use_planar_prior || options.fill.enabled)) continue;  // refused
        EXPECT_NO_THROW(Validate(options)) << preset << ", " << option.name;
      }
    }
  }
}

TEST(ParametersTest, EachBoundOfTheWindowIsLegalWithWhatBelongsToIt) {
  DenseMapperOptions options;
  for (const Option& option : OptionsOf(&options)) {
    for (const bool upper : {false, true}) {
      options = {};
      options.window_size = upper ? kMaxWindowSize : 3;
      options.lookahead = 0;
      options.min_source_views = 1;
      if (option.name == "depth_min" && upper) continue;  // nothing is farther
      if (!option.choices.empty()) continue;              // no bounds
      if (option.name == "depth_min") options.fallback_depth_range.max = 0;
      if (option.name == "depth_max" && upper) options.fallback_depth_range.min = 1;
      option.set(Extreme(option, upper));
      EXPECT_NO_THROW(Validate(options)) << option.name;
    }
  }
}

TEST(ParametersTest, SettingOneChangesThatOneAlone) {
  PipelineOptions options, defaults;
  const OptionList of_defaults = OptionsOf(&defaults);
  for (const Option& changed : OptionsOf(&options)) {
    options = {};
    const bool at_top = changed.get() == Extreme(changed, true);
    changed.set(Extreme(changed, !at_top));
    for (const Option& option : OptionsOf(&options)) {
      EXPECT_EQ(option.get() == of_defaults.Find(option.name).get(), option.name != changed.name)
          << changed.name << ", " << option.name;
    }
  }
}

}  // namespace
}  // namespace acmp
