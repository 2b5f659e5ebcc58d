#pragma once

#include <vector>

#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

constexpr int kMaxRankedViews = 32;  ///< what the matcher takes (kMaxSourceViews)

struct SourceViewOptions {
  int max_source_views = 7;          ///< 1..32
  double min_angle_deg = 1.0;        ///< median triangulation angle below which a view is useless
  double best_angle_min_deg = 5.0;   ///< full score from here ...
  double best_angle_max_deg = 10.0;  ///< ... to here, falling off on both sides; 20 gives up to 1 % fewer right depths
  double min_overlap = 0.1;          ///< share of the reference's landmarks a source must see
  int min_shared_landmarks = 10;     ///< below: ranked by baseline over depth and frustum overlap instead
};
void Validate(const SourceViewOptions& options);

struct RankedSourceView {
  size_t index = 0;      ///< position in `candidates`
  double score = 0;      ///< > 0, larger is better
  double angle_deg = 0;  ///< median triangulation angle; 0 when nothing tells how far the scene is
};

/// Views of `candidates` that are useful to match `reference` against, best first, at most max_source_views. A
/// candidate without baseline or overlap is left out, so the result may be empty. `fallback_depth` (z, scene units)
/// stands in for the scene where the reference has no landmarks in view; <= 0 when unknown: then views that look the
/// same way are ranked nearest first, since nothing tells the scale. Throws InvalidInputError for bad options or a null
/// candidate.
std::vector<RankedSourceView> SelectSourceViews(const Frame& reference, const std::vector<FramePtr>& candidates,
                                                double fallback_depth, const SourceViewOptions& options);

/// Why candidates are useful or not, for messages. The counts add up to the number of candidates.
struct SourceViewCounts {
  int useful = 0;
  int no_baseline = 0;
  int little_overlap = 0;
  int small_angle = 0;
  double largest_angle_deg = 0;  ///< largest median triangulation angle among those with overlap
};
SourceViewCounts CountSourceViews(const Frame& reference, const std::vector<FramePtr>& candidates,
                                  double fallback_depth, const SourceViewOptions& options);

}  // namespace acmp
