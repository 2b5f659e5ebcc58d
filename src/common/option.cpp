#include "acmp_mapping/common/option.h"

#include <algorithm>
#include <cmath>
#include <locale>
#include <nlohmann/json.hpp>
#include <numeric>
#include <sstream>
#include <utility>

#include "acmp_mapping/common/classic_locale.h"
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

[[noreturn]] void RefuseChoice(const std::string& name, const std::string& text,
                               const std::vector<std::string>& choices) {
  throw InvalidInputError(Concat(name, " = \"", text, "\": must be one of ", Join(choices)));
}

/// The fewest digits that read back as the number, with a point: 0.001, 1000000.0.
std::string YamlOf(double number) { return std::isfinite(number) ? nlohmann::json(number).dump() : Concat(number); }
std::string YamlOf(int number) { return Concat(number); }
std::string YamlOf(bool flag) { return flag ? "true" : "false"; }
std::string YamlOf(const std::string& text) { return text.empty() ? "\"\"" : text; }
std::string YamlOf(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) text += (text.empty() ? "" : ", ") + YamlOf(number);
  return "[" + text + "]";
}

/// For people: 0.001, 1000000.
std::string ShortText(double number) {
  const std::string text = YamlOf(number);
  return text.rfind(".0") == text.size() - 2 ? text.substr(0, text.size() - 2) : text;
}

size_t EditDistance(const std::string& a, const std::string& b) {
  std::vector<size_t> previous(b.size() + 1), current(b.size() + 1);
  std::iota(previous.begin(), previous.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    current[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      current[j + 1] = std::min({previous[j + 1] + 1, current[j] + 1, previous[j] + (a[i] == b[j] ? 0 : 1)});
    }
    std::swap(previous, current);
  }
  return previous[b.size()];
}

}  // namespace

void CheckOption(const Option& option, const OptionValue& value, const std::string& prefix) {
  const auto check_range = [&](double number) {
    if (number >= option.min && number <= option.max) return;
    throw InvalidInputError(Concat(prefix, option.name, " = ", ShortText(number), ": must be in [",
                                   ShortText(option.min), ", ", ShortText(option.max), "]",
                                   option.unit.empty() ? "" : " " + option.unit));
  };
  if (const int* integer = std::get_if<int>(&value)) check_range(*integer);
  if (const double* number = std::get_if<double>(&value)) check_range(*number);
  if (const std::string* text = std::get_if<std::string>(&value)) {
    const auto& choices = option.choices;
    if (choices.empty() || std::find(choices.begin(), choices.end(), *text) != choices.end()) return;
    RefuseChoice(prefix + option.name, *text, choices);
  }
}

OptionValue ParseOption(const Option& option, const std::string& text) {
  const OptionValue like = option.get();
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

std::string DescribeValues(const Option& option) {
  const OptionValue like = option.get();
  if (std::holds_alternative<bool>(like)) return "true or false";
  if (!option.choices.empty()) return Join(option.choices);
  if (!std::holds_alternative<int>(like) && !std::holds_alternative<double>(like)) return "";
  return Concat(ShortText(option.min), " to ", ShortText(option.max), option.unit.empty() ? "" : " " + option.unit);
}

double ToDecimal(float value) {
  const ClassicLocale point;
  return std::stod(Concat(value));
}

std::optional<std::string> MostSimilar(const std::string& word, const std::vector<std::string>& words) {
  const auto nearest = std::min_element(words.begin(), words.end(), [&](const auto& a, const auto& b) {
    return EditDistance(a, word) < EditDistance(b, word);
  });
  if (nearest == words.end() || EditDistance(*nearest, word) > word.size() / 2) return std::nullopt;
  return *nearest;
}

Option& OptionList::Add(std::string name, std::string sentence, std::function<OptionValue()> get,
                        std::function<void(const OptionValue&)> set) {
  Option& option = options_.emplace_back();
  option.name = std::move(name);
  option.sentence = std::move(sentence);
  option.group = group_;
  option.get = std::move(get);
  option.set = std::move(set);
  return option;
}

Option& OptionList::Flag(std::string name, bool* field, std::string sentence) {
  return Add(
      std::move(name), std::move(sentence), [field] { return OptionValue(*field); },
      [field](const OptionValue& value) { *field = std::get<bool>(value); });
}

Option& OptionList::Text(std::string name, std::string* field, std::string sentence) {
  return Add(
      std::move(name), std::move(sentence), [field] { return OptionValue(*field); },
      [field](const OptionValue& value) { *field = std::get<std::string>(value); });
}

Option& OptionList::AddChoice(std::string name, std::vector<std::string> choices, std::string sentence,
                              std::function<size_t()> get, std::function<void(size_t)> set) {
  Option& option = Add(
      name, std::move(sentence), [choices, get = std::move(get)] { return OptionValue(choices.at(get())); },
      [name, choices, set = std::move(set)](const OptionValue& value) {
        const auto& text = std::get<std::string>(value);
        const auto choice = std::find(choices.begin(), choices.end(), text);
        if (choice == choices.end()) RefuseChoice(name, text, choices);
        set(static_cast<size_t>(choice - choices.begin()));
      });
  option.choices = std::move(choices);
  return option;
}

void OptionList::Append(const OptionList& part, bool only_while_running) {
  for (const Option& option : part) {
    if (option.while_running || !only_while_running) Append(option);
  }
}

const Option& OptionList::Find(const std::string& name) const {
  std::vector<std::string> names;
  for (const Option& option : options_) {
    if (option.name == name) return option;
    names.push_back(option.name);
  }
  const std::optional<std::string> similar = MostSimilar(name, names);
  throw InvalidInputError(Concat("unknown parameter ", name, ": ",
                                 similar ? "did you mean " + *similar + "?" : "none has a name like that"));
}

void OptionList::Check() const {
  for (const Option& option : options_) CheckOption(option, option.get());
}

void OptionList::Set(const std::string& assignment) const {
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw InvalidInputError(Concat("\"", assignment, "\": must be a parameter and its value, NAME=VALUE"));
  }
  const Option& option = Find(assignment.substr(0, equals));
  option.set(ParseOption(option, assignment.substr(equals + 1)));
}

}  // namespace acmp
