#include "acmp_mapping/evaluation/evaluate.h"

#include <array>
#include <nlohmann/json.hpp>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array<const char*, 8> kColumns = {"<2cm", "<5cm", "<10cm", "<1%", "<2%", "<5%", "dens", "med"};

std::array<double, 8> Figures(const DepthMetrics& m) {
  return {m.below_absolute[0], m.below_absolute[1], m.below_absolute[2], m.below_relative[0],
          m.below_relative[1], m.below_relative[2], m.density,           m.median_error};
}

std::string FigureColumns(const DepthMetrics& metrics) {
  const std::array<double, 8> figures = Figures(metrics);
  std::string text;
  for (size_t i = 0; i + 1 < figures.size(); ++i) text += StringPrintf("%7.2f ", figures[i]);
  return text + StringPrintf("%8.4f\n", figures.back());
}

std::string TableRow(const std::string& label, size_t pixels, const DepthMetrics& metrics) {
  return StringPrintf("%-22s %9zu ", label.c_str(), pixels) + FigureColumns(metrics);
}

std::string MissingLine(const DepthEvaluation& evaluation) {
  constexpr size_t kMaxListed = 20;
  std::string list;
  size_t missing = 0;
  for (const ImageEvaluation& image : evaluation.images) {
    if (image.has_prediction) continue;
    if (missing++ < kMaxListed) list += Concat(list.empty() ? "" : ", ", image.index);
  }
  if (missing == 0) return {};
  return Concat("no prediction file for ", missing, " of ", evaluation.images.size(), " images: [", list, "]\n");
}

// NaN becomes null.
Json JsonFigures(const DepthMetrics& metrics) { return Figures(metrics); }

}  // namespace

std::string DepthTable(const DepthEvaluation& evaluation, bool quiet) {
  std::string table = StringPrintf("%-22s %9s ", "image", "GT px");
  for (size_t i = 0; i + 1 < kColumns.size(); ++i) table += StringPrintf("%7s ", kColumns[i]);
  table += StringPrintf("%8s\n", "med[m]");
  size_t pixels = 0;
  for (const ImageEvaluation& image : evaluation.images) {
    pixels += image.metrics.ground_truth_pixels;
    const std::string label = Concat(image.index, " ", image.name, image.has_prediction ? "" : " MISSING");
    if (!quiet) table += TableRow(label, image.metrics.ground_truth_pixels, image.metrics);
  }
  const size_t count = evaluation.images.size();
  table += TableRow(Concat("mean of ", count, " images"), pixels / count, evaluation.mean);
  table += TableRow("pool", pixels, evaluation.pool);
  for (const RegionEvaluation& region : evaluation.regions) {
    table += StringPrintf("%-22s %8.1f%% ", (region.name + " (mean)").c_str(), 100.0 * region.share);
    table += FigureColumns(region.mean);
  }
  return table + MissingLine(evaluation);
}

std::string DepthJson(const DepthEvaluation& evaluation) {
  Json images = Json::array(), regions = Json::array();
  for (const ImageEvaluation& image : evaluation.images) {
    images.push_back({{"index", image.index},
                      {"image", image.name},
                      {"gt_pixels", image.metrics.ground_truth_pixels},
                      {"predicted", image.has_prediction},
                      {"figures", JsonFigures(image.metrics)}});
  }
  for (const RegionEvaluation& region : evaluation.regions) {
    regions.push_back({{"name", region.name}, {"share", region.share}, {"mean", JsonFigures(region.mean)}});
  }
  const Json json = {{"columns", kColumns},
                     {"images", images},
                     {"mean", JsonFigures(evaluation.mean)},
                     {"pool", JsonFigures(evaluation.pool)},
                     {"regions", regions}};
  return json.dump(1) + "\n";
}

std::string CloudTable(const CloudEvaluation& evaluation) {
  std::string table = Concat(evaluation.reconstructed_points, " reconstructed points, ");
  if (evaluation.true_maps > 0) {
    table += Concat(evaluation.observed_points, " of them where the ground truth observed the space, ");
  }
  table += Concat(evaluation.true_points, " true points");
  if (evaluation.true_maps > 0) table += Concat(" from ", evaluation.true_maps, " depth maps");
  table += Concat(", voxels of ", evaluation.voxel_size, "\n");
  table += StringPrintf("%10s %10s %13s %8s\n", "threshold", "accuracy", "completeness", "F1");
  for (const CloudMetrics& m : evaluation.metrics) {
    table += StringPrintf("%10.4g %10.2f %13.2f %8.2f\n", m.threshold, m.accuracy, m.completeness, m.f1);
  }
  return table;
}

std::string CloudJson(const CloudEvaluation& evaluation) {
  Json metrics = Json::array();
  for (const CloudMetrics& m : evaluation.metrics) {
    metrics.push_back(
        {{"threshold", m.threshold}, {"accuracy", m.accuracy}, {"completeness", m.completeness}, {"f1", m.f1}});
  }
  const Json json = {{"reconstructed_points", evaluation.reconstructed_points},
                     {"observed_points", evaluation.observed_points},
                     {"true_points", evaluation.true_points},
                     {"true_maps", evaluation.true_maps},
                     {"voxel", evaluation.voxel_size},
                     {"metrics", metrics}};
  return json.dump(1) + "\n";
}

}  // namespace acmp
