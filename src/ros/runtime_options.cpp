#include "acmp_mapping/ros/runtime_options.h"

#include <algorithm>
#include <functional>
#include <map>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/mapping/window_options.h"
#include "acmp_mapping/pipeline/parameters.h"

namespace acmp {
namespace {

using Description = OptionDescription;

OptionTable<RuntimeOptions> MakeTable() {
  OptionTable<RuntimeOptions> table;
  table.Group("keyframes");
  table.Add(
      Number(
          "gate_baseline_ratio", 0, 10, "",
          "keyframe_mode gate: a keyframe is so far from the last, and from others of the window with the same view, "
          "as a share of the scene's median depth")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.gate.min_baseline_ratio; });
  table.Embed(
      WindowOptionTable(), [](auto& o) -> auto& { return o.mapper; });
  table.Group("output");
  table.Add(
      Number("min_depth_confidence", 0, 1, "", "Refined depth of less confidence is not published; 0: all is")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.min_depth_confidence; });
  table.Embed(
      PipelineOptionTable(), [](auto& o) -> auto& { return o.mapper.pipeline; },
      [](const Description& option) { return option.while_running; });
  return table;
}

/// What follows from the options that a user sets.
void SetDependentOptions(RuntimeOptions* options) {
  DenseMapperOptions* mapper = &options->mapper;
  options->gate.remembered = static_cast<size_t>(std::max(mapper->window_size, 1));
  // A keyframe needs two useful views, or as many as it can have.
  mapper->min_source_views = std::min({DenseMapperOptions().min_source_views, mapper->source_views.max_source_views,
                                       std::max(mapper->window_size - 1, 1)});
}

/// A configuration of value(option) for each option that may change.
DenseMapperConfig MakeConfig(const std::function<OptionValue(const Option<RuntimeOptions>&)>& value) {
  dynamic_reconfigure::Config message;
  const auto append = [](const std::string& name, auto number, auto* list) {
    list->emplace_back();
    list->back().name = name;
    list->back().value = number;
  };
  for (const Option<RuntimeOptions>& option : RuntimeOptionTable()) {
    if (!option.description.while_running) continue;
    const OptionValue of_option = value(option);
    if (const bool* flag = std::get_if<bool>(&of_option)) append(option.name(), *flag, &message.bools);
    if (const int* integer = std::get_if<int>(&of_option)) append(option.name(), *integer, &message.ints);
    if (const double* number = std::get_if<double>(&of_option)) append(option.name(), *number, &message.doubles);
  }
  DenseMapperConfig config = DenseMapperConfig::__getDefault__();
  config.__fromMessage__(message);
  return config;
}

/// One end of the bounds, as the kind of value that the option has.
OptionValue BoundOf(const Option<RuntimeOptions>& option, bool upper) {
  const double bound = upper ? option.description.max : option.description.min;
  const OptionValue like = option.default_value();
  if (std::holds_alternative<bool>(like)) return upper;
  if (std::holds_alternative<int>(like)) return static_cast<int>(bound);
  return bound;
}

}  // namespace

const OptionTable<RuntimeOptions>& RuntimeOptionTable() {
  static const OptionTable<RuntimeOptions> table = MakeTable();
  return table;
}

void Validate(const RuntimeOptions& options) {
  RuntimeOptionTable().Check(options);
  Validate(options.mapper);
  Validate(options.gate);
}

RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const RuntimeOptions& start) {
  RuntimeOptions options = start;
  ReadOptions(RuntimeOptionTable(), reader, &options);
  SetDependentOptions(&options);
  Validate(options);
  const DepthRange& range = options.mapper.fallback_depth_range;
  if (HasDepthRange(range) != (range.min > 0 || range.max > 0)) {
    throw InvalidInputError(Concat("~depth_min = ", range.min, " and ~depth_max = ", range.max, ": set both or none"));
  }
  return options;
}

RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const AutoPreset::Setting& setting) {
  RuntimeOptions start;
  start.mapper.pipeline = MakePreset(setting.preset);
  RuntimeOptions options = LoadRuntimeOptions(reader, start);
  int* max_source_views = &options.mapper.source_views.max_source_views;
  *max_source_views = std::min(*max_source_views, setting.max_source_views);
  SetDependentOptions(&options);
  return options;
}

DenseMapperConfig ToConfig(const RuntimeOptions& options) {
  return MakeConfig([&](const Option<RuntimeOptions>& option) { return option.get(options); });
}

RuntimeOptions FromConfig(const DenseMapperConfig& config, const RuntimeOptions& current) {
  dynamic_reconfigure::Config message;
  config.__toMessage__(message);
  std::map<std::string, OptionValue> values;
  for (const auto& flag : message.bools) values[flag.name] = static_cast<bool>(flag.value);
  for (const auto& integer : message.ints) values[integer.name] = static_cast<int>(integer.value);
  for (const auto& number : message.doubles) values[number.name] = static_cast<double>(number.value);
  RuntimeOptions options = current;
  for (const Option<RuntimeOptions>& option : RuntimeOptionTable()) {
    if (!option.description.while_running) continue;
    CheckOption(option.description, values.at(option.name()));
    option.set(values.at(option.name()), &options);
  }
  SetDependentOptions(&options);
  Validate(options);
  return options;
}

std::pair<DenseMapperConfig, DenseMapperConfig> ConfigBounds() {
  return {MakeConfig([](const Option<RuntimeOptions>& option) { return BoundOf(option, false); }),
          MakeConfig([](const Option<RuntimeOptions>& option) { return BoundOf(option, true); })};
}

}  // namespace acmp
