// Random streams, and the mapper with an engine and a thread for outputs.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <future>
#include <random>
#include <set>
#include <thread>
#include <utility>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "dense_mapper_fakes.h"
#include "mapper_outputs.h"
#include "support/error_text.h"

namespace acmp {
namespace {

/// A keyframe of the kinds that live frontends produce: moving on, standing still, jumping, without or with useless
/// landmarks, broken.
FramePtr RandomFrame(int64_t id, double* x, std::mt19937* random) {
  const double nan = std::nan("");
  switch ((*random)() % 10) {
    case 0:
      break;
    case 1:
      *x += 50;
      break;
    default:
      *x += 0.05 * static_cast<double>((*random)() % 20);
  }
  std::vector<Eigen::Vector3d> landmarks;
  switch ((*random)() % 8) {
    case 0:
      break;
    case 1:
      landmarks.assign(50, {nan, 0, 0});
      break;
    case 2:
      landmarks.assign(50, {0, 0, 0});
      break;
    case 3:
      landmarks.assign(3, {*x, 0, kWallDepth});
      break;
    default:
      landmarks = WallLandmarks();
      for (auto& point : landmarks) point.x() += *x - 5;
  }
  Frame frame = MakeWallFrame(id, *x, std::move(landmarks));
  if ((*random)() % 15 == 0) frame.cam_from_world.linear()(0, 0) = nan;
  return std::make_shared<Frame>(std::move(frame));
}

DenseMapperOptions RandomOptions(std::mt19937* random) {
  const int window_size = 2 + static_cast<int>((*random)() % 7);
  const int lookahead = static_cast<int>((*random)() % static_cast<unsigned>(window_size));
  const int min_views = 1 + static_cast<int>((*random)() % static_cast<unsigned>(std::min(3, window_size - 1)));
  DenseMapperOptions options = FakeOptions(window_size, lookahead, min_views);
  options.pipeline.geometric_passes = static_cast<int>((*random)() % 3);
  options.pipeline.start_level = static_cast<int>((*random)() % 3);
  if ((*random)() % 2 == 0) options.fallback_depth_range = {1, 20};
  options.refine_again = (*random)() % 2 == 0;
  return options;
}

/// What became of each keyframe, from the events of a harness.
struct Account {
  void Book(const std::vector<std::string>& events) {
    for (const std::string& event : events) {
      const size_t space = event.find(' ');
      const int64_t id = std::stoll(event.substr(space + 1));
      const std::string kind = event.substr(0, space);
      if (kind == "fast") {
        EXPECT_EQ(ended.count(id), 0u) << "fast after its end: " << id;
        EXPECT_TRUE(fast.insert(id).second) << "fast twice: " << id;
      } else {
        EXPECT_TRUE(ended.insert(id).second) << "ended twice: " << id;
        EXPECT_EQ(kind == "refined" && fast.count(id) == 0, false) << "refined without fast: " << id;
        if (kind == "refined") refined.insert(id);
      }
      EXPECT_EQ(added.count(id), 1u) << "never added: " << id;
    }
  }

  void BookAgain(const std::vector<int64_t>& refined_again) const {
    for (const int64_t id : refined_again) EXPECT_EQ(refined.count(id), 1u) << "again, but not once: " << id;
  }

