#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/keyframe/source_view_selection.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/pose_refinement/pose_fit.h"

namespace acmp {

/// A refined pose, of a capture or of one of its cameras.
struct RefinedPlace {
  uint64_t world = 0;             ///< of refined poses, see RefinedCamera
  RigidTransform cam_from_world;  ///< in it: to match with
  RigidTransform placed;          ///< where that puts the maps in the frontend's world
  double scale = 1;               ///< to the frontend's world, of lengths

  /// That of a camera, or of a capture, which lies to this one so. @param motion in the unit of the received poses
  RefinedPlace Moved(RigidTransform motion) const;
};

/// Of a capture that may have left the window.
struct ReceivedPose {
  int64_t id = 0;  ///< of its first image
  RigidTransform capture_from_world = RigidTransform::Identity();
};

/// Where a capture is.
struct CapturePose : ReceivedPose {
  std::optional<RefinedPlace> refined;  ///< none: it is matched as received
  PoseFit fit;                          ///< of the pose in use
  /// The earlier one from whose pose its own follows by the received motion, since the camera stands or there was no
  /// time to refine it; none: it is refined, or is about to be.
  std::optional<ReceivedPose> follows;
};

struct WindowKeyframe;

/// How a source view lay to the keyframe whose maps were matched with it.
struct MatchedView {
  std::weak_ptr<const WindowKeyframe> source;
  RigidTransform source_from_reference = RigidTransform::Identity();
};

/// One image of the window: a keyframe, or one that is only a source view. A finished one stays as a source view of
/// others until it leaves.
struct WindowKeyframe {
  enum class State {
    kPending,      ///< waits for source views
    kInitialised,  ///< has its initial estimate, waits for later keyframes
    kFinished,     ///< was refined or dropped
  };
  FramePtr frame;
  std::shared_ptr<const CapturePose> capture;                       ///< all images of a capture have one pose ...
  RigidTransform camera_from_capture = RigidTransform::Identity();  ///< ... and a constant place in it, their unit
  DepthRange range;
  State state = State::kPending;
  bool is_mapped = true;  ///< false: it is a source view of others alone
  /// Its refined maps must not be used, since received poses contradict the images, or new ones were not made.
  std::atomic<bool> is_withdrawn{false};
  bool had_turn = false;  ///< live: to be refined again

  EngineImagePtr image;       ///< null until the keyframe is first used as reference or source view
  int image_levels = 0;       ///< levels it was loaded with
  EngineEstimatePtr initial;  ///< after step 0 of the schedule; null: none, or no longer needed
  EngineEstimatePtr refined;  ///< after all steps; null: none
  EngineEstimatePtr shared;   ///< while it is refined together with others: after the last step; else null
  StageTimes times;           ///< of initial estimates since the last refinement

  /// Refined before kEnoughLaterKeyframes had come. Then passes of other keyframes go on reading `initial`, and
  /// `refined` holds the estimate of the last pass, without the filling after it.
  bool lacks_future_views = false;

  std::vector<MatchedView> initial_views;  ///< of `initial`
  std::vector<MatchedView> refined_views;  ///< of `refined`

  // Gains of all source views (SelectSourceViews).
  double initial_score = 0;             ///< of the views of its initial estimate
  std::optional<double> refined_score;  ///< of the views of its refined maps; none: there are none

  // Of the outputs alone.
  bool had_fast = false;     ///< its on_fast was called
  bool had_refined = false;  ///< its on_refined was called

  std::optional<RefinedPlace> refined_place() const;
  /// To match with.
  RigidTransform cam_from_world() const;

  /// What geometric passes of other keyframes read; may be null.
  const EngineEstimatePtr& EstimateForPasses() const {
    if (shared) return shared;
    return refined && !lacks_future_views ? refined : initial;
  }
  /// What is read after these: to fill what is unverified, and for the consistency check; may be null.
  const EngineEstimatePtr& EstimateAfterPasses() const {
    if (shared) return shared;
    return refined ? refined : initial;
  }
};
using WindowKeyframePtr = std::shared_ptr<WindowKeyframe>;

struct WindowCapture {
  explicit WindowCapture(const Capture& capture);
  /// Of the first image, whose pose the capture has, where it is among these: it alone tells the refined pose.
  const WindowKeyframe* first() const { return images.front()->frame->id == pose->id ? images.front().get() : nullptr; }

  std::shared_ptr<CapturePose> pose;
  std::vector<WindowKeyframePtr> images;  ///< that can be used, keyframes first; at least one
};

/// Source views of one keyframe, best first.
struct SourceViews {
  std::vector<WindowKeyframePtr> keyframes;
  std::vector<WindowKeyframePtr> of_capture;  ///< the useful ones of its own capture, whether among `keyframes` or not
  double score = 0;                           ///< what `keyframes` bring together: the selection's gain

  std::vector<int64_t> Ids() const;
};

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

/// The captures whose images can be matched against each other, and which source views each of them has. Computes no
/// depth.
class KeyframeWindow {
 public:
  using const_iterator = std::deque<WindowCapture>::const_iterator;

  explicit KeyframeWindow(int max_source_views) : max_source_views_(max_source_views) {}

  /// Scores of other numbers cannot be compared: what is in the window counts as what was used so far.
  void set_max_source_views(int max_source_views);

  /// Adds a capture as the newest.
  void Add(WindowCapture capture) { captures_.push_back(std::move(capture)); }
  void PopOldest() { captures_.pop_front(); }

  /// Chosen among the others in the window (SelectSourceViews), at most max_source_views: first among those that are
  /// mapped, for they can confirm depth, and those of its own capture. Companions of other captures are no candidates:
  /// they confirm nothing, and what they see their keyframes see nearly alike. An image that is not mapped is matched
  /// against its own capture alone, to say what its keyframes can confirm. The image has a depth range.
  SourceViews SelectSources(const WindowKeyframe& keyframe) const;

  /// Sentence that says why the keyframe has fewer than `min_source_views`, with the numbers.
  std::string DescribeMissingViews(const WindowKeyframe& keyframe, int min_source_views) const;

  size_t size() const { return captures_.size(); }  ///< captures
  const WindowCapture& oldest() const { return captures_.front(); }
  /// The capture that has so many later ones in the window, fewer than size().
  const WindowCapture& WithLater(size_t later_captures) const {
    return captures_[captures_.size() - 1 - later_captures];
  }
  /// Captures after that of the keyframe.
  size_t NumLaterThan(const WindowKeyframe& keyframe) const;
  const_iterator begin() const { return captures_.begin(); }  ///< oldest first
  const_iterator end() const { return captures_.end(); }
  std::vector<WindowKeyframePtr> Images() const;  ///< of all captures, in their order

 private:
  /// Who may become a source view of a keyframe.
  struct Candidates {
    std::vector<WindowKeyframePtr> keyframes;
    std::vector<SourceViewCandidate> views;  ///< theirs
  };
  Candidates CandidatesOf(const WindowKeyframe& keyframe, bool of_all_captures) const;

  int max_source_views_;
  std::deque<WindowCapture> captures_;
};

}  // namespace acmp
