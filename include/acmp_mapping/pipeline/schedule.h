#pragma once

#include <vector>

#include "acmp_mapping/pipeline/presets.h"

namespace acmp {

/// One step of a keyframe's estimate. Whatever it reads of the source views' estimates is of the step before, as far as
/// those have come: all of them offline (Jacobi), what the window has online.
struct KeyframeStep {
  enum class Kind {
    kInitial,    ///< steps 1-20 of Algorithm 1: photometric pass, planar prior, planar-prior pass. Reads no estimates
    kNextScale,  ///< ACMM: photometric pass on images half as much reduced, which takes over what the step before
                 ///< knows better (detail restorer)
    kFillForPasses,   ///< planes from around for pixels that no source view confirms, for the passes to choose from
    kGeometricPass,   ///< steps 21-30 of Algorithm 1, once
    kFillUnverified,  ///< planes from around for what is unconfirmed after the passes, and the free-space check
  };
  Kind kind = Kind::kInitial;
  int pass = 0;   ///< of kGeometricPass: 0, 1, ... at its level
  int level = 0;  ///< how often the images of the estimate are halved
};

/// All steps of a keyframe in their order; the first one is kInitial. The offline tool, the online mapper and the
/// benchmark follow this list and nothing else decides what a keyframe goes through.
std::vector<KeyframeStep> ScheduleOf(const PipelineOptions& options);

}  // namespace acmp
