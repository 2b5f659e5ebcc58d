#include "run_record.h"

#include <nlohmann/json.hpp>
#include <optional>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::string Joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : " ") + word;
  return all.empty() ? "nothing" : all;
}

std::string RefinePosesName(const ReconstructOptions& options) {
  PoseRefinementOptions poses = options.pose_refinement;
  return std::get<std::string>(OptionsOf(&poses).Find("refine_poses").get());
}

/// As few digits as tell it from all other numbers.
std::string AllDigits(double value) { return nlohmann::json(value).dump(); }

}  // namespace

RunRecord SettingsRecord(const ReconstructOptions& options) {
  const auto depth = [](const std::optional<double>& value) { return value ? Concat(*value) : std::string("auto"); };
  const auto flag = [](bool value) { return std::string(value ? "yes" : "no"); };
  RunRecord record = {{"version", ACMP_VERSION},
                      {"preset", options.preset},
                      {"set", Joined(options.set)},
                      {"schedule", options.schedule},
                      {"max-image-size", Concat(options.max_image_size)},
                      {"source-views", Concat(options.source_views)},
                      {"min-source-views", Concat(MinSourceViews(options))},
                      {"depth-min", depth(options.depth_min)},
                      {"depth-max", depth(options.depth_max)},
                      {"refine-poses", RefinePosesName(options)},
                      {"seed", Concat(options.seed)},
                      {"maps", Joined(options.maps)},
                      {"dmb", flag(options.dmb)},
                      {"colmap", flag(options.colmap)},
                      {"pictures", flag(!options.no_pictures)},
                      {"tile-size", options.tile_size ? AllDigits(*options.tile_size) : "none"}};
  if (options.online()) {
    record.emplace_back("window-size", Concat(options.window_size));
    record.emplace_back("lookahead", Concat(options.lookahead));
    record.emplace_back("refine-again", flag(options.refine_again));
  }
  return record;
}

RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash) {
  RunRecord record = SettingsRecord(options);
  record.insert(record.begin() + 1, {{kInputKey, input_hash}, {kDeviceKey, DeviceModel(device)}});
  return record;
}

std::string DeviceModel(const std::string& device_name) { return device_name.substr(0, device_name.find(" (")); }

}  // namespace acmp
