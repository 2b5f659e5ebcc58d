#include "summary.h"

#include <algorithm>
#include <cstdio>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

std::string Quoted(const std::string& text) {
  std::string quoted = "\"";
  for (char c : text) {
    if (c == '"' || c == '\\') {
      quoted += '\\';
      quoted += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      char code[8];
      std::snprintf(code, sizeof(code), "\\u%04x", c);
      quoted += code;
    } else {
      quoted += c;
    }
  }
  return quoted + '"';
}

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
                          size_t points) {
  std::string text = "{\n  \"device\": " + Quoted(device) + ",\n  \"settings\": {";
  for (size_t i = 0; i < record.size(); ++i) {
    text += Concat(i ? "," : "", "\n    ", Quoted(record[i].first), ": ", Quoted(record[i].second));
  }
  std::string without_map;
  int with_map = 0;
  for (const ImagePlan& image : run.plan.images) {
    if (image.no_map.empty()) {
      ++with_map;
      continue;
    }
    without_map +=
        Concat(without_map.empty() ? "" : ",", "\n    {\"index\": ", image.index,
               ", \"name\": ", Quoted(run.scene.images[image.index].name), ", \"reason\": ", Quoted(image.no_map), "}");
  }
  text += Concat("\n  },\n  \"images_with_map\": ", with_map, ",\n  \"images_without_map\": [", without_map,
                 without_map.empty() ? "" : "\n  ", "],\n  \"points\": ", points,
                 ",\n  \"images_matched_in_last_run\": ", run.times.images, ",\n  \"milliseconds_in_last_run\": {");
  const auto rows = Rows(run.times);
  for (size_t i = 0; i < rows.size(); ++i) {
    text += Concat(i ? "," : "", "\n    ", Quoted(rows[i].first), ": ", rows[i].second);
  }
  return text + "\n  }\n}\n";
}

std::string FormatTimings(const RunTimes& times) {
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
