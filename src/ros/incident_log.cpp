#include "acmp_mapping/ros/incident_log.h"

#include <chrono>

#include <boost/locale/utf.hpp>

namespace acmp {

double SteadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string Printable(const std::string& text) {
  using Utf8 = boost::locale::utf::utf_traits<char>;
  constexpr char kDigits[] = "0123456789abcdef";
  std::string printable;
  for (auto at = text.begin(); at != text.end();) {
    auto next = at;
    const boost::locale::utf::code_point character = Utf8::decode(next, text.end());
    const bool is_control = character < 0x20 || (character >= 0x7f && character < 0xa0);
    if (boost::locale::utf::is_valid_codepoint(character) && !is_control) {
      printable.append(at, next);
      at = next;
    } else {
      const auto c = static_cast<unsigned char>(*at++);
      printable += {'\\', 'x', kDigits[c / 16], kDigits[c % 16]};
    }
  }
  return printable;
}

bool IncidentLog::Record(const RejectedInput& rejected, double now_s) {
  std::lock_guard<std::mutex> lock(mutex_);
  images_ += rejected.ends_image ? 1 : 0;
  Entry& entry = entries_[rejected.reason];
  const bool tell = entry.count == 0 || now_s - entry.last_told_s >= kRepeatS;
  ++entry.count;
  entry.images += rejected.ends_image ? 1 : 0;
  entry.last_message = rejected.message;
  entry.last_time_s = now_s;
  if (tell) entry.last_told_s = now_s;
  return tell;
}

uint64_t IncidentLog::images() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return images_;
}

std::map<std::string, IncidentLog::Entry> IncidentLog::entries() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return entries_;
}

}  // namespace acmp
