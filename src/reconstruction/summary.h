#pragma once

#include <filesystem>
#include <string>

#include "run.h"

namespace acmp {

/// summary.json: version, settings, images with and without a map, points, tiles, times of this run.
/// @param failure why it counts as failed; empty: it does not
std::string FormatSummary(const ReconstructRun& run, const RunRecord& record, const std::string& device,
                          const CloudSize& cloud, const std::string& failure);

/// The failure in such a file; empty: none, or it cannot be read.
std::string FailureOfSummary(const std::filesystem::path& path);

/// Table of milliseconds per stage, in all and per image.
std::string FormatTimings(const RunTimes& times);

}  // namespace acmp
