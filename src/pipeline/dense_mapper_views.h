#pragma once

#include <string>

#include "acmp_mapping/keyframe/source_view_selector.h"

namespace acmp {

/// Sentence that says why so few of a keyframe's `candidates` are useful, with the numbers.
std::string DescribeMissingViews(const SourceViewCounts& counts, int min_source_views,
                                 const SourceViewOptions& options);

}  // namespace acmp
