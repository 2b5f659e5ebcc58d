#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/source_view_selection.h"
#include "window_keyframe.h"

namespace acmp {

/// Source views of one keyframe, best first.
struct SourceViews {
  std::vector<WindowKeyframePtr> keyframes;
  double score = 0;  ///< what they bring together: the selection's gain

  std::vector<int64_t> Ids() const;
};

/// The keyframes that can be matched against each other, and which source views each of them has. Computes no depth.
class KeyframeWindow {
 public:
  using const_iterator = std::deque<WindowKeyframePtr>::const_iterator;

  explicit KeyframeWindow(const SourceViewOptions& options) : options_(options) {}

  /// Scores under other options cannot be compared: what is in the window counts as what was used so far.
  void set_options(const SourceViewOptions& options);

  /// Adds a keyframe as the newest.
  WindowKeyframePtr Add(FramePtr frame);
  void PopOldest() { keyframes_.pop_front(); }
  void Clear() { keyframes_.clear(); }

  /// Chosen among the others in the window (SelectSourceViews), at most max_source_views. Those that are mapped go
  /// first, for they can confirm depth. The keyframe has a depth range.
  SourceViews SelectSources(const WindowKeyframe& keyframe) const;

  /// Sentence that says why the keyframe has fewer than `min_source_views`, with the numbers.
  std::string DescribeMissingViews(const WindowKeyframe& keyframe, int min_source_views) const;

  size_t size() const { return keyframes_.size(); }
  bool empty() const { return keyframes_.empty(); }
  const WindowKeyframePtr& oldest() const { return keyframes_.front(); }
  /// The keyframe that has so many later ones in the window, fewer than size().
  const WindowKeyframePtr& WithLater(size_t later_keyframes) const {
    return keyframes_[keyframes_.size() - 1 - later_keyframes];
  }
  /// Null where it is not in the window.
  WindowKeyframePtr Find(int64_t id) const;
  size_t NumLaterThan(const WindowKeyframe& keyframe) const;
  const_iterator begin() const { return keyframes_.begin(); }  ///< oldest first
  const_iterator end() const { return keyframes_.end(); }

 private:
  std::vector<WindowKeyframePtr> Others(const WindowKeyframe& keyframe) const;

  SourceViewOptions options_;
  std::deque<WindowKeyframePtr> keyframes_;
};

}  // namespace acmp
