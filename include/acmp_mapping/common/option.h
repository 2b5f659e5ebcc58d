#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

namespace acmp {

/// What an option may hold. An enumeration is the name of its value, a matrix its numbers row by row.
using OptionValue = std::variant<bool, int, double, std::string, std::vector<double>>;

/// An option of some object: all that there is to say about it, and its value there. Whatever reads, checks, lists or
/// explains options takes it from here.
struct Option {
  std::string name;
  std::string sentence;  ///< what it does, for a person who does not know the source; without a full stop
  std::string unit;      ///< of a number; empty: none
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::vector<std::string> choices;  ///< of a text; empty: any text
  bool while_running = false;        ///< may change while a mapper runs
  std::string group;                 ///< heading that it stands under
  std::function<OptionValue()> get;
  std::function<void(const OptionValue&)> set;  ///< without a check of bounds, but may throw InvalidInputError

  void WhileRunning() { while_running = true; }
};

/// Throws InvalidInputError naming option, value and bound. NaN is out of all bounds.
/// @param prefix stands before the name: "parameter ~"
void CheckOption(const Option& option, const OptionValue& value, const std::string& prefix = "");

/// A value of the option's kind from its text, checked. Throws InvalidInputError naming option and text.
OptionValue ParseOption(const Option& option, const std::string& text);

/// As it is written in YAML: true, 2.5, auto, "", [1, 2].
std::string ToYaml(const OptionValue& value);

/// "true or false", "2 to 64 px", "auto, cuda, cpu"; empty for any text.
std::string DescribeValues(const Option& option);

/// The shortest decimal that reads back as the float: 0.18 rather than 0.180000007.
double ToDecimal(float value);

/// The first of the words with the least edit distance (insertions, deletions and replacements of a letter) to `word`;
/// nothing where even that is more than half of its letters.
std::optional<std::string> MostSimilar(const std::string& word, const std::vector<std::string>& words);

/// All options of an object that a user can set, in the order in which they are listed. They refer to the object.
class OptionList {
 public:
  /// What is added from now on stands under this heading.
  void Group(std::string heading) { group_ = std::move(heading); }

  Option& Flag(std::string name, bool* field, std::string sentence);
  Option& Text(std::string name, std::string* field, std::string sentence);
  /// An integer or floating-point number in [min, max].
  template <class T>
  Option& Number(std::string name, T* field, double min, double max, std::string unit, std::string sentence) {
    using Held = std::conditional_t<std::is_same_v<T, int>, int, double>;
    Option& option = Add(
        std::move(name), std::move(sentence),
        [field]() -> OptionValue {
          if constexpr (std::is_same_v<T, float>) return ToDecimal(*field);
          return Held{*field};
        },
        [field](const OptionValue& value) { *field = static_cast<T>(std::get<Held>(value)); });
    option.unit = std::move(unit);
    option.min = min;
    option.max = max;
    return option;
  }
  /// One of several texts: the names of the enumeration's values 0, 1, ...
  template <class Enum>
  Option& Choice(std::string name, Enum* field, std::vector<std::string> choices, std::string sentence) {
    return AddChoice(
        std::move(name), std::move(choices), std::move(sentence), [field] { return static_cast<size_t>(*field); },
        [field](size_t index) { *field = static_cast<Enum>(index); });
  }
  /// The same with "" for none after them.
  template <class Enum>
  Option& Choice(std::string name, std::optional<Enum>* field, std::vector<std::string> choices, std::string sentence) {
    const size_t none = choices.size();
    choices.emplace_back();
    return AddChoice(
        std::move(name), std::move(choices), std::move(sentence),
        [field, none] { return *field ? static_cast<size_t>(**field) : none; },
        [field, none](size_t index) {
          *field = index == none ? std::nullopt : std::optional(static_cast<Enum>(index));
        });
  }
  Option& Add(std::string name, std::string sentence, std::function<OptionValue()> get,
              std::function<void(const OptionValue&)> set);

  /// An option of a part of the object, under its own heading.
  void Append(const Option& option) { options_.push_back(option); }
  /// All of them, or only those that may change while a mapper runs.
  void Append(const OptionList& part, bool only_while_running = false);

  auto begin() const { return options_.begin(); }
  auto end() const { return options_.end(); }
  size_t size() const { return options_.size(); }

  /// Throws InvalidInputError that names the most similar option.
  const Option& Find(const std::string& name) const;
  /// Throws InvalidInputError for the first option that is out of its bounds.
  void Check() const;
  /// "NAME=VALUE": sets that option. Throws InvalidInputError for an unknown name, with the most similar one, for a
  /// value of another kind and for one out of bounds.
  void Set(const std::string& assignment) const;

 private:
  Option& AddChoice(std::string name, std::vector<std::string> choices, std::string sentence,
                    std::function<size_t()> get, std::function<void(size_t)> set);

  std::string group_;
  std::vector<Option> options_;
};

}  // namespace acmp
