#include "acmp_mapping/pipeline/schedule.h"

namespace acmp {

std::vector<KeyframeStep> ScheduleOf(const PipelineOptions& options) {
  using Kind = KeyframeStep::Kind;
  if (options.multi_scale) {
    std::vector<KeyframeStep> steps;
    for (int level = options.start_level; level >= 0; --level) {
      steps.push_back({level == options.start_level ? Kind::kInitial : Kind::kNextScale, 0, level});
      for (int pass = 0; pass < options.geometric_passes; ++pass) steps.push_back({Kind::kGeometricPass, pass, level});
    }
    return steps;
  }
  std::vector<KeyframeStep> steps = {{Kind::kInitial}};
  const bool fills = options.fill.enabled;
  if (fills && options.geometric_passes > 0) steps.push_back({Kind::kFillForPasses});
  for (int pass = 0; pass < options.geometric_passes; ++pass) steps.push_back({Kind::kGeometricPass, pass});
  if (fills) steps.push_back({Kind::kFillUnverified});
  return steps;
}

}  // namespace acmp
