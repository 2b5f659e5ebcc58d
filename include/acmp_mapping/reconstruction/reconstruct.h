#pragma once

#include <functional>
#include <ostream>
#include <vector>

#include "reconstruct_engine.h"
#include "reconstruct_interrupt.h"
#include "reconstruct_options.h"

namespace acmp {

/// Makes the engines, at least one, of which the online schedule uses the first only. They outlive the run.
using EngineMaker = std::function<std::vector<ReconstructEngine>()>;

/// One run of the tool: reads the scene, makes or continues the output folder, writes all results. Messages go to `out`
/// (results) and `log` (progress, warnings). Throws InvalidInputError, ProcessingError or Interrupted.
/// @param make_engines is called once, in another thread: a GPU takes as long to start as images to be decoded
/// @param log_is_terminal draws a progress bar instead of plain lines
void Reconstruct(const ReconstructOptions& options, const EngineMaker& make_engines, InterruptWatcher* interrupt,
                 std::ostream* out, std::ostream* log, bool log_is_terminal);

}  // namespace acmp
