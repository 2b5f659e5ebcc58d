#pragma once

#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/patch_match/patch_match.h"

namespace acmp {

/// Stands in for the matcher where only the order of the steps and the files matter. A result depends on all the input
/// of its pass, so that a wrong or stale input shows up as other bytes.
class FakePatchMatch : public PatchMatch {
 public:
  struct Call {
    std::string pass;
    double reference_x = 0;               ///< camera centre
    std::vector<uint32_t> source_hashes;  ///< of the source views' depth maps; 0 without one
    uint32_t result_hash = 0;             ///< of the resulting depth map
  };

  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options) override {
    return Run("photometric", problem, options, 0);
  }
  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) override {
    return Run("prior", problem, options, HashOf(start) + HashOf(prior));
  }
  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                const PatchMatchResult& start, int pass) override {
    return Run("geometric " + std::to_string(pass), problem, options, HashOf(start));
  }
  Image<float> MeasureEvidence(const PatchMatchProblem&, const PlaneMap& planes, int cell_size) override {
    return Image<float>(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
  }
  PatchMatchTiming last_timing() const override { return {0, 1, 0}; }
  std::string device_name() const override { return "fake (for tests)"; }

  /// Called before each pass with its number, from 0.
  std::function<void(int)> on_call = [](int) {};
  std::vector<Call> calls;

 private:
  template <class T>
  static uint32_t HashOf(ImageView<T> view) {
    uint32_t hash = 17;
    for (int row = 0; row < view.height; ++row) {
      for (int col = 0; col < view.width; ++col) {
        uint32_t words[sizeof(T) / 4];
        std::memcpy(words, &view(col, row), sizeof(words));
        for (uint32_t word : words) hash = HashWord(hash ^ word);
      }
    }
    return view.empty() ? 0 : hash;
  }
  static uint32_t HashOf(const PatchMatchResult& result) {
    return HashOf(result.planes.View()) + HashOf(result.cost.View());
  }

  PatchMatchResult Run(const std::string& pass, const PatchMatchProblem& problem, const PatchMatchOptions& options,
                       uint32_t hash) {
    on_call(static_cast<int>(calls.size()));
    Check(problem);
    Call call;
    call.pass = pass;
    call.reference_x = problem.reference.cam_from_world.inverse().translation().x();
    hash += HashOf(problem.reference.gray) + HashWord(options.seed);
    for (const MatchView& source : problem.sources) {
      call.source_hashes.push_back(HashOf(source.depth));
      hash = HashWord(hash + HashOf(source.gray) + call.source_hashes.back());
    }
    PatchMatchResult result = MakeResult(problem, hash);
    const DepthMap depth = ToDepthMap(result.planes, problem.reference.camera);
    call.result_hash = HashOf(depth.View());
    calls.push_back(call);
    return result;
  }

  /// Planes that face the camera, close to one depth so that fusion finds something, each a little different.
  static PatchMatchResult MakeResult(const PatchMatchProblem& problem, uint32_t hash) {
    const int width = problem.reference.camera.width;
    const int height = problem.reference.camera.height;
    PatchMatchResult result{PlaneMap(width, height), CostMap(width, height), Image<uint32_t>(width, height)};
    for (size_t i = 0; i < result.planes.size(); ++i) {
      RandomStream random(hash, static_cast<uint32_t>(i), 0);
      const float middle = 0.5f * (problem.depth_range.min + problem.depth_range.max);
      result.planes.data()[i] = {0, 0, -1, middle * random.NextUniform(0.999f, 1.001f)};
      result.cost.data()[i] = random.NextUniform();
    }
    return result;
  }
};

}  // namespace acmp
