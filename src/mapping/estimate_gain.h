#pragma once

#include <vector>

#include "keyframe_window.h"

namespace acmp {

/// Whether poses have been refined so much since maps of the keyframe were made that these no longer fit: a point at
/// its typical depth then has moved in the views that they were matched with, on average, by more than a pixel. Maps of
/// poses that stay as they are never have.
bool HaveMoved(const WindowKeyframe& keyframe, const std::vector<MatchedView>& views);

/// Whether refined maps of the keyframe would gain by these source views, its best now: they bring more than those that
/// it was refined with, or poses have moved.
bool WouldGain(const WindowKeyframe& keyframe, const SourceViews& sources);

/// Whether a refinement with these source views must begin with another initial estimate: there is none, poses have
/// moved, or the keyframe is refined again and the views bring more.
bool NeedsNewInitial(const WindowKeyframe& keyframe, const SourceViews& sources);

}  // namespace acmp
