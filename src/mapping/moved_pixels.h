#pragma once

#include <vector>

#include "acmp_mapping/engine/depth_engine.h"

namespace acmp {

/// A view of the reference's own capture, with the depth that was matched for it.
struct InstantView {
  EngineView view;
  DepthMap depth;  ///< of its size; 0: unknown
};

/// What moves matches other captures where it is not: a thing that goes along with the camera looks farther away in all
/// of them alike. Its own capture shows it where it is. Pixels are taken for moved where a view of their own capture
/// confirms the depth that was matched with such views alone (forward-backward error below 1 px) and contradicts the
/// other one (above 2 px). Most around must be so: things are larger than what matching smears along outlines.
/// @param reference without estimate
/// @param matched depth by all source views; 0: unknown
/// @param instant the same by the views of its own capture
/// @return of the reference's size: 1 where `instant` is to be taken
Image<unsigned char> FindMovedPixels(const EngineView& reference, const std::vector<InstantView>& views,
                                     const DepthMap& matched, const DepthMap& instant);

}  // namespace acmp
