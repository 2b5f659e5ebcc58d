
#include "acmp_mapping/common/option.h"
#include "support/decimal_comma.h"
#include "support/error_text.h"

namespace acmp {
namespace {

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
  Engine engine;
};

OptionList OptionsOf(Engine* e) {
  OptionList list;
  list.Group("engine");
  list.Number("power", &e->power, 0.1, 1, "", "Share of the largest power").WhileRunning();
  list.Flag("on", &e->on, "Whether it runs");
  return list;
}

OptionList OptionsOf(Car* c) {
  OptionList list;
  list.Group("body");
  list.Number("doors", &c->doors, 2, 5, "", "How many doors it has");
  list.Number("length", &c->length_m, 0.5, 20, "m", "How long it is");
  list.Text("owner", &c->owner, "Whose it is");
  list.Choice("color", &c->color, {"red", "green"}, "What it looks like");
  list.Choice("roof", &c->roof, {"red", "green"}, "The same of its roof; empty: none");
  list.Append(OptionsOf(&c->engine));
  return list;
}

std::string Refusal(const std::string& assignment) {
  Car car;
  return ErrorOf([&] { OptionsOf(&car).Set(assignment); });
}

TEST(OptionTest, EveryKindIsSetByNameAndReadAgain) {
  Car car;
  const OptionList options = OptionsOf(&car);
  for (const char* assignment :
       {"doors=2", "length=6", "owner=a=b c", "color=green", "roof=red", "power=0.25", "on=true"}) {
    options.Set(assignment);
  }
  EXPECT_EQ(car.doors, 2);
  EXPECT_EQ(car.length_m, 6);
  EXPECT_EQ(car.owner, "a=b c");
  EXPECT_EQ(car.color, Color::kGreen);
  EXPECT_EQ(car.roof, Color::kRed);
  EXPECT_EQ(car.engine.power, 0.25f);
  EXPECT_TRUE(car.engine.on);
  Car copy;
  for (const Option& option : OptionsOf(&copy)) {
    option.set(options.Find(option.name).get());
    EXPECT_EQ(option.get(), options.Find(option.name).get()) << option.name;
  }
  EXPECT_EQ(copy.engine.power, car.engine.power);
  options.Set("roof=");
  EXPECT_EQ(car.roof, std::nullopt);
  EXPECT_EQ(options.Find("roof").get(), OptionValue(std::string()));
}

TEST(OptionTest, ARefusalNamesOptionValueAndBound) {
  EXPECT_EQ(Refusal("doors=5"), "no error") << "the bound itself";
  EXPECT_THAT(Refusal("doors=6"), HasAll("doors = 6", "[2, 5]"));
  EXPECT_THAT(Refusal("length=0.25"), HasAll("length = 0.25", "[0.5, 20] m"));
  EXPECT_THAT(Refusal("color=blue"), HasAll("color = \"blue\"", "red, green"));
  EXPECT_THAT(Refusal("power=nan"), HasSubstr("power"));
  EXPECT_THAT(Refusal("doors=2.5"), HasAll("\"2.5\"", "an integer"));
  EXPECT_THAT(Refusal("doors=2 "), HasSubstr("an integer"));
  EXPECT_THAT(Refusal("power="), HasSubstr("a number"));
  EXPECT_THAT(Refusal("power=1e999"), HasSubstr("power"));
  EXPECT_THAT(Refusal("on=1"), HasSubstr("true or false"));
  EXPECT_THAT(Refusal("doors"), HasSubstr("NAME=VALUE"));
  EXPECT_THAT(Refusal("door=3"), HasAll("unknown parameter door", "mean doors?"));
  EXPECT_THAT(Refusal("powers=3"), HasSubstr("mean power?")) << "rather than one that is as long";
  EXPECT_THAT(Refusal("weight=3"), HasSubstr("unknown parameter weight: none has a name like that"));
}

TEST(OptionTest, OptionsOfAPartKeepTheirDescriptions) {
  Car car;
  const Option power = OptionsOf(&car).Find("power");
  EXPECT_EQ(power.group, "engine");
  EXPECT_TRUE(power.while_running);
  OptionList some;
  some.Append(OptionsOf(&car), true);
  EXPECT_EQ(some.size(), 1u);
}

TEST(OptionTest, ValuesAreWrittenAsYaml) {
  Car car;
  EXPECT_EQ(ToYaml(true), "true");
  EXPECT_EQ(ToYaml(3), "3");
  EXPECT_EQ(ToYaml(5.0), "5.0") << "not an integer";
  EXPECT_EQ(ToYaml(OptionsOf(&car).Find("power").get()), "0.18") << "the float's own digits";
  EXPECT_EQ(ToYaml(1e-5), "1e-05");
  EXPECT_EQ(ToYaml(std::string()), "\"\"");
  EXPECT_EQ(ToYaml(std::vector<double>{1, 0.5}), "[1.0, 0.5]");
  EXPECT_EQ(ToYaml(std::vector<double>()), "[]");
}

TEST(OptionTest, NumbersHaveAPointInAnyLocale) {
  Car car;
  const DecimalComma comma(std::filesystem::path(testing::TempDir()) / "option_locale");
  EXPECT_EQ(ToYaml(1234567.5), "1234567.5");
  EXPECT_EQ(ToYaml(OptionsOf(&car).Find("power").get()), "0.18");
  EXPECT_EQ(Concat(1234.5), "1234.5");
  if (!comma.has_c_locale()) GTEST_SKIP() << "there is no locale de_DE, and none can be made: streams alone were tried";
}

}  // namespace
}  // namespace acmp
