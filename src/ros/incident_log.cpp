#include "acmp_mapping/ros/incident_log.h"

#include <chrono>
#include <string_view>

namespace acmp {
namespace {

/// Bytes of the character with which a text begins; 0 where that is none of UTF-8 (RFC 3629, section 4).
size_t CharacterBytes(std::string_view text) {
  const auto byte = [&](size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u; };
  const unsigned first = byte(0), second = byte(1);
  if (first < 0x80) return 1;
  if (first < 0xc2 || first > 0xf4) return 0;
  const size_t bytes = first < 0xe0 ? 2 : first < 0xf0 ? 3 : 4;
  for (size_t i = 1; i < bytes; ++i) {
    if (byte(i) / 0x40 != 2) return 0;
  }
  const bool is_too_long = (first == 0xe0 && second < 0xa0) || (first == 0xf0 && second < 0x90);
  const bool is_no_character = (first == 0xed && second >= 0xa0) || (first == 0xf4 && second >= 0x90);
  return is_too_long || is_no_character ? 0 : bytes;
}

bool BeginsWithControl(std::string_view text) {
  const auto first = static_cast<unsigned char>(text[0]);
  return first < ' ' || first == 127 || (first == 0xc2 && static_cast<unsigned char>(text[1]) < 0xa0);
}

}  // namespace

double SteadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string Printable(const std::string& text) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string printable;
  for (std::string_view left = text; !left.empty();) {
    const size_t bytes = CharacterBytes(left);
    if (bytes > 0 && !BeginsWithControl(left)) {
      printable += left.substr(0, bytes);
      left.remove_prefix(bytes);
    } else {
      const auto c = static_cast<unsigned char>(left[0]);
      printable += {'\\', 'x', kDigits[c / 16], kDigits[c % 16]};
      left.remove_prefix(1);
    }
  }
  return printable;
}

bool IncidentLog::Record(const RejectedInput& rejected, double now_s) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    images_ += rejected.ends_image ? 1 : 0;
  }
  return Record(Incident{rejected.reason, rejected.message}, now_s);
}

bool IncidentLog::Record(const Incident& incident, double now_s) {
  std::lock_guard<std::mutex> lock(mutex_);
  Entry& entry = entries_[incident.reason];
  const bool tell = entry.count == 0 || now_s - entry.last_told_s >= kRepeatS;
  ++entry.count;
  entry.last_message = incident.message;
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
