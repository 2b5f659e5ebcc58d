#pragma once

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/mapping/dense_mapper.h"

namespace acmp {

/// Options of the sliding window that a user can set, without those of its pipeline.
OptionList OptionsOf(DenseMapperOptions* options);

}  // namespace acmp
