#pragma once

#include <string>

#include "run.h"

namespace acmp {

/// summary.json: version, settings, images with and without a map, points, times of this run.
std::string FormatSummary(const ReconstructRun& run, const RunRecord& record, const std::string& device, size_t points);

/// Table of milliseconds per stage, in all and per image.
std::string FormatTimings(const RunTimes& times);

}  // namespace acmp
