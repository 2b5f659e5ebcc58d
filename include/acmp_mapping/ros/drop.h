#pragma once

#include <string>

namespace acmp {

/// Something that was received and not used. `reason` is a short fixed key for counting, `message` a sentence with the
/// values for people.
struct Drop {
  std::string reason;
  std::string message;
};

}  // namespace acmp
