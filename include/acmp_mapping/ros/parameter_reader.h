#pragma once

#include <map>
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

  /// Sets those of the options whose parameters are set. Integers are accepted for floating-point numbers, not the
  /// other way round; lists of lists of numbers are strung together row by row. Throws InvalidInputError naming
  /// parameter and value for one of another kind, and for one out of bounds.
  void Read(const OptionList& options);

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

}  // namespace acmp
