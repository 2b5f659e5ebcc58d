#pragma once

#include <vector>

#include "acmp_mapping/geometry/posed_camera.h"
#include "acmp_mapping/keyframe/depth_range.h"

namespace acmp {

constexpr int kMaxSelectedViews = 32;  ///< what the matcher takes (kMaxSourceViews)

constexpr double kMinSourceAngleDeg = 1.0;    ///< triangulation angle below which a view is useless
constexpr double kMinSourceOverlap = 0.1;     ///< share of the reference that a source must see, at that angle or more
constexpr double kMinSharedLandmarks = 0.05;  ///< share of the reference's landmarks that a source should observe

/// A view that may become a source view.
struct SourceViewCandidate {
  PosedCamera view;
  int priority = 0;  ///< useful ones of a higher priority are taken first, others where these do not fill the list
  double shared_landmarks = 1;  ///< share of the reference's landmarks that it observes, 0..1; 1 where nobody knows
};

struct SelectedSourceView {
  size_t index = 0;  ///< position in `candidates`
  double gain = 0;   ///< what it adds to those before it: 0..1, mean over the reference's pixels, 1 for a first view
                     ///< that sees all of them at the best angles
};

/// Source views of one reference, and why the other candidates are not among them.
struct SourceViewSelection {
  std::vector<SelectedSourceView> views;  ///< most useful first
  double gain = 0;                        ///< sum of theirs

  // These add up to the number of candidates.
  int num_useful = 0;  ///< selected or not
  int num_without_baseline = 0;
  int num_without_overlap = 0;         ///< see less than kMinSourceOverlap of the reference
  int num_with_small_angle = 0;        ///< see less than that at kMinSourceAngleDeg or more
  double largest_small_angle_deg = 0;  ///< largest median triangulation angle among the latter
};

/// Middle of the range in the logarithm: a depth that is as many times the nearest as the farthest is of it.
double TypicalDepth(const DepthRange& range);

/// Chooses the views that are most useful to match the reference against, one by one. What the reference sees is taken
/// for a grid of points at the middle of the range of depths, which is known before anything is matched, or in turn at
/// several depths where the range is wide, as in streets. Each candidate has a weight at each point: in view,
/// under a good triangulation angle, at about the same resolution. The next view is the one that adds most, summed over
/// the points, where a point counts the less the more views chosen before see it with a like baseline, in direction and
/// length: a surface that a nearer one hides from views on one side is mostly seen from the other, and short baselines
/// match what long ones measure. Of candidates that hardly share landmarks with the reference none is chosen where at
/// least four others are useful.
///
/// A candidate without baseline or overlap is left out, so the result may be empty; equal candidates keep their order.
/// The reference may be among them: it has no baseline. Throws InvalidInputError for a range that CheckDepthRange
/// refuses.
/// @param range depths of the reference, scene units
/// @param max_source_views of the selection, 1..kMaxSelectedViews
SourceViewSelection SelectSourceViews(const PosedCamera& reference, const DepthRange& range,
                                      const std::vector<SourceViewCandidate>& candidates, int max_source_views);

}  // namespace acmp
