#pragma once

#include <ostream>

#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "acmp_mapping/reconstruction/stop_request.h"
#include "frame_store.h"
#include "output_folder.h"
#include "progress.h"

namespace acmp {

/// Writes the mesh of a finished run to options.mesh: of the maps in its folder, at the poses of its cameras.txt. A
/// line of what it is goes to `out` unless options.quiet. Throws InvalidInputError, ProcessingError or Interrupted.
/// @param origin of the coordinates that it is made in
/// @param frames for colours
void WriteSceneMesh(const ReconstructOptions& options, const Eigen::Vector3d& origin, const OutputFolder& folder,
                    const StopRequest& interrupt, FrameStore* frames, Progress* progress, std::ostream* out);

}  // namespace acmp
