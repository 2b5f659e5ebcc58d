#include "acmp_mapping/common/option.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iomanip>
#include <locale>
#include <sstream>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/edit_distance.h"
#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::string Join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + (word.empty() ? "\"\"" : word);
  return text;
}

template <class T>
T ParseNumber(const std::string& name, const std::string& text, const char* kind) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  stream >> std::boolalpha;
  T number = {};
  if (!(stream >> number) || stream.peek() != std::istringstream::traits_type::eof()) {
    throw InvalidInputError(Concat(name, " = \"", text, "\": must be ", kind));
  }
  return number;
}

/// The fewest digits, up to 15, that read back as the number: 0.001, 1000000.
std::string ShortestText(double number) {
  constexpr double kWhole = 1e15;
  if (std::abs(number) < kWhole && number == std::floor(number)) return Concat(static_cast<int64_t>(number));
  const ClassicLocale point;
  std::string text;
  for (int digits = 6; digits <= 15; ++digits) {
    text = Concat(std::setprecision(digits), number);
    if (std::stod(text) == number) break;
  }
  return text;
}

/// For readers of YAML, a floating-point number has a point: 5.0.
std::string YamlOf(double number) {
  const std::string text = ShortestText(number);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}
std::string YamlOf(int number) { return Concat(number); }
std::string YamlOf(bool flag) { return flag ? "true" : "false"; }
std::string YamlOf(const std::string& text) { return text.empty() ? "\"\"" : text; }
std::string YamlOf(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) text += (text.empty() ? "" : ", ") + YamlOf(number);
  return "[" + text + "]";
}

}  // namespace

OptionDescription OptionDescription::WhileRunning() const {
  OptionDescription description = *this;
  description.while_running = true;
  return description;
}

OptionDescription Flag(std::string name, std::string sentence) {
  return Text(std::move(name), std::move(sentence));  // nothing but these two
}

OptionDescription Number(std::string name, double min, double max, std::string unit, std::string sentence) {
  OptionDescription description = Text(std::move(name), std::move(sentence));
  description.unit = std::move(unit);
  description.min = min;
  description.max = max;
  return description;
}

OptionDescription Text(std::string name, std::string sentence) {
  OptionDescription description;
  description.name = std::move(name);
  description.sentence = std::move(sentence);
  return description;
}

OptionDescription Choice(std::string name, std::vector<std::string> choices, std::string sentence) {
  OptionDescription description = Text(std::move(name), std::move(sentence));
  description.choices = std::move(choices);
  return description;
}

void CheckOption(const OptionDescription& option, const OptionValue& value, const std::string& prefix) {
  const auto check_range = [&](double number) {
    if (number >= option.min && number <= option.max) return;
    throw InvalidInputError(Concat(prefix, option.name, " = ", ShortestText(number), ": must be in [",
                                   ShortestText(option.min), ", ", ShortestText(option.max), "]",
                                   option.unit.empty() ? "" : " " + option.unit));
  };
  if (const int* integer = std::get_if<int>(&value)) check_range(*integer);
  if (const double* number = std::get_if<double>(&value)) check_range(*number);
  if (const std::string* text = std::get_if<std::string>(&value)) {
    const auto& choices = option.choices;
    if (choices.empty() || std::find(choices.begin(), choices.end(), *text) != choices.end()) return;
    throw InvalidInputError(Concat(prefix, option.name, " = \"", *text, "\": must be one of ", Join(choices)));
  }
}

OptionValue ParseOption(const OptionDescription& option, const OptionValue& like, const std::string& text) {
  OptionValue value = text;
  if (std::holds_alternative<bool>(like)) value = ParseNumber<bool>(option.name, text, "true or false");
  if (std::holds_alternative<int>(like)) value = ParseNumber<int>(option.name, text, "an integer");
  if (std::holds_alternative<double>(like)) value = ParseNumber<double>(option.name, text, "a number");
  if (std::holds_alternative<std::vector<double>>(like)) {
    throw InvalidInputError(Concat(option.name, " = \"", text, "\": a list cannot be given in this way"));
  }
  CheckOption(option, value);
  return value;
}

std::string ToYaml(const OptionValue& value) {
  return std::visit([](const auto& held) { return YamlOf(held); }, value);
}

std::string DescribeValues(const OptionDescription& option, const OptionValue& like) {
  if (std::holds_alternative<bool>(like)) return "true or false";
  if (!option.choices.empty()) return Join(option.choices);
  if (!std::holds_alternative<int>(like) && !std::holds_alternative<double>(like)) return "";
  return Concat(ShortestText(option.min), " to ", ShortestText(option.max),
                option.unit.empty() ? "" : " " + option.unit);
}

void RefuseUnknownOption(const std::string& name, const std::vector<std::string>& names) {
  const std::optional<std::string> similar = MostSimilar(name, names);
  throw InvalidInputError(Concat("unknown parameter ", name, ": ",
                                 similar ? "did you mean " + *similar + "?" : "none has a name like that"));
}

std::pair<std::string, std::string> SplitAssignment(const std::string& assignment) {
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw InvalidInputError(Concat("\"", assignment, "\": must be a parameter and its value, NAME=VALUE"));
  }
  return {assignment.substr(0, equals), assignment.substr(equals + 1)};
}

double internal::ToDecimal(float value) {
  const ClassicLocale point;
  return std::stod(Concat(value));
}

size_t internal::IndexOfChoice(const OptionDescription& option, const std::string& choice) {
  CheckOption(option, choice);
  return static_cast<size_t>(std::find(option.choices.begin(), option.choices.end(), choice) - option.choices.begin());
}

}  // namespace acmp
