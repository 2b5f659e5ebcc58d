#include "acmp_mapping/common/option.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "support/decimal_comma.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

enum class Color { kRed, kGreen };

struct Engine {
  float power = 0.18f;
  bool on = false;
};

struct Car {
  int doors = 4;
  double length_m = 4.5;
  std::string owner;
  Color color = Color::kRed;
  std::optional<Color> roof;
  std::vector<double> wheels;
  Engine engine;
};

OptionTable<Engine> EngineTable() {
  OptionTable<Engine> table;
  table.Group("engine");
  table.Add(
      Number("power", 0.1, 1, "", "Share of the largest power").WhileRunning(),
      [](auto& e) -> auto& { return e.power; });
  table.Add(
      Flag("on", "Whether it runs"), [](auto& e) -> auto& { return e.on; });
  return table;
}

OptionTable<Car> Table() {
  OptionTable<Car> table;
  table.Group("body");
  table.Add(
      Number("doors", 2, 5, "", "How many doors it has"), [](auto& c) -> auto& { return c.doors; });
  table.Add(
      Number("length", 0.5, 20, "m", "How long it is"), [](auto& c) -> auto& { return c.length_m; });
  table.Add(
      Text("owner", "Whose it is"), [](auto& c) -> auto& { return c.owner; });
  table.Add(
      Choice("color", {"red", "green"}, "What it looks like"), [](auto& c) -> auto& { return c.color; });
  table.Add(
      Choice("roof", {"red", "green", ""}, "The same of its roof; empty: none"),
      [](auto& c) -> auto& { return c.roof; });
  table.Add(
      Text("wheels", "Their diameters"), [](auto& c) -> auto& { return c.wheels; });
  table.Embed(
      EngineTable(), [](auto& c) -> auto& { return c.engine; });
  return table;
}

std::string Refusal(const std::string& assignment) {
  Car car;
  try {
    SetOption(Table(), assignment, &car);
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "(accepted)";
}

TEST(OptionTest, EveryKindIsSetByName) {
  Car car;
  for (const char* assignment :
       {"doors=2", "length=6", "owner=a=b c", "color=green", "roof=red", "power=0.25", "on=true"}) {
    SetOption(Table(), assignment, &car);
  }
  EXPECT_EQ(car.doors, 2);
  EXPECT_EQ(car.length_m, 6);
  EXPECT_EQ(car.owner, "a=b c");
  EXPECT_EQ(car.color, Color::kGreen);
  EXPECT_EQ(car.roof, Color::kRed);
  EXPECT_EQ(car.engine.power, 0.25f);
  EXPECT_TRUE(car.engine.on);
  SetOption(Table(), "roof=", &car);
  EXPECT_EQ(car.roof, std::nullopt);
}

TEST(OptionTest, WhatIsSetCanBeReadAgain) {
  const Car car = {3, 2.5, "me", Color::kGreen, Color::kGreen, {1, 2}, {0.7f, true}};
  Car copy;
  for (const Option<Car>& option : Table()) option.set(option.get(car), &copy);
  for (const Option<Car>& option : Table()) EXPECT_EQ(option.get(copy), option.get(car)) << option.name();
  EXPECT_EQ(copy.engine.power, car.engine.power);
  EXPECT_EQ(copy.wheels, car.wheels);
}

TEST(OptionTest, ARefusalNamesOptionValueAndBound) {
  EXPECT_EQ(Refusal("doors=5"), "(accepted)") << "the bound itself";
  EXPECT_THAT(Refusal("doors=6"), AllOf(HasSubstr("doors = 6"), HasSubstr("[2, 5]")));
  EXPECT_THAT(Refusal("length=0.25"), AllOf(HasSubstr("length = 0.25"), HasSubstr("[0.5, 20] m")));
  EXPECT_THAT(Refusal("color=blue"), AllOf(HasSubstr("color = \"blue\""), HasSubstr("red, green")));
  EXPECT_THAT(Refusal("power=nan"), HasSubstr("power"));
  EXPECT_THAT(Refusal("doors=2.5"), AllOf(HasSubstr("\"2.5\""), HasSubstr("an integer")));
  EXPECT_THAT(Refusal("doors=2 "), HasSubstr("an integer"));
  EXPECT_THAT(Refusal("power="), HasSubstr("a number"));
  EXPECT_THAT(Refusal("power=1e999"), HasSubstr("power"));
  EXPECT_THAT(Refusal("on=1"), HasSubstr("true or false"));
  EXPECT_THAT(Refusal("doors"), HasSubstr("NAME=VALUE"));
  EXPECT_THAT(Refusal("door=3"), AllOf(HasSubstr("unknown parameter door"), HasSubstr("mean doors?")));
  EXPECT_THAT(Refusal("weight=3"), HasSubstr("unknown parameter weight: none has a name like that"));
}

TEST(OptionTest, EmbeddedOptionsKeepTheirDescriptions) {
  const OptionDescription power = Table().Find("power").description;
  EXPECT_EQ(power.group, "engine");
  EXPECT_TRUE(power.while_running);
  OptionTable<Car> some;
  some.Embed(
      EngineTable(), [](auto& c) -> auto& { return c.engine; },
      [](const OptionDescription& option) { return option.while_running; });
  EXPECT_EQ(some.size(), 1u);
}

TEST(OptionTest, ValuesAreWrittenAsYaml) {
  EXPECT_EQ(ToYaml(true), "true");
  EXPECT_EQ(ToYaml(3), "3");
  EXPECT_EQ(ToYaml(5.0), "5.0") << "not an integer";
  EXPECT_EQ(ToYaml(Table().Find("power").default_value()), "0.18") << "the float's own digits";
  EXPECT_EQ(ToYaml(1e-5), "1e-05");
  EXPECT_EQ(ToYaml(std::string()), "\"\"");
  EXPECT_EQ(ToYaml(std::vector<double>{1, 0.5}), "[1.0, 0.5]");
  EXPECT_EQ(ToYaml(std::vector<double>()), "[]");
}

TEST(OptionTest, NumbersHaveAPointInAnyLocale) {
  const DecimalComma comma(std::filesystem::path(testing::TempDir()) / "option_locale");
  EXPECT_EQ(ToYaml(1234567.5), "1234567.5");
  EXPECT_EQ(ToYaml(Table().Find("power").default_value()), "0.18");
  EXPECT_EQ(Concat(1234.5), "1234.5");
  if (!comma.has_c_locale()) GTEST_SKIP() << "there is no locale de_DE, and none can be made: streams alone were tried";
}

TEST(OptionTest, ValuesAreDescribed) {
  const auto describe = [](const char* name) {
    const Option<Car> option = Table().Find(name);
    return DescribeValues(option.description, option.default_value());
  };
  EXPECT_EQ(describe("length"), "0.5 to 20 m");
  EXPECT_EQ(describe("color"), "red, green");
  EXPECT_EQ(describe("on"), "true or false");
  EXPECT_EQ(describe("owner"), "");
}

}  // namespace
}  // namespace acmp
