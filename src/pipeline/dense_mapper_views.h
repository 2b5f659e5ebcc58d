#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/keyframe/source_view_selector.h"

namespace acmp {

/// Selected-view masks after the list of source views changed: bit j of the result stands for new_ids[j] and is set
/// where the old mask had that keyframe's bit; keyframes that are new start unselected.
Image<uint32_t> RemapSelectedViews(const Image<uint32_t>& masks, const std::vector<int64_t>& old_ids,
                                   const std::vector<int64_t>& new_ids);

/// Sentence that says why so few of a keyframe's `candidates` are useful, with the numbers.
std::string DescribeMissingViews(const SourceViewCounts& counts, int min_source_views,
                                 const SourceViewOptions& options);

}  // namespace acmp