  std::set<int64_t> added;
  std::set<int64_t> fast;
  std::set<int64_t> ended;
  std::set<int64_t> refined;
};

void FailSometimes(WallEngine* engine, StopRequest* stop, std::mt19937* random) {
  engine->before_answer = [stop, random](const WallEngine::Call&) {
    switch ((*random)() % 25) {
      case 0:
        throw ProcessingError("device lost");
      case 1:
        throw InvalidInputError("bad problem");
      case 2:
        throw std::bad_alloc();
      case 3:
        if ((*random)() % 4 == 0) stop->Request();
        break;
      default:
        break;
    }
  };
}

TEST(DenseMapperPropertyTest, EveryKeyframeEndsExactlyOnce) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    DenseMapperOptions options = RandomOptions(&random);
    MapperHarness harness(options);
    harness.keep_maps = false;
    FailSometimes(&harness.engine, &harness.stop, &random);
    Account account;
    std::vector<std::weak_ptr<const Frame>> frames;
    double x = 0;
    for (int64_t id = 0; id < 40; ++id) {
      FramePtr frame = RandomFrame(id, &x, &random);
      frames.push_back(frame);
      account.added.insert(id);
      account.Book(harness.Add(std::move(frame)));
      account.BookAgain(std::exchange(harness.refined_again, {}));
      const auto kept = std::count_if(frames.begin(), frames.end(), [](const auto& f) { return !f.expired(); });
      EXPECT_TRUE(kept <= options.window_size || harness.stop.requested()) << kept;
      switch (harness.stop.requested() ? 1 : random() % 20) {
        case 0:
          account.Book(harness.Flush());
          account.BookAgain(std::exchange(harness.refined_again, {}));
          EXPECT_TRUE(harness.stop.requested() || account.ended == account.added);
          break;
        case 1:
          account.Book(harness.Reset());
          EXPECT_EQ(account.ended, account.added);
          harness.stop.Clear();
          break;
        case 2:
          options = RandomOptions(&random);
          harness.mapper.set_options(options);
          break;
        default:
          break;
      }
    }
    if (seed % 2 == 0) account.Book(harness.Flush());
    account.Book(harness.Reset());
    EXPECT_EQ(account.ended, account.added);
    EXPECT_EQ(account.ended.size(), 40u);
    for (const auto& frame : frames) EXPECT_TRUE(frame.expired());
    for (const KeyframeDrop& drop : harness.drops) EXPECT_FALSE(drop.message.empty()) << drop.reason;
  }
}

/// Depends on everything that a pass reads: whoever reads another estimate gets another map.
float HashedDepth(const WallEngine::Call& call) {
  size_t hash = std::hash<std::string>()(call.pass);
  const auto mix = [&](double value) { hash = 31 * hash + std::hash<double>()(value); };
  mix(call.geometric_pass);
  mix(static_cast<double>(call.reference));
  for (const int64_t source : call.sources) mix(static_cast<double>(source));
  for (const float depth : call.source_depths) mix(depth);
  mix(call.start_depth);
  return static_cast<float>(kWallDepth * (1 + 1e-3 * static_cast<double>(hash % 1000003) / 1000003));
}

