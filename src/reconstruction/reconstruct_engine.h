#pragma once

#include "acmp_mapping/pipeline/depth_engine.h"

namespace acmp {

/// One of the engines that work side by side.
struct ReconstructEngine {
  DepthEngine* engine;
  int device;    ///< those with the same number share handles
  bool on_host;  ///< the CPU's: there is only one then, which uses all cores itself
};

}  // namespace acmp
