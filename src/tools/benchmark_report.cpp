#include <iomanip>

#include "acmp_mapping/common/error.h"
#include "benchmark_stages.h"

namespace acmp {
namespace {

/// Samples per pixel and source view of the full schedule: 144 NCCs of 36 samples (1 + 3 * 14 photometric, the same
/// with the prior, 2 * (1 + 2 * 14) geometric). The floor of every preset is this schedule's.
constexpr double kPhotometricSamples = 43.0 * 36, kPriorSamples = 43.0 * 36, kGeometricSamples = 58.0 * 36;

double FloorMs(const BenchmarkReport& report, const StageFigures& row, double samples) {
  if (report.fetches_per_s == 0) return 0;
  return 1e3 * samples * row.size.width * row.size.height * row.source_views / report.fetches_per_s;
}

double BytesPerPixel(const StageFigures& row) {
  return static_cast<double>(row.device_bytes) / (static_cast<double>(row.size.width) * row.size.height);
}

void PrintCell(double ms, double floor_ms, std::ostream* out) {
  *out << std::setw(10) << ms;
  if (floor_ms > 0 && ms > 0) {
    *out << " (" << ms / floor_ms << "x)";
  } else {
    *out << "        ";
  }
}

void PrintStages(const BenchmarkReport& report, std::ostream* out) {
  *out << "medians of " << report.repetitions << " runs after one warm-up, ms per image, preset " << report.preset
       << "\n";
  if (report.fetches_per_s > 0) {
    *out << "texture rate " << report.fetches_per_s * 1e-12
         << "e12 fetches/s; (x): ratio to one fetch per sample of the preset acmp\n";
  }
  *out << "      size   V  photometric         planar prior        geometric passes    kernels             "
          "triangulation      load  download  consistency      fast     whole   B/px\n";
  for (const StageFigures& row : report.stages) {
    const StageMs& ms = row.median;
    *out << std::setw(10) << Concat(row.size.width, "x", row.size.height) << std::setw(4) << row.source_views;
    PrintCell(ms.photometric, FloorMs(report, row, kPhotometricSamples), out);
    PrintCell(ms.planar_prior, FloorMs(report, row, kPriorSamples), out);
    PrintCell(ms.geometric, FloorMs(report, row, kGeometricSamples), out);
    PrintCell(ms.photometric + ms.planar_prior + ms.geometric,
              FloorMs(report, row, kPhotometricSamples + kPriorSamples + kGeometricSamples), out);
    *out << std::setw(13) << ms.triangulation << std::setw(10) << ms.load << std::setw(10) << ms.download
         << std::setw(13) << ms.consistency << std::setw(10) << ms.fast << std::setw(10) << ms.whole << std::setw(7)
         << std::setprecision(0) << BytesPerPixel(row) << std::setprecision(2) << "\n";
  }
}

void PrintStreams(const BenchmarkReport& report, std::ostream* out) {
  *out << "online mapper, preset " << report.preset << ", ms\n"
       << "      size   V  keyframes   fast: median  99 %   refined: median  99 %   device   keyframes/s   MB device: "
          "begin  end   MB host: begin  end\n";
  const auto megabytes = [](size_t bytes) { return static_cast<double>(bytes) * 1e-6; };
  for (const StreamFigures& row : report.streams) {
    *out << std::setw(10) << Concat(row.size.width, "x", row.size.height) << std::setw(4) << row.source_views
         << std::setw(11) << row.keyframes << std::setw(15) << row.fast_median << std::setw(6) << row.fast_99
         << std::setw(18) << row.refined_median << std::setw(6) << row.refined_99 << std::setw(9) << row.device_median
         << std::setw(14) << row.keyframes_per_s << std::setprecision(1) << std::setw(18)
         << megabytes(row.device_bytes_begin) << std::setw(7) << megabytes(row.device_bytes_end) << std::setw(17)
         << megabytes(row.host_bytes_begin) << std::setw(7) << megabytes(row.host_bytes_end) << std::setprecision(2)
         << "\n";
  }
}

void PrintExpected(const BenchmarkReport& report, std::ostream* out) {
  const StreamFigures& first = report.expected.front().measured;
  *out << "keyframes per second that the online mapper keeps up with, " << first.source_views
       << " source views, 4:3 images\n"
       << "  measured: at " << first.size.width << "x" << first.size.height << ", " << first.keyframes
       << " keyframes with exact poses; what refine_poses takes is not in it\n"
       << "  computed: all other sizes, as the time grows with the number of pixels (within a fifth)\n";
  if (report.fetches_per_s > 0) *out << "texture rate " << report.fetches_per_s * 1e-12 << "e12 fetches/s, measured\n";
  const auto name = [](const ImageSize& size) { return Concat(size.width, "x", size.height); };
  *out << std::left << std::setw(18) << "preset" << std::right << std::setw(18) << name(first.size) + " measured";
  for (const auto& [size, rate] : report.expected.front().computed_rates) *out << std::setw(10) << name(size);
  *out << "\n" << std::setprecision(3) << std::defaultfloat;
  for (const ExpectedRates& row : report.expected) {
    *out << std::left << std::setw(18) << row.preset << std::right << std::setw(18) << row.measured.keyframes_per_s;
    for (const auto& [size, rate] : row.computed_rates) *out << std::setw(10) << rate;
    *out << "\n";
  }
}

}  // namespace

void PrintReport(const BenchmarkReport& report, std::ostream* out) {
  const auto flags = out->flags();
  *out << std::fixed << std::setprecision(2);
  if (!report.stages.empty()) PrintStages(report, out);
  if (!report.streams.empty()) PrintStreams(report, out);
  if (!report.expected.empty()) PrintExpected(report, out);
  for (const std::string& choice : report.auto_choices) *out << choice << "\n";
  out->flags(flags);
}

}  // namespace acmp
