// The mapper with an engine and a thread for outputs.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <future>
#include <random>
#include <thread>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/mapping/dense_mapper.h"
#include "dense_mapper_fakes.h"
#include "mapper_outputs.h"

namespace acmp {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

/// Notes all that callbacks say, and which of its threads they came in.
class Listener {
 public:
  explicit Listener(bool has_thread) : has_thread_(has_thread) {}

  DenseMapper::Callbacks MakeCallbacks() {
    DenseMapper::Callbacks callbacks;
    callbacks.on_fast = [this](const KeyframeDepthPtr& maps) { Note("fast", *maps); };
    callbacks.on_refined = [this](const KeyframeDepthPtr& maps) { Note("refined", *maps); };
    callbacks.on_refined_again = [this](const KeyframeDepthPtr& maps) { Note("again", *maps); };
    callbacks.on_drop = [this](const KeyframeDrop& drop) {
      Note(Concat("drop ", drop.frame->id, " ", drop.reason, drop.had_fast ? " had fast: " : ": ", drop.message));
    };
    callbacks.on_problem = [this](const std::string& reason, const std::string& message) {
      Note(Concat("problem ", reason, ": ", message));
    };
    return callbacks;
  }

  std::vector<std::string> said;

 private:
  void Note(std::string text) {
    EXPECT_NE(std::this_thread::get_id() == giver_, has_thread_) << text;
    said.push_back(std::move(text));
  }
  void Note(const char* kind, const KeyframeDepth& maps) {
    std::string text = Concat(kind, " ", maps.frame->id, " ", maps.depth(0, 0), " ", maps.points_in_camera.size());
    if (!maps.confidence.empty()) text += Concat(" ", maps.confidence(0, 0));
    for (const int64_t id : maps.source_ids) text += Concat(" ", id);
    Note(text);
  }

  const bool has_thread_;
  const std::thread::id giver_ = std::this_thread::get_id();
};

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

/// What a random stream, with flushes, resets and changes of options, has a listener hear.
std::vector<std::string> RunStream(unsigned seed, bool has_thread) {
  std::mt19937 random(seed);
  HashEngine engine;
  HostDepthEngine output_engine;
  Listener listener(has_thread);
  DenseMapper mapper(&engine, RandomOptions(&random), listener.MakeCallbacks(), has_thread ? &output_engine : nullptr);
  double x = 0;
  for (int64_t id = 0; id < 40; ++id) {
    mapper.AddKeyframe(RandomFrame(id, &x, &random));
    switch (random() % 16) {
      case 0: {
        mapper.Flush();
        listener.said.emplace_back("flushed");
        break;
      }
      case 1:
        mapper.Reset();
        listener.said.emplace_back("reset");
        break;
      case 2:
        mapper.set_options(RandomOptions(&random));
        break;
      default:
        break;
    }
  }
  mapper.Flush();
  listener.said.emplace_back("flushed");
  return listener.said;
}

TEST(DenseMapperOutputsTest, OfAThreadSayTheSameInTheSameOrder) {
  size_t again = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE(seed);
    const std::vector<std::string> said = RunStream(seed, true);
    EXPECT_EQ(said, RunStream(seed, false));
    again += static_cast<size_t>(
        std::count_if(said.begin(), said.end(), [](const std::string& text) { return text.rfind("again", 0) == 0; }));
  }
  EXPECT_GT(again, 0u) << "nothing was refined again: the streams do not show what they are for";
}

TEST(DenseMapperOutputsTest, PassesGoOnWhileACallbackRuns) {
  WallEngine engine;
  HostDepthEngine output_engine;
  std::promise<void> open;
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [opened = open.get_future().share()](const KeyframeDepthPtr&) { opened.wait(); };
  DenseMapper mapper(&engine, FakeOptions(8, 3), callbacks, &output_engine);
  for (int id = 0; id < 3; ++id) mapper.AddKeyframe(WallFrame(id));  // 0 and 1 cannot be estimated before 2 is there
  EXPECT_THAT(CallsOf(engine, "photometric", 2), SizeIs(1));
  open.set_value();
  mapper.Flush();
}

TEST(DenseMapperOutputsTest, ADestroyedMapperForgetsThem) {
  WallEngine engine;
  HostDepthEngine output_engine;
  std::vector<std::string> said;
  std::weak_ptr<const Frame> frame;
  {
    DenseMapper::Callbacks callbacks;
    callbacks.on_fast = [&](const KeyframeDepthPtr& maps) { said.push_back(Concat("fast ", maps->frame->id)); };
    DenseMapper mapper(&engine, FakeOptions(8, 3), callbacks, &output_engine);
    for (int id = 0; id < 3; ++id) {
      FramePtr added = WallFrame(id);
      frame = added;
      mapper.AddKeyframe(std::move(added));
    }
  }
  EXPECT_LE(said.size(), 3u);
  EXPECT_TRUE(frame.expired());
}

