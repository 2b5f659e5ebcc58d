#include "acmp_mapping/evaluation/evaluate_report.h"

#include <array>
#include <cmath>
#include <cstdio>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr std::array<const char*, 8> kColumns = {"<2cm", "<5cm", "<10cm", "<1%", "<2%", "<5%", "dens", "med"};

template <class... Args>
std::string Format(const char* format, Args... args) {
  const int length = std::snprintf(nullptr, 0, format, args...);
  std::string text(static_cast<size_t>(length), '\0');
  std::snprintf(text.data(), text.size() + 1, format, args...);
  return text;
}

std::array<double, 8> Figures(const DepthMetrics& m) {
  return {m.below_absolute[0], m.below_absolute[1], m.below_absolute[2], m.below_relative[0],
          m.below_relative[1], m.below_relative[2], m.density,           m.median_error};
}

std::string FigureColumns(const DepthMetrics& metrics) {
  const std::array<double, 8> figures = Figures(metrics);
  std::string text;
  for (size_t i = 0; i + 1 < figures.size(); ++i) text += Format("%7.2f ", figures[i]);
  return text + Format("%8.4f\n", figures.back());
}

std::string TableRow(const std::string& label, size_t pixels, const DepthMetrics& metrics) {
  return Format("%-22s %9zu ", label.c_str(), pixels) + FigureColumns(metrics);
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

std::string JsonString(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += static_cast<unsigned char>(c) < 0x20 ? Format("\\u%04x", c) : std::string(1, c);
  }
  return quoted + '"';
}

std::string JsonFigures(const DepthMetrics& metrics) {
  std::string list;
  for (const double figure : Figures(metrics)) {
    list += (list.empty() ? "[" : ", ") + (std::isnan(figure) ? std::string("null") : Format("%.17g", figure));
  }
  return list + "]";
}

}  // namespace

std::string DepthTable(const DepthEvaluation& evaluation, bool quiet) {
  std::string table = Format("%-22s %9s ", "image", "GT px");
  for (size_t i = 0; i + 1 < kColumns.size(); ++i) table += Format("%7s ", kColumns[i]);
  table += Format("%8s\n", "med[m]");
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
    table += Format("%-22s %8.1f%% ", (region.name + " (mean)").c_str(), 100.0 * region.share);
    table += FigureColumns(region.mean);
  }
  return table + MissingLine(evaluation);
}

std::string DepthCsv(const DepthEvaluation& evaluation) {
  std::string csv = "index,image,gt_pixels";
  for (const char* column : kColumns) csv += std::string(",") + column;
  csv += "\n";
  for (const ImageEvaluation& image : evaluation.images) {
    csv += Format("%d,%s,%zu", image.index, image.name.c_str(), image.metrics.ground_truth_pixels);
    for (const double figure : Figures(image.metrics)) csv += Format(",%.5g", figure);
    csv += "\n";
  }
  return csv;
}

std::string DepthJson(const DepthEvaluation& evaluation) {
  std::string columns, images, regions;
  for (const char* column : kColumns) columns += (columns.empty() ? "" : ", ") + JsonString(column);
  for (const ImageEvaluation& image : evaluation.images) {
    images += Format("%s\n    {\"index\": %d, \"image\": %s, \"gt_pixels\": %zu, \"predicted\": %s, \"figures\": %s}",
                     images.empty() ? "" : ",", image.index, JsonString(image.name).c_str(),
                     image.metrics.ground_truth_pixels, image.has_prediction ? "true" : "false",
                     JsonFigures(image.metrics).c_str());
  }
  for (const RegionEvaluation& region : evaluation.regions) {
    regions += Format("%s\n    {\"name\": %s, \"share\": %.17g, \"mean\": %s}", regions.empty() ? "" : ",",
                      JsonString(region.name).c_str(), region.share, JsonFigures(region.mean).c_str());
  }
  return "{\n  \"columns\": [" + columns + "],\n  \"images\": [" + images +
         "],\n  \"mean\": " + JsonFigures(evaluation.mean) + ",\n  \"pool\": " + JsonFigures(evaluation.pool) +
         ",\n  \"regions\": [" + regions + "]\n}\n";
}

std::string CloudTable(const CloudEvaluation& evaluation) {
  std::string table = Concat(evaluation.reconstructed_points, " reconstructed points, ");
  if (evaluation.true_maps > 0) {
    table += Concat(evaluation.observed_points, " of them where the ground truth observed the space, ");
  }
  table += Concat(evaluation.true_points, " true points");
  if (evaluation.true_maps > 0) table += Concat(" from ", evaluation.true_maps, " depth maps");
  table += Concat(", voxels of ", evaluation.voxel_size, "\n");
  table += Format("%10s %10s %13s %8s\n", "threshold", "accuracy", "completeness", "F1");
  for (const CloudMetrics& m : evaluation.metrics) {
    table += Format("%10.4g %10.2f %13.2f %8.2f\n", m.threshold, m.accuracy, m.completeness, m.f1);
  }
  return table;
}

std::string CloudJson(const CloudEvaluation& evaluation) {
  std::string rows;
  for (const CloudMetrics& m : evaluation.metrics) {
    rows += Format("%s\n    {\"threshold\": %.17g, \"accuracy\": %.17g, \"completeness\": %.17g, \"f1\": %.17g}",
                   rows.empty() ? "" : ",", m.threshold, m.accuracy, m.completeness, m.f1);
  }
  return Format(
             "{\n  \"reconstructed_points\": %zu,\n  \"observed_points\": %zu,\n  \"true_points\": %zu,\n"
             "  \"true_maps\": %zu,\n  \"voxel\": %.17g,\n  \"metrics\": [",
             evaluation.reconstructed_points, evaluation.observed_points, evaluation.true_points, evaluation.true_maps,
             evaluation.voxel_size) +
         rows + "]\n}\n";
}

}  // namespace acmp
