#include "acmp_mapping/ros/runtime_options.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <type_traits>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

/// The shortest decimal that reads back as the float: 0.18 rather than 0.180000007.
double ToDecimal(float value) { return std::stod(Concat(value)); }

template <class Option, class Field>
void OptionToField(const Option& option, Field& field) {
  if constexpr (std::is_same_v<Option, float>) {
    field = ToDecimal(option);
  } else {
    field = static_cast<Field>(option);
  }
}

/// Bound of each numeric parameter.
std::map<std::string, double> Bounds(const DenseMapperConfig& config) {
  std::map<std::string, double> bounds;
  const RuntimeOptions unused;
  VisitRuntimeParameters(unused, config, [&](const char* name, const auto&, const auto& field) {
    bounds[name] = static_cast<double>(field);
  });
  return bounds;
}

template <class T>
void Limit(const char* name, T high, const std::string& why, T* value, std::vector<std::string>* changes) {
  if (!(*value > high)) return;
  changes->push_back(Concat(name, " = ", *value, " was changed to ", high, ": ", why));
  *value = high;
}

}  // namespace

void Validate(const OutputOptions& options) { CheckRange("min_confidence", options.min_confidence, 0.0, 1.0); }

void Validate(const RuntimeOptions& options) {
  Validate(options.mapper);
  Validate(options.gate);
  Validate(options.output);
}

DenseMapperConfig ToConfig(const RuntimeOptions& options) {
  DenseMapperConfig config = DenseMapperConfig::__getDefault__();
  VisitRuntimeParameters(options, config,
                         [](const char*, const auto& option, auto& field) { OptionToField(option, field); });
  return config;
}

RuntimeOptions FromConfig(const DenseMapperConfig& config, RuntimeOptions options) {
  VisitRuntimeParameters(options, config, [](const char*, auto& option, const auto& field) {
    option = static_cast<std::decay_t<decltype(option)>>(field);
  });
  return options;
}

RuntimeOptions LoadRuntimeOptions(ParameterReader* reader, const RuntimeOptions& start) {
  const std::map<std::string, double> low = Bounds(DenseMapperConfig::__getMin__());
  const std::map<std::string, double> high = Bounds(DenseMapperConfig::__getMax__());
  DenseMapperConfig config = ToConfig(start);
  VisitRuntimeParameters(start, config, [&](const char* name, const auto&, auto& field) {
    if (!reader->Read(name, &field)) return;
    if constexpr (!std::is_same_v<std::decay_t<decltype(field)>, bool>) {
      CheckRange(Concat("parameter ~", name).c_str(), static_cast<double>(field), low.at(name), high.at(name));
    }
  });
  const RuntimeOptions options = FromConfig(config, start);
  Validate(options);
  return options;
}

std::vector<std::string> MakeValid(const DenseMapperConfig& previous, DenseMapperConfig* config) {
  std::vector<std::string> changes;
  Limit("lookahead", config->window_size - 1, "must be below window_size", &config->lookahead, &changes);
  Limit("reestimates", config->window_size - 1, "must be below window_size", &config->reestimates, &changes);
  Limit("min_source_views", std::min(config->max_source_views, config->window_size - 1),
        "must be at most max_source_views and below window_size", &config->min_source_views, &changes);
  Limit("best_angle_min_deg", config->best_angle_max_deg, "must be at most best_angle_max_deg",
        &config->best_angle_min_deg, &changes);
  Limit("min_angle_deg", config->best_angle_min_deg, "must be at most best_angle_min_deg", &config->min_angle_deg,
        &changes);
  try {
    Validate(FromConfig(*config));
  } catch (const InvalidInputError& error) {
    changes = {Concat("all changes were refused: ", error.what())};
    *config = previous;
  }
  return changes;
}

}  // namespace acmp
