#pragma once

#include <filesystem>
#include <ostream>
#include <string>

#include "acmp_mapping/common/timer.h"
#include "run.h"

namespace acmp {

constexpr const char* kInputKey = "input (hash of images, masks, prior depth, cameras, poses, landmarks)";
constexpr const char* kDeviceKey = "device";

/// The options that decide the bits of the results, and which files there are.
RunRecord SettingsRecord(const ReconstructOptions& options);

/// Everything that does: the same with the input and the device.
/// @param device its name; empty: not known yet
RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash);

/// "NVIDIA H200 (cuda:0)" -> "NVIDIA H200": what decides the bits.
std::string DeviceModel(const std::string& device_name);

/// Says of a run that is there already that it is complete. Throws ProcessingError where it counts as failed.
void ReportComplete(const OutputFolder& folder, const std::string& text, bool quiet, std::ostream* out);

/// What the number of points says of a run. Empty: nothing.
struct PointsJudgement {
  std::string warning;  ///< hardly any pixel became a point, or too few images have maps for any
  std::string failure;  ///< none did, though enough images have maps: the run counts as failed
};
PointsJudgement JudgePoints(const ReconstructRun& run, size_t points);

/// A warning for each image that gets no map, with the reason.
void ReportImagesWithoutMap(const ReconstructPlan& plan, const Scene& scene, Progress* progress);

/// A warning that says of how many images the prior depth is not used, and why of one.
void ReportUnusedPriorDepth(const ReconstructRun& run);

/// The list of files and the summary, which make the run complete.
/// @param device name of what computed it
/// @param timer of the whole run
/// @return why the run counts as failed though all is written; empty: it does not
std::string EndRun(ReconstructRun* run, const RunRecord& record, const std::string& device, const Timer& timer,
                   const CloudSize& cloud, std::ostream* out);

}  // namespace acmp
