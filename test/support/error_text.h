#pragma once

#include <string>

#include "acmp_mapping/common/error.h"

namespace acmp {

/// Message of the InvalidInputError that a call throws; "no error" when it throws none.
template <class Function>
std::string ErrorOf(Function&& function) {
  try {
    function();
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "no error";
}

}  // namespace acmp
