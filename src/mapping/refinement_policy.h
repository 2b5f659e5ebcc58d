#pragma once

#include <utility>
#include <vector>

#include "keyframe_window.h"

namespace acmp {

/// When a finished keyframe of the window is refined again, and what others read of one that was refined early. Each
/// rule was measured alone on recorded videos (docs/experiments.md).
class RefinementPolicy {
 public:
  enum class Again {
    kNo,
    kFromInitial,  ///< its source views have become better, or poses have moved: from an initial estimate
    kFromRefined,  ///< its source views' maps have become better: from its own refined one
  };

  /// Whether, and from where, the keyframe is to be refined again with these source views, which are its best now.
  static Again Decide(const WindowKeyframe& keyframe, const SourceViews& sources);

  /// The keyframes to refine together at a flush, each with its best source views now. None unless the views of one
  /// have become better or its poses have moved; then all but those whose views have become worse, as they read each
  /// other.
  static std::vector<std::pair<WindowKeyframePtr, SourceViews>> ChooseForSideBySide(
      const KeyframeWindow& window, const std::vector<WindowKeyframePtr>& keyframes);

  /// Whether its initial estimate must be made anew for that: there is none, its views were worse, or poses have moved.
  static bool NeedsNewInitial(const WindowKeyframe& keyframe, const SourceViews& sources);

  /// Whether too few later keyframes have come that see what came into view last. Refined without them, a keyframe
  /// takes over its neighbours' errors there, and passes that read it would hand these on. Initial estimates have
  /// errors of their own, which differ.
  static bool LacksFutureViews(const KeyframeWindow& window, const WindowKeyframe& keyframe);
};

}  // namespace acmp
