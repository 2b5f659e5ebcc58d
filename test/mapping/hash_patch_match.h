#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>

#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/patch_match/patch_match.h"
#include "dense_mapper_fakes.h"

namespace acmp {

/// Its planes depend on everything a pass reads: whoever reads another estimate gets another map.
class HashPatchMatch : public PatchMatch {
 public:
  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions&) override {
    return Answer(problem, 1, nullptr);
  }
  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions&,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis>) override {
    return Answer(problem, 2, &start);
  }
  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions&,
                                const PatchMatchResult& start, int pass) override {
    return Answer(problem, 3 + static_cast<uint32_t>(pass), &start);
  }
  Image<float> MeasureEvidence(const PatchMatchProblem&, const PlaneMap& planes, int cell_size) override {
    return Image<float>(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
  }
  PatchMatchTiming last_timing() const override { return {}; }
  std::string device_name() const override { return "hash"; }

  /// Fails wherever this says so: (keyframe, whether it is a geometric pass).
  std::function<bool(int64_t, bool)> fails;

 private:
  static uint32_t Mix(uint32_t hash, float value) {
    uint32_t bits = 0;
    std::memcpy(&bits, &value, sizeof(bits));
    return (hash ^ bits) * 2654435761u + 12345u;
  }

  PatchMatchResult Answer(const PatchMatchProblem& problem, uint32_t pass, const PatchMatchResult* start) const {
    const float id = problem.reference.gray(0, 0);
    if (fails && fails(std::lround(id), pass >= 3)) throw ProcessingError("device lost");
    uint32_t hash = Mix(pass, id);
    for (const MatchView& source : problem.sources) {
      hash = Mix(hash, source.gray(0, 0));
      hash = Mix(hash, source.depth.empty() ? -1.0f : source.depth(0, 0));
    }
    if (start) hash = Mix(hash, start->planes(0, 0).d);
    const PinholeCamera& camera = problem.reference.camera;
    const double depth = kWallDepth * (1 + 1e-3 * static_cast<double>(hash >> 8) / (1 << 24));
    PatchMatchResult result;
    result.planes = PlaneMap(camera.width, camera.height, {0, 0, -1, static_cast<float>(depth)});
    result.cost = CostMap(camera.width, camera.height, 0.05f);
    result.selected_views = Image<uint32_t>(camera.width, camera.height);
    return result;
  }
};

}  // namespace acmp
