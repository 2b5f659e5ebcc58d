#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
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

/// The devices that the options name: `jobs_per_gpu` engines on each GPU; where the CPU has to do, one, which uses all
/// cores itself. Throws InvalidInputError for an unknown device, and for one that is asked for and cannot be used.
/// @param log is told why "auto" settled for the CPU, unless the options are `quiet`; not null
std::vector<ReconstructDevice> MakeDevices(const ReconstructOptions& options, std::ostream* log);

/// One run of the tool: reads the scene, makes the output folder or goes on with an interrupted run in it (the online
/// schedule starts anew), writes all results. Messages go to `out` (results) and `log` (progress, warnings). Throws
/// InvalidInputError, ProcessingError or Interrupted.
/// @param make_devices is called once, in another thread: a GPU takes as long to start as images to be decoded
/// @param log_is_terminal draws a progress bar instead of plain lines
void Reconstruct(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                 std::ostream* out, std::ostream* log, bool log_is_terminal);

/// The next line without its end; nothing after the last one. May throw Interrupted.
using LineReader = std::function<std::optional<std::string>()>;

/// Does stages of a plan, one after the other, as Reconstruct with options.stage does each. What they have in common is
/// kept at hand: devices, the plan, images.
/// @param next names them: "STAGE IMAGES", or "finish"
/// @param out is told of each, in one line: "LINE: done" or "LINE: exit code N: message", with the program's exit codes
/// @return whether all were done. Throws InvalidInputError for options and Interrupted; a stage that fails ends nothing
bool ReconstructStages(const ReconstructOptions& options, const DeviceMaker& make_devices, StopRequest* interrupt,
                       const LineReader& next, std::ostream* out, std::ostream* log, bool log_is_terminal);

}  // namespace acmp
