#include "acmp_mapping/ros/parameter_reader.h"

#include <utility>

#include "acmp_mapping/common/edit_distance.h"
#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using XmlRpc::XmlRpcValue;

[[noreturn]] void Refuse(const std::string& name, const XmlRpcValue& value, const char* expected) {
  std::ostringstream text;
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

}  // namespace

XmlRpcValue* ParameterReader::Find(const std::string& name) {
  known_.insert(name);
  if (values_.getType() != XmlRpcValue::TypeStruct || !values_.hasMember(name)) return nullptr;
  return &values_[name];
}

bool ParameterReader::Read(const std::string& name, double* value) {
  XmlRpcValue* found = Find(name);
  if (found && !ToDouble(*found, value)) Refuse(name, *found, "a number");
  return found != nullptr;
}

bool ParameterReader::Read(const std::string& name, int* value) {
  XmlRpcValue* found = Find(name);
  if (!found) return false;
  if (found->getType() != XmlRpcValue::TypeInt) Refuse(name, *found, "an integer");
  *value = static_cast<int&>(*found);
  return true;
}

bool ParameterReader::Read(const std::string& name, bool* value) {
  XmlRpcValue* found = Find(name);
  if (!found) return false;
  if (found->getType() != XmlRpcValue::TypeBoolean) Refuse(name, *found, "true or false");
  *value = static_cast<bool&>(*found);
  return true;
}

bool ParameterReader::Read(const std::string& name, std::string* value) {
  XmlRpcValue* found = Find(name);
  if (!found) return false;
  if (found->getType() != XmlRpcValue::TypeString) Refuse(name, *found, "a text");
  *value = static_cast<std::string&>(*found);
  return true;
}

bool ParameterReader::Read(const std::string& name, std::vector<double>* value) {
  XmlRpcValue* found = Find(name);
  if (!found) return false;
  std::vector<double> numbers;
  if (found->getType() != XmlRpcValue::TypeArray || !AppendNumbers(*found, &numbers)) {
    Refuse(name, *found, "a list of numbers");
  }
  *value = std::move(numbers);
  return true;
}

void ParameterReader::CheckUnknown() const {
  if (values_.getType() != XmlRpcValue::TypeStruct) return;
  XmlRpcValue values = values_;  // iteration is not const
  for (auto& member : values) {
    const std::string& name = member.first;
    if (known_.count(name) > 0 || member.second.getType() == XmlRpcValue::TypeStruct) continue;
    const std::string nearest = MostSimilar(name, {known_.begin(), known_.end()});
    throw InvalidInputError(Concat("unknown parameter ~", name, ": did you mean ~", nearest, "?"));
  }
}

}  // namespace acmp
