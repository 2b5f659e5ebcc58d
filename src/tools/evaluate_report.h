#pragma once

#include <string>
#include <vector>

#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "evaluate_depth.h"

namespace acmp {

/// One line per image (unless `quiet`), then mean, pool and regions.
std::string DepthTable(const DepthEvaluation& evaluation, bool quiet);

/// index,image,gt_pixels and the eight figures, one line per image.
std::string DepthCsv(const DepthEvaluation& evaluation);

/// Everything of the table; null where a figure is undefined.
std::string DepthJson(const DepthEvaluation& evaluation);

std::string CloudTable(const std::vector<CloudMetrics>& metrics);

}  // namespace acmp