/// What a random stream, with flushes, resets and changes of options, has a listener hear.
std::vector<std::string> RunStream(unsigned seed, bool has_thread) {
  std::mt19937 random(seed);
  HostDepthEngine output_engine;
  MapperHarness harness(RandomOptions(&random), has_thread ? &output_engine : nullptr);
  harness.keep_maps = false;
  harness.engine.depth_of_answer = HashedDepth;
  double x = 0;
  for (int64_t id = 0; id < 40; ++id) {
    harness.mapper.AddKeyframe(RandomFrame(id, &x, &random));
    switch (random() % 16) {
      case 0:
        harness.mapper.Flush();
        harness.said.emplace_back("flushed");
        break;
      case 1:
        harness.mapper.Reset();
        harness.said.emplace_back("reset");
        break;
      case 2:
        harness.mapper.set_options(RandomOptions(&random));
        break;
      default:
        break;
    }
  }
  harness.mapper.Flush();
  harness.said.emplace_back("flushed");
  return harness.said;
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

/// A mapper whose outputs fail.
struct FailingMapper {
  explicit FailingMapper(const DenseMapperOptions& options) : harness(options, &output_engine) {}

  FailingHostEngine output_engine;
  MapperHarness harness;
};

TEST(DenseMapperOutputsTest, AFailedConsistencyCheckDropsThatKeyframeOnly) {
  DenseMapperOptions options = FakeOptions(8, 3);
  options.refine_again = true;
  FailingMapper failing(options);
  failing.output_engine.fails_consistency_of = 2;
  for (int id = 0; id < 8; ++id) failing.harness.mapper.AddKeyframe(WallFrame(id));
  failing.harness.mapper.Flush();
  const auto& said = failing.harness.said;
  EXPECT_THAT(said, Contains("drop 2 processing_error had fast: no memory for points"));
  EXPECT_THAT(said, Not(Contains(HasSubstr("refined 2 "))));
  EXPECT_THAT(said, Not(Contains(HasSubstr("again 2 "))));
  for (const int id : {0, 1, 3, 4, 5, 6, 7}) EXPECT_THAT(said, Contains(HasSubstr(Concat("refined ", id, " "))));
  // Its refined estimate is whole: others read it.
  const WallEngine::Call call = CallsOf(failing.harness.engine, "geometric", 4)[0];
  for (size_t i = 0; i < call.sources.size(); ++i) {
    if (call.sources[i] == 2) {
      EXPECT_FLOAT_EQ(call.source_depths[i], kRefinedDepth);
    }
  }
}

TEST(DenseMapperOutputsTest, ADroppedKeyframeGetsNoBetterMaps) {
  FailingMapper failing(RefiningAgain(10));
  failing.output_engine.fails_consistency_of = 1;
  for (int id = 0; id < 5; ++id)
    failing.harness.mapper.AddKeyframe(WallFrame(id, id < 3 ? 0.08 * id : 0.35 * (id - 2)));
  failing.harness.mapper.Flush();
  EXPECT_THAT(failing.harness.said, Contains(HasSubstr("again 0 "))) << "or the test shows nothing";
  EXPECT_THAT(failing.harness.said, Not(Contains(HasSubstr("refine_again_failed"))));
}

TEST(DenseMapperOutputsTest, MissingFastMapsAreAProblemAndTheRefinedOnesCome) {
  FailingMapper failing(FakeOptions(8, 3));
  failing.output_engine.fails_download = 1;
  for (int id = 0; id < 3; ++id) failing.harness.mapper.AddKeyframe(WallFrame(id));
  failing.harness.mapper.WaitForOutputs();
  EXPECT_THAT(failing.harness.said, Contains("problem fast_maps_failed: keyframe 0 has no fast maps: device lost"));
  EXPECT_THAT(failing.harness.said, Not(Contains(HasSubstr("fast 0 "))));
  failing.harness.mapper.Flush();
  EXPECT_THAT(failing.harness.said, Contains(HasSubstr("refined 0 ")));
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

TEST(OutputQueueTest, WaitsForAllJobsAlsoWhereSomeThrow) {
  std::atomic<int> done{0};
  OutputQueue queue(true);
  queue.Submit([] { throw ProcessingError("first"); });
  queue.Submit([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    ++done;
    throw ProcessingError("second");
  });
  queue.Submit([&] { ++done; });
  try {
    queue.WaitForAll();
    ADD_FAILURE() << "nothing was thrown";
  } catch (const ProcessingError& error) {
    EXPECT_STREQ(error.what(), "first");
  }
  EXPECT_EQ(done, 2);
  EXPECT_NO_THROW(queue.WaitForAll());
}

TEST(WarmUpTest, RunsAllPassesWithAllSourceViewsAndTheOutputs) {
  for (const char* preset : {"balanced", "online"}) {
    DenseMapperOptions options;
    options.pipeline = MakePreset(preset);
    options.max_source_views = 5;
    options.live = true;
    WallEngine engine, output_engine;
    std::vector<int64_t> checked;
    output_engine.before_consistency = [&](int64_t id) { checked.push_back(id); };
    StopRequest stop;
    WarmUp(&engine, options, &output_engine, &stop);
    for (const char* pass : {"photometric", "prior", "geometric"}) {
      EXPECT_TRUE(
          std::any_of(engine.calls.begin(), engine.calls.end(),
                      [&](const WallEngine::Call& call) { return call.pass == pass && call.sources.size() == 5; }))
          << preset << ": " << pass;
    }
    EXPECT_THAT(checked, Not(IsEmpty())) << preset;
  }
}

}  // namespace
}  // namespace acmp
