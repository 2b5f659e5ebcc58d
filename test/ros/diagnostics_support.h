#pragma once

#include <string>

#include <diagnostic_updater/DiagnosticStatusWrapper.h>

namespace acmp {

template <class Snapshot>
diagnostic_updater::DiagnosticStatusWrapper Describe(void (*describer)(const Snapshot&,
                                                                       diagnostic_updater::DiagnosticStatusWrapper*),
                                                     const Snapshot& snapshot) {
  diagnostic_updater::DiagnosticStatusWrapper status;
  describer(snapshot, &status);
  return status;
}

inline std::string ValueOf(const diagnostic_updater::DiagnosticStatusWrapper& status, const std::string& key) {
  for (const auto& value : status.values) {
    if (value.key == key) return value.value;
  }
  return "(no such key)";
}

}  // namespace acmp
