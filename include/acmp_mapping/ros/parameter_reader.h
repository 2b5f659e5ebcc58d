#pragma once

#include <set>
#include <string>
#include <vector>

#include <XmlRpcValue.h>

namespace acmp {

/// Reads the parameters of one private namespace and remembers which names exist, so that a mistyped one is an error
/// instead of a silent default. Defaults are the values that the targets hold already. All failures are
/// InvalidInputError naming parameter and value.
class ParameterReader {
 public:
  /// @param values the namespace as a struct (NodeHandle::getParam("", ...)); anything else counts as empty
  explicit ParameterReader(const XmlRpc::XmlRpcValue& values) : values_(values) {}

  /// True when the parameter is set. Integers are accepted for floating-point parameters, not the other way round.
  bool Read(const std::string& name, double* value);
  bool Read(const std::string& name, int* value);
  bool Read(const std::string& name, bool* value);
  bool Read(const std::string& name, std::string* value);
  /// A list of numbers; lists of lists are strung together row by row.
  bool Read(const std::string& name, std::vector<double>* value);

  /// Names that somebody else reads.
  void Allow(const std::string& name) { known_.insert(name); }

  /// All names asked for or allowed so far.
  const std::set<std::string>& known() const { return known_; }

  /// Throws for a name that nobody asked for, with the most similar one that exists. Sub-namespaces are left alone:
  /// plugins of image_transport keep their own parameters in some.
  void CheckUnknown() const;

 private:
  XmlRpc::XmlRpcValue* Find(const std::string& name);

  XmlRpc::XmlRpcValue values_;
  std::set<std::string> known_;
};

}  // namespace acmp
