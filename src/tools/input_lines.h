#pragma once

#include <optional>
#include <string>

#include "acmp_mapping/reconstruction/stop_request.h"

namespace acmp {

/// Lines of standard input as they come.
class InputLines {
 public:
  explicit InputLines(const StopRequest* interrupt) : interrupt_(*interrupt) {}

  /// The next line without its end; one at the end of the input need not have one. Nothing at the end, or when it
  /// cannot be read. Throws Interrupted while it waits.
  std::optional<std::string> Next();

 private:
  const StopRequest& interrupt_;
  std::string read_;  ///< and not handed out
  bool ended_ = false;
};

}  // namespace acmp
