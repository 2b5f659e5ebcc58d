#include "dense_mapper_views.h"

#include "acmp_mapping/common/error.h"

namespace acmp {

std::string DescribeMissingViews(const SourceViewCounts& counts, int min_source_views,
                                 const SourceViewOptions& options) {
  const int others = counts.useful + counts.no_baseline + counts.little_overlap + counts.small_angle;
  if (others == 0) return Concat("no other keyframe in the window, at least ", min_source_views, " needed");
  std::string text = Concat(counts.useful, " of ", others, " other keyframes in the window useful, at least ",
                            min_source_views, " needed");
  if (counts.no_baseline > 0) text += Concat("; ", counts.no_baseline, " with no baseline (identical position)");
  if (counts.little_overlap > 0) {
    text += Concat("; ", counts.little_overlap, " see less than ", 100 * options.min_overlap, " % of its scene");
  }
  if (counts.small_angle > 0) {
    text += Concat("; ", counts.small_angle, " below the least triangulation angle of ", options.min_angle_deg,
                   " degrees (largest found: ", counts.largest_angle_deg, ")");
  }
  return text;
}

}  // namespace acmp
