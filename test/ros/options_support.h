#pragma once

#include <map>
#include <string>

#include <xmlrpcpp/XmlRpcValue.h>

namespace acmp::test {

/// A parameter namespace.
inline XmlRpc::XmlRpcValue Struct(const std::map<std::string, XmlRpc::XmlRpcValue>& members) {
  XmlRpc::XmlRpcValue value;
  for (const auto& [name, member] : members) value[name] = member;
  return value;
}

}  // namespace acmp::test
