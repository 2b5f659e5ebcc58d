#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace acmp {

/// What an option may hold. An enumeration is the name of its value, a matrix its numbers row by row.
using OptionValue = std::variant<bool, int, double, std::string, std::vector<double>>;

/// All that there is to say about an option. Whatever reads, checks, lists or explains options takes it from here.
struct OptionDescription {
  std::string name;
  std::string sentence;  ///< what it does, for a person who does not know the source; without a full stop
  std::string unit;      ///< of a number; empty: none
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  std::vector<std::string> choices;  ///< of a text; empty: any text
  bool while_running = false;        ///< may change while a mapper runs
  std::string group;                 ///< heading that it stands under

  OptionDescription WhileRunning() const;
};

OptionDescription Flag(std::string name, std::string sentence);
/// An integer or floating-point number in [min, max].
OptionDescription Number(std::string name, double min, double max, std::string unit, std::string sentence);
/// Any text, or a list of numbers.
OptionDescription Text(std::string name, std::string sentence);
/// One of several texts; for an enumeration, the names of its values 0, 1, ...; for an optional one, "" after them.
OptionDescription Choice(std::string name, std::vector<std::string> choices, std::string sentence);

/// Throws InvalidInputError naming option, value and bound. NaN is out of all bounds.
/// @param prefix stands before the name: "parameter ~"
void CheckOption(const OptionDescription& option, const OptionValue& value, const std::string& prefix = "");

/// A value of the same kind as `like` from its text, checked. Throws InvalidInputError naming option and text.
OptionValue ParseOption(const OptionDescription& option, const OptionValue& like, const std::string& text);

/// As it is written in YAML: true, 2.5, auto, "", [1, 2].
std::string ToYaml(const OptionValue& value);

/// "true or false", "2 to 64 px", "auto, cuda, cpu"; empty for any text.
std::string DescribeValues(const OptionDescription& option, const OptionValue& like);

/// Throws InvalidInputError that names the most similar one of `names`, if one is similar.
[[noreturn]] void RefuseUnknownOption(const std::string& name, const std::vector<std::string>& names);

namespace internal {

/// The shortest decimal that reads back as the float: 0.18 rather than 0.180000007.
double ToDecimal(float value);
size_t IndexOfChoice(const OptionDescription& option, const std::string& choice);

template <class T>
OptionValue ToValue(const OptionDescription& option, const T& field);
/// None is the empty text.
template <class T>
OptionValue ToValue(const OptionDescription& option, const std::optional<T>& field) {
  return field ? ToValue(option, *field) : OptionValue(std::string());
}

template <class T>
OptionValue ToValue(const OptionDescription& option, const T& field) {
  if constexpr (std::is_enum_v<T>) {
    return option.choices.at(static_cast<size_t>(field));
  } else if constexpr (std::is_same_v<T, float>) {
    return ToDecimal(field);
  } else {
    return field;
  }
}

template <class T>
void FromValue(const OptionDescription& option, const OptionValue& value, T* field);
template <class T>
void FromValue(const OptionDescription& option, const OptionValue& value, std::optional<T>* field) {
  field->reset();
  if (std::get<std::string>(value).empty()) return;
  FromValue(option, value, &field->emplace());
}

template <class T>
void FromValue(const OptionDescription& option, const OptionValue& value, T* field) {
  if constexpr (std::is_enum_v<T>) {
    *field = static_cast<T>(IndexOfChoice(option, std::get<std::string>(value)));
  } else if constexpr (std::is_same_v<T, float>) {
    *field = static_cast<float>(std::get<double>(value));
  } else {
    *field = std::get<T>(value);
  }
}

}  // namespace internal

/// A described option and where it is kept in `Options`.
template <class Options>
struct Option {
  OptionDescription description;
  std::function<OptionValue(const Options&)> get;
  /// Without a check of bounds, but may throw InvalidInputError.
  std::function<void(const OptionValue&, Options*)> set;

  const std::string& name() const { return description.name; }
  OptionValue default_value() const { return get(Options()); }
};

/// All options of one struct that a user can set, in the order in which they are listed.
template <class Options>
class OptionTable {
 public:
  /// What is added from now on stands under this heading.
  void Group(std::string heading) { group_ = std::move(heading); }

  /// @param field from options (const or not) to a bool, int, float, double, string, enumeration or optional
  /// enumeration
  template <class Field>
  void Add(const OptionDescription& description, const Field& field) {
    using T = std::decay_t<decltype(field(std::declval<Options&>()))>;
    Add(
        description,
        [description, field](const Options& options) {
          const T& value = field(options);
          return internal::ToValue(description, value);
        },
        [description, field](const OptionValue& value, Options* options) {
          T& target = field(*options);
          internal::FromValue(description, value, &target);
        });
  }

  void Add(OptionDescription description, std::function<OptionValue(const Options&)> get,
           std::function<void(const OptionValue&, Options*)> set) {
    if (!group_.empty()) description.group = group_;
    options_.push_back({std::move(description), std::move(get), std::move(set)});
  }

  /// Adds the options of a struct that is part of this one, under their own headings.
  /// @param part from options (const or not) to it
  /// @param wanted only these; null: all
  template <class Part, class GetPart>
  void Embed(const OptionTable<Part>& table, const GetPart& part, bool (*wanted)(const OptionDescription&) = nullptr) {
    for (const Option<Part>& option : table) {
      if (wanted && !wanted(option.description)) continue;
      options_.push_back({option.description, [option, part](const Options& o) { return option.get(part(o)); },
                          [option, part](const OptionValue& v, Options* o) { option.set(v, &part(*o)); }});
    }
  }

  auto begin() const { return options_.begin(); }
  auto end() const { return options_.end(); }
  size_t size() const { return options_.size(); }

  /// Throws InvalidInputError that names the most similar option.
  const Option<Options>& Find(const std::string& name) const {
    std::vector<std::string> names;
    for (const Option<Options>& option : options_) {
      if (option.name() == name) return option;
      names.push_back(option.name());
    }
    RefuseUnknownOption(name, names);
  }

  /// Throws InvalidInputError for the first option that is out of its bounds.
  void Check(const Options& options) const {
    for (const Option<Options>& option : options_) CheckOption(option.description, option.get(options));
  }

 private:
  std::string group_;
  std::vector<Option<Options>> options_;
};

/// Name and value of "NAME=VALUE"; throws InvalidInputError for anything else.
std::pair<std::string, std::string> SplitAssignment(const std::string& assignment);

/// "NAME=VALUE": sets that option. Throws InvalidInputError for an unknown name, with the most similar one, for a value
/// of another kind and for one out of bounds.
template <class Options>
void SetOption(const OptionTable<Options>& table, const std::string& assignment, Options* options) {
  const auto [name, text] = SplitAssignment(assignment);
  const Option<Options>& option = table.Find(name);
  option.set(ParseOption(option.description, option.get(*options), text), options);
}

}  // namespace acmp
