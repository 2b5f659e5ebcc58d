#pragma once

#include <string>

#include "acmp_mapping/evaluation/synthetic_scene.h"

namespace acmp {

/// Options of one of the synthetic scenes.
inline SyntheticSceneOptions NamedScene(const std::string& name, int width, int height, int keyframes) {
  SyntheticSceneOptions options;
  options.width = width;
  options.height = height;
  options.keyframes = keyframes;
  SelectSyntheticScene(name, &options);
  return options;
}

}  // namespace acmp