/// Cannot hand out maps of the keyframes that a test names.
class FailingHostEngine : public HostDepthEngine {
 public:
  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    if (reference.frame->id == fails_consistency_of) throw ProcessingError("no memory for points");
    return HostDepthEngine::FilterByConsistency(reference, sources, options);
  }
  EstimateMaps Download(const EngineEstimatePtr& estimate) override {
    if (++downloads == fails_download) throw ProcessingError("device lost");
    return HostDepthEngine::Download(estimate);
  }
  DepthMap DownloadDepth(const EngineEstimatePtr& estimate) override { return Download(estimate).depth; }

  int64_t fails_consistency_of = -1;
  int fails_download = 0;  ///< counted from 1
  int downloads = 0;
};

struct FailingMapper {
  explicit FailingMapper(const DenseMapperOptions& options)
      : mapper(&engine, options, listener.MakeCallbacks(), &output_engine) {}

  WallEngine engine;
  FailingHostEngine output_engine;
  Listener listener{true};
  DenseMapper mapper;
};

TEST(DenseMapperOutputsTest, AFailedConsistencyCheckDropsThatKeyframeOnly) {
  DenseMapperOptions options = FakeOptions(8, 3);
  options.refine_again = true;
  FailingMapper failing(options);
  failing.output_engine.fails_consistency_of = 2;
  for (int id = 0; id < 8; ++id) failing.mapper.AddKeyframe(WallFrame(id));
  failing.mapper.Flush();
  const auto& said = failing.listener.said;
  EXPECT_THAT(said, Contains("drop 2 processing_error had fast: no memory for points"));
  EXPECT_THAT(said, Not(Contains(HasSubstr("refined 2 "))));
  EXPECT_THAT(said, Not(Contains(HasSubstr("again 2 "))));
  for (const int id : {0, 1, 3, 4, 5, 6, 7}) EXPECT_THAT(said, Contains(HasSubstr(Concat("refined ", id, " "))));
  EXPECT_EQ(failing.mapper.unfinished(), 0u);
  // Its refined estimate is whole: others read it.
  const WallEngine::Call call = CallsOf(failing.engine, "geometric", 4)[0];
  for (size_t i = 0; i < call.sources.size(); ++i) {
    if (call.sources[i] == 2) {
      EXPECT_FLOAT_EQ(call.source_depths[i], kRefinedDepth);
    }
  }
}

TEST(DenseMapperOutputsTest, ADroppedKeyframeGetsNoBetterMaps) {
  FailingMapper failing(RefiningAgain(10));
  failing.output_engine.fails_consistency_of = 1;
  for (int id = 0; id < 5; ++id) failing.mapper.AddKeyframe(WallFrame(id, id < 3 ? 0.08 * id : 0.35 * (id - 2)));
  failing.mapper.Flush();
  EXPECT_THAT(failing.listener.said, Contains(HasSubstr("again 0 "))) << "or the test shows nothing";
  EXPECT_THAT(failing.listener.said, Not(Contains(HasSubstr("refine_again_failed"))));
}

TEST(DenseMapperOutputsTest, MissingFastMapsAreAProblemAndTheRefinedOnesCome) {
  FailingMapper failing(FakeOptions(8, 3));
  failing.output_engine.fails_download = 1;
  for (int id = 0; id < 3; ++id) failing.mapper.AddKeyframe(WallFrame(id));
  failing.mapper.WaitForOutputs();
  EXPECT_THAT(failing.listener.said, Contains("problem fast_maps_failed: keyframe 0 has no fast maps: device lost"));
  EXPECT_THAT(failing.listener.said, Not(Contains(HasSubstr("fast 0 "))));
  failing.mapper.Flush();
  EXPECT_THAT(failing.listener.said, Contains(HasSubstr("refined 0 ")));
}

TEST(DenseMapperOutputsTest, HadFastTellsWhetherThereWasACall) {
  FailingMapper failing(FakeOptions(8, 3));
  failing.output_engine.fails_download = 1;
  failing.output_engine.fails_consistency_of = 0;
  for (int id = 0; id < 3; ++id) failing.mapper.AddKeyframe(WallFrame(id));
  failing.mapper.Flush();
  EXPECT_THAT(failing.listener.said, Contains("drop 0 processing_error: no memory for points"));
}

TEST(OutputQueueTest, SubmitWaitsWhileTooManyAreNotDone) {
  std::promise<void> open;
  const std::shared_future<void> opened = open.get_future().share();
  OutputQueue queue(true);
  for (size_t i = 1; i < OutputQueue::kMaxJobs; ++i) queue.Submit([opened] { opened.wait(); });
  std::atomic<bool> has_returned{false};
  bool had_returned_when_opened = true;
  std::thread opener([&] {
    // Long enough for a Submit that does not wait; one that does passes however slow the machine is.
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    had_returned_when_opened = has_returned;
    open.set_value();
  });
  queue.Submit([opened] { opened.wait(); });
  has_returned = true;
  opener.join();
  EXPECT_FALSE(had_returned_when_opened);
}

TEST(DenseMapperOutputsTest, NeedAnEngineOfTheirOwn) {
  WallEngine engine;
  EXPECT_THROW(DenseMapper(&engine, FakeOptions(8, 3), {}, &engine), InvalidInputError);
}

}  // namespace
}  // namespace acmp
