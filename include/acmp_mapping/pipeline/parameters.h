#pragma once

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/pipeline/presets.h"

namespace acmp {

/// Options of the pipeline that a user can set, over those of the preset. A mapper has those that may change while it
/// runs as parameters; the offline tools take all of them.
const OptionTable<PipelineOptions>& PipelineOptionTable();

}  // namespace acmp
