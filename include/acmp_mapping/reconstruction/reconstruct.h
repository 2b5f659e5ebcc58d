#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "acmp_mapping/reconstruction/stop_request.h"

namespace acmp {

/// A GPU or the CPU with the engines that work on it side by side and share handles. The CPU has one engine, which uses
/// all cores itself.
struct ReconstructDevice {
  std::vector<std::unique_ptr<DepthEngine>> engines;  ///< at least one
  bool on_host = false;                               ///< the CPU; then there is no other device
};

/// Makes the devices, at least one. The online schedule uses the first engine of the first one.
using DeviceMaker = std::function<std::vector<ReconstructDevice>()>;

/// One run of the tool: reads the scene, makes the output folder or goes on with an interrupted run in it (the online
/// schedule starts anew), writes all results. Messages go to `out` (results) and `log` (progress, warnings). Throws
/// InvalidInputError, ProcessingError or Interrupted.
/// @param make_devices is called once, in another thread: a GPU takes as long to start as images to be decoded
/// @param log_is_terminal draws a progress bar instead of plain lines
void Reconstruct(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                 std::ostream* out, std::ostream* log, bool log_is_terminal);

}  // namespace acmp
