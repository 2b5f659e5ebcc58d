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

  /// Those of `keyframes` that are to be refined side by side, each with its best source views now: if any have better
  /// views or poses that have moved, all whose views have not become worse, for they read each other.
  static std::vector<std::pair<WindowKeyframePtr, SourceViews>> ChooseForSideBySide(
      const KeyframeWindow& window, const std::vector<WindowKeyframePtr>& keyframes);

  /// Whether its initial estimate must be made anew for that: there is none, its views were worse, or poses have moved.
  static bool NeedsNewInitial(const WindowKeyframe& keyframe, const SourceViews& sources);

  /// Whether too few later keyframes have come to see what the keyframe saw last. Refined without them it errs there as
  /// its neighbours do, from which it took that; passes that read it would hand the error on from keyframe to keyframe,
  /// where initial estimates err each in its own way.
  static bool LacksFutureViews(const KeyframeWindow& window, const WindowKeyframe& keyframe);
};

}  // namespace acmp
