#pragma once

#include <functional>
#include <map>
#include <string>

#include <xmlrpcpp/XmlRpcValue.h>

#include "acmp_mapping/common/error.h"

namespace acmp::test {

/// A parameter namespace.
inline XmlRpc::XmlRpcValue Struct(const std::map<std::string, XmlRpc::XmlRpcValue>& members) {
  XmlRpc::XmlRpcValue value;
  for (const auto& [name, member] : members) value[name] = member;
  return value;
}

/// What InvalidInputError says.
inline std::string Refusal(const std::function<void()>& action) {
  try {
    action();
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "(accepted)";
}

}  // namespace acmp::test
