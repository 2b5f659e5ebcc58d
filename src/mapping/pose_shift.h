#pragma once

#include <vector>

#include "window_keyframe.h"

namespace acmp {

/// Whether poses have been refined so much since maps of the keyframe were made that these no longer fit: a point at
/// its typical depth then has moved in the views that they were matched with, on average, by more than a pixel. Maps of
/// poses that stay as they are never have.
bool HaveMoved(const WindowKeyframe& keyframe, const std::vector<MatchedView>& views);

}  // namespace acmp
