#pragma once

#include <string>

#include "acmp_mapping/evaluation/evaluate_cloud.h"
#include "acmp_mapping/evaluation/evaluate_depth.h"

namespace acmp {

/// One line per image (unless `quiet`), then mean, pool and regions.
std::string DepthTable(const DepthEvaluation& evaluation, bool quiet);

/// Everything of the table; null where a figure is undefined.
std::string DepthJson(const DepthEvaluation& evaluation);

/// A line on the two clouds, then one line per threshold.
std::string CloudTable(const CloudEvaluation& evaluation);

/// Everything of the table; "true_maps" is 0 where the ground truth was a cloud.
std::string CloudJson(const CloudEvaluation& evaluation);

}  // namespace acmp
