#pragma once

#include <vector>

#include "keyframe_estimator.h"
#include "window_keyframe.h"

namespace acmp {

/// Keyframes that are refined side by side: each reads what the others have after the step before.
class SideBySide {
 public:
  explicit SideBySide(const std::vector<KeyframeRefinement>& members) {
    for (const KeyframeRefinement& member : members) keyframes_.push_back(member.keyframe);
    Share(members);
  }
  ~SideBySide() {
    for (const WindowKeyframePtr& keyframe : keyframes_) keyframe->shared.reset();
  }
  SideBySide(const SideBySide&) = delete;
  SideBySide& operator=(const SideBySide&) = delete;

  /// Who is no longer among the members goes on sharing what was last shared.
  static void Share(const std::vector<KeyframeRefinement>& members) {
    for (const KeyframeRefinement& member : members) member.keyframe->shared = member.problem.reference.estimate;
  }

 private:
  std::vector<WindowKeyframePtr> keyframes_;
};

}  // namespace acmp
