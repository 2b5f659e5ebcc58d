#include "acmp_mapping/ros/incident_log.h"

namespace acmp {

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
