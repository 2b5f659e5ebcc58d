#pragma once

#include "acmp_mapping/pipeline/depth_engine.h"

namespace acmp {

/// One of the engines that work side by side.
struct ReconstructEngine {
  DepthEngine* engine;
  int device;  ///< those with the same number share handles
};

}  // namespace acmp
