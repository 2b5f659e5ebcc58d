#include "summary.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using Json = nlohmann::ordered_json;

std::vector<std::pair<const char*, double>> Rows(const RunTimes& times) {
  return {{"photometric", times.stages.photometric_ms},
          {"prior construction", times.stages.prior_construction_ms},
          {"planar prior", times.stages.planar_prior_ms},
          {"geometric", times.stages.geometric_ms},
          {"completion", times.stages.fill_ms},
          {"kernels (device time, part of the passes above)", times.stages.kernels_ms},
          {"consistency", times.consistency_ms},
          {"fusion", times.fusion_ms},
          {"reading", times.reading_ms},
          {"keeping estimates", times.keeping_ms},
          {"writing maps and pictures", times.writing_ms},
          {"writing the cloud", times.cloud_ms},
          {"waiting for the disk", times.syncing_ms},
          {"whole run (steps overlap)", times.run_ms}};
}

}  // namespace

std::string FormatSummary(const ReconstructRun& run, const RunRecord& record, const std::string& device,
                          const CloudSize& cloud, const std::string& failure) {
  Json settings = Json::object(), times = Json::object(), without_map = Json::array();
  for (const auto& [name, value] : record) settings[name] = value;
  for (const auto& [name, ms] : Rows(run.times)) times[name] = ms;
  for (const ImagePlan& image : run.plan.images) {
    if (image.no_map.empty()) continue;
    without_map.push_back(
        {{"index", image.index}, {"name", run.scene.images[image.index].name}, {"reason", image.no_map}});
  }
  Json summary = {{"device", device},
                  {"settings", settings},
                  {"images_with_map", run.plan.images.size() - without_map.size()},
                  {"images_without_map", without_map},
                  {"points", cloud.points},
                  {"images_matched_in_last_run", run.times.images},
                  {"milliseconds_in_last_run", times}};
  if (cloud.tiles) summary["tiles"] = *cloud.tiles;
  if (!failure.empty()) summary["failure"] = failure;
  return summary.dump(2) + "\n";
}

std::string FailureOfSummary(const std::filesystem::path& path) {
  std::ifstream stream(path);
  const Json summary = Json::parse(stream, nullptr, false);
  if (!summary.is_object() || !summary.contains("failure") || !summary["failure"].is_string()) return "";
  return summary["failure"].get<std::string>();
}

std::string FormatTimings(const RunTimes& times) {
  const ClassicLocale point;
  char line[128];
  std::snprintf(line, sizeof(line), "%-48s %12s %12s\n", Concat("stage (", times.images, " images)").c_str(), "ms",
                "ms per image");
  std::string text = line;
  const int images = std::max(1, times.images);
  for (const auto& [name, ms] : Rows(times)) {
    std::snprintf(line, sizeof(line), "%-48s %12.1f %12.2f\n", name, ms, ms / images);
    text += line;
  }
  return text;
}

}  // namespace acmp
