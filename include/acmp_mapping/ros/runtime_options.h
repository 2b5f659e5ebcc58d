#pragma once

#include <utility>

#include <acmp_mapping/DenseMapperConfig.h>

#include "acmp_mapping/common/option.h"
#include "acmp_mapping/intake/keyframe_gate.h"
#include "acmp_mapping/mapping/auto_preset.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/parameter_reader.h"

namespace acmp {

/// What decides the maps; RuntimeOptionTable says what each means and what it may be. Some of it may change while the
/// nodelet runs (dynamic_reconfigure): the worker takes one copy per keyframe.
struct RuntimeOptions {
  DenseMapperOptions mapper;
  KeyframeGateOptions gate;
  double min_depth_confidence = 0;
};
void Validate(const RuntimeOptions& options);

/// Gate, window, output, and of the pipeline what may change while it runs.
const OptionTable<RuntimeOptions>& RuntimeOptionTable();

/// Parameters of the namespace over the defaults in `start`. Throws InvalidInputError for a value that is out of bounds
/// or does not fit another one.
RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const RuntimeOptions& start);

/// The same over the preset of a setting, whose source views limit those of the namespace.
RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const AutoPreset::Setting& setting);

using acmp_mapping::DenseMapperConfig;

DenseMapperConfig ToConfig(const RuntimeOptions& options);

/// `current` with what may change taken from the configuration. Throws InvalidInputError as LoadRuntimeOptions does.
RuntimeOptions FromConfig(const DenseMapperConfig& config, const RuntimeOptions& current);

/// Least and largest values. They are not in the .cfg file, since the server of dynamic_reconfigure would silently
/// limit values to them before FromConfig sees these.
std::pair<DenseMapperConfig, DenseMapperConfig> ConfigBounds();

}  // namespace acmp
