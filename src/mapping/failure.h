#pragma once

#include <exception>
#include <new>
#include <optional>
#include <string>

#include "acmp_mapping/common/error.h"

namespace acmp {

/// What an exception said, as a KeyframeDrop tells it.
struct Failure {
  std::string reason;
  std::string message;
};

/// Runs `work`; what it throws becomes a value, so that one keyframe's failure does not reach the others.
template <class Work>
std::optional<Failure> CatchFailure(const Work& work) {
  try {
    work();
    return std::nullopt;
  } catch (const InvalidInputError& error) {
    return Failure{"invalid_input", error.what()};
  } catch (const std::bad_alloc&) {
    return Failure{"processing_error", "out of memory"};
  } catch (const std::exception& error) {
    return Failure{"processing_error", error.what()};
  }
}

}  // namespace acmp
