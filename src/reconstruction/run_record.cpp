#include "run.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

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
          {"whole run (steps overlap)", times.run_ms}};
}

std::string Joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : " ") + word;
  return all.empty() ? "nothing" : all;
}

/// summary.json: version, settings, images with and without a map, points, times of this run.
/// @param failure why it counts as failed; empty: it does not
std::string FormatSummary(const ReconstructRun& run, const RunRecord& record, const std::string& device, size_t points,
                          const std::string& failure) {
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
                  {"points", points},
                  {"images_matched_in_last_run", run.times.images},
                  {"milliseconds_in_last_run", times}};
  if (!failure.empty()) summary["failure"] = failure;
  return summary.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";  // names need not be UTF-8
}

}  // namespace

RunRecord SettingsRecord(const ReconstructOptions& options) {
  ReconstructOptions copy = options;
  const OptionList list = OptionsOf(&copy);
  RunRecord record = {{"version", ACMP_VERSION}, {"set", Joined(options.set)}};
  record.emplace_back("seed", Concat(options.seed));
  record.emplace_back("maps", Joined(options.maps));
  const auto add = [&](const std::string& name) { record.emplace_back(name, ToYaml(list.Find("--" + name).get())); };
  for (const char* name : {"preset", "schedule", "max-image-size", "source-views", "min-source-views", "depth-min",
                           "depth-max", "refine-poses", "dmb", "colmap", "no-pictures"}) {
    add(name);
  }
  for (const char* name : {"window-size", "lookahead", "refine-again"}) {
    if (options.online()) add(name);
  }
  return record;
}

RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash) {
  RunRecord record = SettingsRecord(options);
  if (!device.empty()) record.insert(record.begin() + 1, {kDeviceKey, DeviceModel(device)});
  record.insert(record.begin() + 1, {kInputKey, input_hash});
  return record;
}

std::string DeviceModel(const std::string& device_name) { return device_name.substr(0, device_name.find(" (")); }

void ReportComplete(const OutputFolder& folder, const std::string& prefix, const ReconstructOptions& options,
                    Progress* progress) {
  if (!options.keep_work) folder.RemoveWork();
  progress->Result(Concat(prefix, folder.path().string(), ": already complete (--overwrite starts afresh)"));
  std::ifstream stream(folder.SummaryFile());
  const Json summary = Json::parse(stream, nullptr, false);
  if (!summary.is_object() || !summary.contains("failure") || !summary["failure"].is_string()) return;
  throw ProcessingError(summary["failure"].get<std::string>());
}

void ReportImagesWithoutMap(const ReconstructPlan& plan, const Scene& scene, Progress* progress) {
  for (const ImagePlan& image : plan.images) {
    if (image.no_map.empty()) continue;
    progress->Warn(
        Concat("no map for image ", scene.images[static_cast<size_t>(image.index)].name, ": ", image.no_map));
  }
}

PointsJudgement JudgePoints(const ReconstructRun& run, size_t points) {
  constexpr double kHardlyAny = 0.01;
  constexpr char kCauses[] =
      ": poses, cameras (made for images of this size?) or the range of depths may be wrong, or images too small; "
      "confidence and cost show where";
  int64_t pixels = 0;
  int images = 0;
  for (const ImagePlan& image : run.plan.images) {
    if (!image.no_map.empty()) continue;
    const PinholeCamera camera = CameraOf(run, image.index);
    pixels += static_cast<int64_t>(camera.width) * camera.height;
    ++images;
  }
  const int views = run.pipeline.fusion.min_consistent_views;
  if (images <= views) {
    if (points > 0) return {};
    return {Concat("no points: for one ", views, " source views must agree in this preset, and ", images,
                   " images have maps"),
            ""};
  }
  if (points == 0) return {"", Concat("none of the ", pixels, " pixels became a point", kCauses)};
  if (static_cast<double>(points) >= kHardlyAny * static_cast<double>(pixels)) return {};
  return {Concat("only ", points, " of ", pixels, " pixels became points", kCauses), ""};
}

std::string DescribeUnusedPriorDepth(const ReconstructRun& run) {
  const std::map<int, std::string>& rejections = run.prior_depth_rejections;
  if (rejections.empty()) return "";
  const auto& [index, reason] = *rejections.begin();
  return Concat("the prior depth of ", rejections.size(), " images is not used, for example of ",
                run.scene.images[static_cast<size_t>(index)].name, ": ", reason);
}

void EndRun(ReconstructRun* run, const RunRecord& record, const std::string& device, const Timer& timer,
            size_t points) {
  run->interrupt.Check();
  run->progress.Warn(DescribeUnusedPriorDepth(*run));
  run->folder->WriteFileList();
  SyncFolder(run->folder->path());
  run->times.run_ms = timer.Elapsed();
  const PointsJudgement judgement = JudgePoints(*run, points);
  run->progress.Warn(judgement.warning);
  const std::string failure =
      judgement.failure.empty() ? "" : Concat(run->folder->path().string(), ": ", judgement.failure);
  WriteFileAtomically(run->folder->SummaryFile(), FormatSummary(*run, record, device, points, failure),
                      Durability::kPowerCut);
  if (!run->options.keep_work) run->folder->RemoveWork();
  run->progress.Result(Concat(run->folder->path().string(), ": ", points, " points in fused.ply; took ",
                              FormatDuration(run->times.run_ms / 1000), " on ", device));
  if (!failure.empty()) throw ProcessingError(failure);
}

}  // namespace acmp
