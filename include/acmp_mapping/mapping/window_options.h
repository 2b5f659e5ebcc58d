#pragma once

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/mapping/dense_mapper.h"

namespace acmp {

/// Options of the sliding window that a user can set; those of its pipeline are PipelineOptionTable's.
const OptionTable<DenseMapperOptions>& WindowOptionTable();

}  // namespace acmp
