#pragma once

#include <cstddef>
#include <vector>

#include "acmp_mapping/geometry/similarity.h"
#include "view.h"

namespace acmp {

/// FitSimilarity of the first `count` poses.
Similarity FitSimilarity(const std::vector<ViewPose>& from, const std::vector<ViewPose>& to, size_t count);

std::vector<ViewPose> Moved(const Similarity& similarity, std::vector<ViewPose> poses);

}  // namespace acmp
