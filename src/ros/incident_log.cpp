#include "acmp_mapping/ros/incident_log.h"

#include <chrono>

namespace acmp {

double SteadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string Printable(const std::string& text) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string printable;
  for (size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    // In UTF-8 those of 0x80 to 0x9f have 0xc2 before them.
    const bool after_c2 = i > 0 && static_cast<unsigned char>(text[i - 1]) == 0xc2 && c < 0xa0;
    if (c >= ' ' && c != 127 && !after_c2) {
      printable += text[i];
    } else {
      printable += {'\\', 'x', kDigits[c / 16], kDigits[c % 16]};
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
