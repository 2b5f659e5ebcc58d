#pragma once

#include <locale>
#include <sstream>
#include <stdexcept>
#include <string>

namespace acmp {

/// The caller's input or use is wrong: options out of bounds, unreadable or inconsistent data. Tools exit with 2. The
/// message names the value and the bound it violates.
class InvalidInputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Correct input could not be processed: disk full, no memory, device failure. Tools exit with 1.
class ProcessingError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Joins the arguments into one string, for error messages: Concat("K[0] = ", fx, ": must be > 0").
template <class... Args>
std::string Concat(const Args&... args) {
  std::ostringstream stream;
  stream.imbue(std::locale::classic());
  (stream << ... << args);
  return stream.str();
}

/// Throws InvalidInputError unless low <= value <= high. NaN is always refused.
template <class T>
void CheckRange(const char* name, const T& value, const T& low, const T& high) {
  if (!(value >= low && value <= high)) {
    throw InvalidInputError(Concat(name, " = ", value, ": must be in [", low, ", ", high, "]"));
  }
}

}  // namespace acmp
