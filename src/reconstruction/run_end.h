#pragma once

#include <ostream>
#include <string>

#include "acmp_mapping/common/timer.h"
#include "run.h"

namespace acmp {

/// What the number of points says of a run. Empty: nothing.
struct PointsJudgement {
  std::string warning;  ///< hardly any pixel became a point, or too few images have maps for any
  std::string failure;  ///< none did, though enough images have maps: the run counts as failed
};
PointsJudgement JudgePoints(const ScheduleRun& run, size_t points);

/// A warning that says of how many images the prior depth is not used, and why of one.
void ReportUnusedPriorDepth(const ReconstructRun& run);

/// The list of files and the summary, which make the run complete.
/// @param device name of what computed it
/// @param timer of the whole run
/// @return why the run counts as failed though all is written; empty: it does not
std::string EndRun(ReconstructRun* run, const RunRecord& record, const std::string& device, const Timer& timer,
                   const CloudSize& cloud, std::ostream* out);

}  // namespace acmp
