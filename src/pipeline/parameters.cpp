#include "acmp_mapping/pipeline/parameters.h"

#include <sstream>
#include <type_traits>

#include "acmp_mapping/common/edit_distance.h"
#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

template <class T>
void Parse(const std::string& name, const std::string& text, T* value) {
  std::istringstream stream(text);
  std::conditional_t<std::is_enum_v<T>, int, T> number = {};
  const char* kind = std::is_floating_point_v<T> ? "a number" : "an integer";
  if constexpr (std::is_same_v<T, bool>) {
    kind = "true or false";
    stream >> std::boolalpha;
  }
  // Streams take "-1" for an unsigned number.
  const bool wraps = std::is_unsigned_v<T> && text.find('-') != std::string::npos;
  if (wraps || !(stream >> number) || stream.peek() != std::istringstream::traits_type::eof()) {
    throw InvalidInputError(Concat(name, " = \"", text, "\": must be ", kind));
  }
  *value = static_cast<T>(number);
}

}  // namespace

void SetParameter(const std::string& assignment, PipelineOptions* options) {
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos) {
    throw InvalidInputError(Concat("\"", assignment, "\": must be a parameter and its value, NAME=VALUE"));
  }
  const std::string name = assignment.substr(0, equals);
  const std::string text = assignment.substr(equals + 1);
  bool found = false;
  std::vector<std::string> names;
  VisitPipelineParameters(*options, [&](const char* known, auto& option) {
    names.emplace_back(known);
    if (name != known) return;
    found = true;
    Parse(name, text, &option);
  });
  if (!found) {
    throw InvalidInputError(Concat("unknown parameter ", name, ": did you mean ", MostSimilar(name, names), "?"));
  }
}

}  // namespace acmp
