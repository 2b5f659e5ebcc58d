#pragma once

#include <cstdint>
#include <cstring>

#include "dense_mapper_fakes.h"

namespace acmp {

/// Its planes depend on everything a pass reads: whoever reads another estimate gets another map.
class HashEngine : public FakeEngine {
 protected:
  EstimateState Answer(const PassRequest& request) override {
    uint32_t hash = Mix(static_cast<uint32_t>(request.pass), static_cast<float>(request.geometric_pass));
    hash = Mix(hash, static_cast<float>(request.reference()));
    for (const EngineView& source : request.problem.sources) {
      const DepthMap depth = SourceDepth(request, source);
      hash = Mix(hash, static_cast<float>(source.frame->id));
      hash = Mix(hash, depth.empty() ? -1.0f : depth(0, 0));
    }
    if (request.start) hash = Mix(hash, DownloadDepth(request.start)(0, 0));
    const double depth = kWallDepth * (1 + 1e-3 * static_cast<double>(hash >> 8) / (1 << 24));
    return UniformState(request.camera(), {0, 0, -1, static_cast<float>(depth)}, 0.05f);
  }

 private:
  static uint32_t Mix(uint32_t hash, float value) {
    uint32_t bits = 0;
    std::memcpy(&bits, &value, sizeof(bits));
    return (hash ^ bits) * 2654435761u + 12345u;
  }
};

}  // namespace acmp
