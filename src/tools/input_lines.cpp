#include "input_lines.h"

#include <poll.h>
#include <unistd.h>

#include <array>
#include <utility>

namespace acmp {

std::optional<std::string> InputLines::Next() {
  constexpr int kCheckMs = 200;
  for (;;) {
    if (const size_t end = read_.find('\n'); end != std::string::npos) {
      std::string line = read_.substr(0, end);
      read_.erase(0, end + 1);
      return line;
    }
    if (ended_) {
      if (read_.empty()) return std::nullopt;
      return std::exchange(read_, {});
    }
    interrupt_.Check();
    pollfd input = {STDIN_FILENO, POLLIN, 0};
    if (poll(&input, 1, kCheckMs) <= 0) continue;
    std::array<char, 4096> block;
    const ssize_t bytes = read(STDIN_FILENO, block.data(), block.size());
    if (bytes > 0) read_.append(block.data(), static_cast<size_t>(bytes));
    ended_ = bytes <= 0;
  }
}

}  // namespace acmp
