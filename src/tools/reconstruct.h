#pragma once

#include <ostream>
#include <vector>

#include "reconstruct_engine.h"
#include "reconstruct_interrupt.h"
#include "reconstruct_options.h"

namespace acmp {

/// One run of the tool: reads the scene, makes or continues the output folder, writes all results. Messages go to `out`
/// (results) and `log` (progress, warnings). Throws InvalidInputError, ProcessingError or Interrupted.
/// @param engines at least one; the online schedule uses the first only
/// @param log_is_terminal draws a progress bar instead of plain lines
void Reconstruct(const ReconstructOptions& options, const std::vector<ReconstructEngine>& engines,
                 InterruptWatcher* interrupt, std::ostream* out, std::ostream* log, bool log_is_terminal);

}  // namespace acmp
