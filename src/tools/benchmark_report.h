#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "benchmark_stages.h"

namespace acmp {

struct BenchmarkReport {
  std::string device, preset;
  int repetitions = 0;
  double fetches_per_s = 0;  ///< bilinear fetches of the GPU; 0 elsewhere
  std::vector<StageFigures> stages;
  std::vector<StreamFigures> streams;
  std::vector<ExpectedRates> expected;
  std::vector<std::string> auto_choices;  ///< MeasureAutoPreset
};

void PrintReport(const BenchmarkReport& report, std::ostream* out);

/// Throws ProcessingError when the file cannot be written.
void WriteJson(const BenchmarkReport& report, const std::string& path);

}  // namespace acmp
