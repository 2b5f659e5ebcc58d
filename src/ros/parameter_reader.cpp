#include "acmp_mapping/ros/parameter_reader.h"

#include <optional>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using XmlRpc::XmlRpcValue;

[[noreturn]] void Refuse(const std::string& name, const XmlRpcValue& value, const char* expected) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  value.write(text);
  throw InvalidInputError(Concat("parameter ~", name, " = ", text.str(), ": must be ", expected));
}

bool ToDouble(XmlRpcValue& value, double* number) {
  if (value.getType() == XmlRpcValue::TypeInt) {
    *number = static_cast<int&>(value);
    return true;
  }
  if (value.getType() != XmlRpcValue::TypeDouble) return false;
  *number = static_cast<double&>(value);
  return true;
}

bool AppendNumbers(XmlRpcValue& value, std::vector<double>* numbers) {
  double number = 0;
  if (ToDouble(value, &number)) {
    numbers->push_back(number);
    return true;
  }
  if (value.getType() != XmlRpcValue::TypeArray) return false;
  for (int i = 0; i < value.size(); ++i) {
    if (!AppendNumbers(value[i], numbers)) return false;
  }
  return true;
}

OptionValue Convert(const std::string& name, XmlRpcValue& value, const OptionValue& like) {
  const XmlRpcValue::Type type = value.getType();
  if (std::holds_alternative<bool>(like)) {
    if (type != XmlRpcValue::TypeBoolean) Refuse(name, value, "true or false");
    return static_cast<bool>(static_cast<bool&>(value));
  }
  if (std::holds_alternative<int>(like)) {
    if (type != XmlRpcValue::TypeInt) Refuse(name, value, "an integer");
    return static_cast<int>(static_cast<int&>(value));
  }
  if (std::holds_alternative<double>(like)) {
    double number = 0;
    if (!ToDouble(value, &number)) Refuse(name, value, "a number");
    return number;
  }
  if (std::holds_alternative<std::string>(like)) {
    if (type != XmlRpcValue::TypeString) Refuse(name, value, "a text");
    return static_cast<std::string>(static_cast<std::string&>(value));
  }
  std::vector<double> numbers;
  if (type != XmlRpcValue::TypeArray || !AppendNumbers(value, &numbers)) Refuse(name, value, "a list of numbers");
  return numbers;
}

}  // namespace

void ParameterReader::Read(const OptionList& options) {
  for (const Option& option : options) {
    known_.insert(option.name);
    if (values_.getType() != XmlRpcValue::TypeStruct || !values_.hasMember(option.name)) continue;
    const OptionValue value = Convert(option.name, values_[option.name], option.get());
    CheckOption(option, value, "parameter ~");
    option.set(value);
  }
}

std::vector<std::string> ParameterReader::DescribeUnknown() const {
  std::vector<std::string> sentences;
  if (values_.getType() != XmlRpcValue::TypeStruct) return sentences;
  XmlRpcValue values = values_;  // iteration is not const
  for (auto& member : values) {
    const std::string& name = member.first;
    if (known_.count(name) > 0 || member.second.getType() == XmlRpcValue::TypeStruct) continue;
    const auto elsewhere = elsewhere_.find(name);
    if (elsewhere != elsewhere_.end()) {
      sentences.push_back(Concat("parameter ~", name, " has no effect here: it is one of ", elsewhere->second));
      continue;
    }
    const std::optional<std::string> similar = MostSimilar(name, {known_.begin(), known_.end()});
    sentences.push_back(Concat("unknown parameter ~", name, " has no effect: ",
                               similar ? "did you mean ~" + *similar + "?" : "none has a name like that"));
  }
  return sentences;
}

}  // namespace acmp
