#include "acmp_mapping/pipeline/parameters.h"
#include "acmp_mapping/mapping/window_options.h"

#include <set>

#include "gtest/gtest.h"

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
