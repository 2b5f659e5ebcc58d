#pragma once

#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "support/fake_engine.h"

namespace acmp {

/// What a FakeMatcherEngine was asked, and whom it tells. Outlives the engine, which a run owns.
struct FakeMatcher {
  struct Call {
    std::string pass;
    std::vector<uint32_t> source_hashes;  ///< of the source views' depth maps; 0 without one
    uint32_t result_hash = 0;             ///< of the resulting depth map
  };

  /// Called before each pass with its number, from 0.
  std::function<void(int)> on_call = [](int) {};
  std::vector<Call> calls;
};

/// Stands in for a device where only the order of the steps and the files matter. A result depends on all the input of
/// its pass, so that a wrong or stale input shows up as other bytes.
class FakeMatcherEngine : public FakeEngine {
 public:
  /// @param matcher outlives this
  explicit FakeMatcherEngine(FakeMatcher* matcher) : matcher_(*matcher) {}

 protected:
  EstimateState Answer(const PassRequest& request) override {
    matcher_.on_call(static_cast<int>(matcher_.calls.size()));
    FakeMatcher::Call call;
    call.pass = request.pass == Pass::kPhotometric   ? "photometric"
                : request.pass == Pass::kPlanarPrior ? "prior"
                                                     : "geometric " + std::to_string(request.geometric_pass);
    uint32_t hash = HashOf(request.problem.reference.frame->gray.View()) + HashWord(request.options.seed);
    if (request.start) {
      const EstimateState start = DownloadState(request.start);
      hash += HashOf(start.planes.View()) + HashOf(start.cost.View());
    }
    if (request.prior != nullptr) {
      hash += HashOf(RasterizePrior(request.camera(), *request.prior, request.problem.depth_range).View());
    }
    for (const EngineView& source : request.problem.sources) {
      call.source_hashes.push_back(HashOf(SourceDepth(request, source).View()));
      hash = HashWord(hash + HashOf(source.frame->gray.View()) + call.source_hashes.back());
    }
    EstimateState result = MakeResult(request, hash);
    call.result_hash = HashOf(ToDepthMap(result.planes, request.camera()).View());
    matcher_.calls.push_back(call);
    return result;
  }

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

  /// Planes that face the camera, close to one depth so that fusion finds something, each a little different.
  static EstimateState MakeResult(const PassRequest& request, uint32_t hash) {
    EstimateState result = UniformState(request.camera(), {0, 0, -1, 0}, 0);
    const DepthRange& range = request.problem.depth_range;
    for (size_t i = 0; i < result.planes.size(); ++i) {
      RandomStream random(hash, static_cast<uint32_t>(i), 0);
      result.planes.data()[i].d = 0.5f * (range.min + range.max) * random.NextUniform(0.999f, 1.001f);
      result.cost.data()[i] = random.NextUniform();
    }
    return result;
  }

  FakeMatcher& matcher_;
};

}  // namespace acmp
