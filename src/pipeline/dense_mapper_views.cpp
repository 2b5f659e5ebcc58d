#include "dense_mapper_views.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"

namespace acmp {

Image<uint32_t> RemapSelectedViews(const Image<uint32_t>& masks, const std::vector<int64_t>& old_ids,
                                   const std::vector<int64_t>& new_ids) {
  if (old_ids == new_ids) return masks.Clone();
  std::vector<uint32_t> new_bit_of_old(old_ids.size(), 0);
  for (size_t j = 0; j < old_ids.size(); ++j) {
    const auto found = std::find(new_ids.begin(), new_ids.end(), old_ids[j]);
    if (found != new_ids.end()) new_bit_of_old[j] = 1u << (found - new_ids.begin());
  }
  Image<uint32_t> remapped(masks.width(), masks.height());
  std::transform(masks.begin(), masks.end(), remapped.begin(), [&](uint32_t mask) {
    uint32_t result = 0;
    for (size_t j = 0; j < new_bit_of_old.size(); ++j) result |= (mask >> j & 1u) != 0 ? new_bit_of_old[j] : 0u;
    return result;
  });
  return remapped;
}

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
