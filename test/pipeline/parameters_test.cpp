#include "acmp_mapping/pipeline/presets.h"

#include "gtest/gtest.h"

namespace acmp {
namespace {

/// A bound of the option, or the other value of a flag.
OptionValue Extreme(const Option& option, bool upper) {
  const double bound = upper ? option.max : option.min;
  if (std::holds_alternative<bool>(option.get())) return upper;
  if (std::holds_alternative<int>(option.get())) return static_cast<int>(bound);
  return bound;
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
