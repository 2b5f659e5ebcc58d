#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {

constexpr int kMaxRankedViews = 32;  ///< what the matcher takes (kMaxSourceViews)

constexpr double kMinSourceAngleDeg = 1.0;  ///< triangulation angle below which a view is useless
constexpr double kMinSourceOverlap =
    0.1;  ///< share of the reference's landmarks a source must see, at that angle or more

struct SourceViewOptions {
  int max_source_views = 10;  ///< 1..32
};
void Validate(const SourceViewOptions& options);
inline bool operator==(const SourceViewOptions& a, const SourceViewOptions& b) {
  return a.max_source_views == b.max_source_views;
}

/// A frame with those of its landmarks that it sees: found once, since many frontends name their whole map with every
/// keyframe.
class FrameLandmarks {
 public:
  /// Throws InvalidInputError for a null frame.
  explicit FrameLandmarks(FramePtr frame);

  const Frame& frame() const { return *frame_; }
  size_t num_in_view() const { return listed_.size(); }
  /// Of those in view, evenly spread over the list: shares and medians of 2000 points are good to some 2 %.
  const LandmarksInView& sample() const { return sample_; }
  /// Whether the frame's list has this very point (the same bits) and the frame sees it. Told by hashes of 64 bits: of
  /// a hundred thousand points each, one in 1e9 pairs of frames shares one by chance.
  bool Lists(const Eigen::Vector3d& point_in_world) const;

 private:
  FramePtr frame_;
  LandmarksInView sample_;
  std::vector<uint64_t> listed_;  ///< hashes, sorted
};
using FrameLandmarksPtr = std::shared_ptr<const FrameLandmarks>;

struct RankedSourceView {
  size_t index = 0;      ///< position in `candidates`
  double score = 0;      ///< > 0, larger is better
  double angle_deg = 0;  ///< median triangulation angle; 0 when nothing tells how far the scene is
};

/// Why candidates are useful or not, for messages. The counts add up to the number of candidates.
struct SourceViewCounts {
  int useful = 0;
  int no_baseline = 0;
  int little_overlap = 0;
  int small_angle = 0;
  double largest_angle_deg = 0;  ///< largest median triangulation angle among those with overlap
};

/// Ranks source views of one reference. What it has found of a candidate it keeps for as long as the candidate lives.
class SourceViewSelector {
 public:
  /// `fallback_depth` (z, scene units) stands in for the scene where the reference has no landmarks in view; <= 0 when
  /// unknown: then views that look the same way are ranked nearest first, since nothing tells the scale. Throws
  /// InvalidInputError for bad options or a null reference.
  SourceViewSelector(const FrameLandmarksPtr& reference, double fallback_depth, const SourceViewOptions& options);
  ~SourceViewSelector();
  SourceViewSelector(SourceViewSelector&& other) noexcept;
  SourceViewSelector& operator=(SourceViewSelector&& other) noexcept;

  /// Views of `candidates` that are useful to match the reference against, best first, at most max_source_views. A
  /// candidate without baseline or overlap is left out, so the result may be empty. Throws InvalidInputError for a null
  /// candidate.
  std::vector<RankedSourceView> Select(const std::vector<FrameLandmarksPtr>& candidates);

  SourceViewCounts Count(const std::vector<FrameLandmarksPtr>& candidates);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace acmp
