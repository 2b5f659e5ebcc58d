#pragma once

#include <string>

namespace acmp {

/// Something that was received and not used. `reason` is a short fixed key for counting, `message` a sentence with the
/// values for people.
struct RejectedInput {
  std::string reason;
  std::string message;
  bool ends_image = false;  ///< an image that was received, and gets no refined map
};

}  // namespace acmp
