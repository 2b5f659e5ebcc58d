#pragma once

#include <algorithm>
#include <cstring>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/patch_match/host_passes.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "reconstruction/scene_fixture.h"
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

inline std::vector<ReconstructDevice> FakeHost(FakeMatcher* matcher) {
  std::vector<ReconstructDevice> devices(1);
  devices[0].engines.push_back(std::make_unique<FakeMatcherEngine>(matcher));
  devices[0].on_host = true;
  return devices;
}

/// How fake GPUs behave, and what they have made. Told of their fusions, by the thread that fuses.
struct FakeGpuBehaviour {
  size_t free_bytes = size_t{1} << 30;  ///< at the start of a run, each
  std::function<void()> before_pass = [] {};
  std::function<void(int device, int image, int rank)> before = [](int, int, int) {};
  std::function<void(int device, int image, int rank)> after = [](int, int, int) {};

  EngineEstimatePtr Watch(EngineEstimatePtr estimate) {
    const std::lock_guard<std::mutex> lock(mutex);
    estimates.push_back(estimate);
    return estimate;
  }
  size_t NumEstimatesAlive() {
    const std::lock_guard<std::mutex> lock(mutex);
    return static_cast<size_t>(
        std::count_if(estimates.begin(), estimates.end(), [](const auto& estimate) { return !estimate.expired(); }));
  }
  std::mutex mutex;
  std::vector<std::weak_ptr<const EngineEstimate>> estimates;
};

/// An engine that the tool takes for one on a GPU, so that it works with threads.
class FakeGpu final : public FakeMatcherEngine {
 public:
  /// @param behaviour outlives this
  FakeGpu(int device, FakeGpuBehaviour* behaviour)
      : FakeMatcherEngine(&matcher_), device_(device), behaviour_(*behaviour) {}

  std::unique_ptr<DepthEngine> Share() override { return std::make_unique<FakeGpu>(device_, &behaviour_); }
  PointCloud FuseView(const EngineView& reference, const std::vector<EngineView>& sources, const FusionOptions& options,
                      int rank, FusionStamps* stamps) override {
    const int image = static_cast<int>(reference.frame->id);
    behaviour_.before(device_, image, rank);
    PointCloud cloud = FakeMatcherEngine::FuseView(reference, sources, options, rank, stamps);
    behaviour_.after(device_, image, rank);
    return cloud;
  }
  size_t FreeDeviceBytes() const override { return behaviour_.free_bytes; }

 private:
  EngineEstimatePtr Run(const PassRequest& request) override {
    if (request.pass != Pass::kPlanarPrior) behaviour_.before_pass();
    return behaviour_.Watch(FakeMatcherEngine::Run(request));
  }

  FakeMatcher matcher_;
  const int device_;
  FakeGpuBehaviour& behaviour_;
};

/// Runs of the tool on four images of 20 x 15 px with a stand-in for the matcher.
class ReconstructRunFixture : public ReconstructFixture {
 protected:
  static constexpr int kImages = 4;
  static constexpr int kWidth = 20;
  static constexpr int kHeight = 15;

  ReconstructRunFixture() {
    WriteScene(kImages, kWidth, kHeight);
    options_.scene = scene();
    options_.output = output();
    options_.device = "cpu";
  }

  void Run(FakeMatcher* matcher) { Run(matcher, &watcher_); }
  void Run(FakeMatcher* matcher, StopRequest* watcher) {
    log_.str("");
    out_.str("");
    Reconstruct(options_, {[&] { return FakeHost(matcher); }, *watcher, out_, log_, false});
  }
  /// A stage by a process of its own. Throws what its answer says.
  void Stage(const std::string& stage, const std::string& images, FakeMatcher* matcher, StopRequest* watcher) {
    ReconstructOptions options = options_;
    options.stages = true;
    std::ostringstream answer;
    std::optional<std::string> line = stage == "finish" ? stage : stage + " " + images;
    log_.str("");
    const auto make_devices = [&] { return FakeHost(matcher); };
    ReconstructStages(options, {make_devices, *watcher, answer, log_, false},
                      [&] { return std::exchange(line, std::nullopt); });
    out_.str(answer.str());
    if (answer.str().find(": exit code 2: ") != std::string::npos) throw InvalidInputError(answer.str());
    if (answer.str().find(": exit code 1: ") != std::string::npos) throw ProcessingError(answer.str());
  }
  void Stage(const std::string& stage, const std::string& images, FakeMatcher* matcher) {
    Stage(stage, images, matcher, &watcher_);
  }
  /// A run that is asked to stop when a pass begins. Returns how many had begun.
  size_t RunInterrupted(int pass) {
    FakeMatcher matcher;
    StopRequest watcher;
    matcher.on_call = [&](int call) {
      if (call == pass) watcher.Request();
    };
    EXPECT_THROW(Run(&matcher, &watcher), Interrupted);
    return matcher.calls.size();
  }
  static std::vector<ReconstructDevice> FakeGpus(int devices, int jobs, FakeGpuBehaviour* behaviour) {
    std::vector<ReconstructDevice> made(static_cast<size_t>(devices));
    for (int device = 0; device < devices; ++device) {
      for (int job = 0; job < jobs; ++job) {
        made[static_cast<size_t>(device)].engines.push_back(std::make_unique<FakeGpu>(device, behaviour));
      }
    }
    return made;
  }
  /// A whole run to another folder. Returns the number of its passes.
  int RunTo(const std::string& name) {
    FakeMatcher matcher;
    const std::filesystem::path before = std::exchange(options_.output, output(name));
    Run(&matcher);
    options_.output = before;
    return static_cast<int>(matcher.calls.size());
  }
  std::string ErrorOf(FakeMatcher* matcher) {
    return MessageOf<InvalidInputError>([&] { Run(matcher); });
  }
  std::string Error() { return ErrorOf(&fake_); }
  /// With options that are changed for this once.
  std::string ErrorWith(const std::function<void(ReconstructOptions*)>& change) {
    const ReconstructOptions good = options_;
    change(&options_);
    std::string message = Error();
    options_ = good;
    return message;
  }
  bool Has(const std::string& name) const { return std::filesystem::exists(options_.output / name); }

  ReconstructOptions options_;
  StopRequest watcher_;
  std::ostringstream out_;
  std::ostringstream log_;
  FakeMatcher fake_;
};

}  // namespace acmp
