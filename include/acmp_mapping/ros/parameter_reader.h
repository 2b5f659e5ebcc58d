#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <XmlRpcValue.h>

#include "acmp_mapping/common/option.h"

namespace acmp {

/// Reads the parameters of one private namespace and remembers which names exist, so that a mistyped one is noticed.
class ParameterReader {
 public:
  /// @param values the namespace as a struct (NodeHandle::getParam("", ...)); anything else counts as empty
  explicit ParameterReader(const XmlRpc::XmlRpcValue& values) : values_(values) {}

  /// None when the parameter is not set. Integers are accepted for floating-point numbers, not the other way round;
  /// lists of lists of numbers are strung together row by row. Throws InvalidInputError naming parameter and value for
  /// one of another kind than `like`, and for one out of bounds.
  std::optional<OptionValue> Read(const OptionDescription& option, const OptionValue& like);

  /// Names that somebody else reads.
  void Allow(const std::string& name) { known_.insert(name); }

  /// A name that another node reads from its own namespace.
  void SetElsewhere(const std::string& name, const std::string& node) { elsewhere_[name] = node; }

  /// A sentence for each name that nobody asked for, with the most similar one that exists. Sub-namespaces are left
  /// alone: plugins of image_transport keep their own parameters in some.
  std::vector<std::string> DescribeUnknown() const;

 private:
  XmlRpc::XmlRpcValue values_;
  std::set<std::string> known_;
  std::map<std::string, std::string> elsewhere_;  ///< node of each name
};

/// Reads all options of the table that are set, over what `options` has.
template <class Options>
void ReadOptions(const OptionTable<Options>& table, ParameterReader* reader, Options* options) {
  for (const Option<Options>& option : table) {
    if (const auto value = reader->Read(option.description, option.get(*options))) option.set(*value, options);
  }
}

}  // namespace acmp
