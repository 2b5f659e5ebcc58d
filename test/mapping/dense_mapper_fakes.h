#pragma once

#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "support/fake_engine.h"

namespace acmp {

/// Every frame looks along world z at a wall at z = kWallDepth; the depth of a camera at height 0 is the same
/// everywhere.
constexpr double kWallDepth = 4.0;
const PinholeCamera kWallCamera = {24, 18, 20, 20, 11.5, 8.5};

inline std::vector<Eigen::Vector3d> WallLandmarks() {
  std::vector<Eigen::Vector3d> points;
  for (int col = -20; col <= 60; ++col) {
    for (int row = -4; row <= 4; ++row) points.emplace_back(0.4 * col, 0.4 * row, kWallDepth);
  }
  return points;
}

/// A camera at x.
inline Frame MakeWallFrame(int64_t id, double x, std::vector<Eigen::Vector3d> landmarks = WallLandmarks()) {
  Frame frame;
  frame.id = id;
  frame.stamp_s = 0.1 * static_cast<double>(id);
  frame.camera = kWallCamera;
  frame.cam_from_world.translation().x() = -x;
  frame.gray = GrayImage(kWallCamera.width, kWallCamera.height);
  frame.color = ColorImage(kWallCamera.width, kWallCamera.height);
  frame.landmarks_in_world = std::move(landmarks);
  return frame;
}

inline FramePtr WallFrame(int64_t id, double x, std::vector<Eigen::Vector3d> landmarks = WallLandmarks()) {
  return std::make_shared<Frame>(MakeWallFrame(id, x, std::move(landmarks)));
}

/// 0.35 units to the side per id: 5 degrees at the wall.
inline FramePtr WallFrame(int64_t id) { return WallFrame(id, 0.35 * static_cast<double>(id)); }

/// Answers with the wall's plane, `kFastError` too far before the geometric passes and exact after them, and remembers
/// what it was asked.
class WallEngine : public FakeEngine {
 public:
  static constexpr double kFastError = 1.002;  // within the 1 % that the consistency check allows

  struct Call {
    std::string pass;  ///< "photometric", "prior" or "geometric"
    int64_t reference = 0;
    std::vector<int64_t> sources;
    std::vector<float> source_depths;  ///< at the first pixel; -1 where there is no map
    int geometric_pass = -1;
    int width = 0;  ///< of the reference, px
    float start_depth = 0;
    DepthRange range;
  };

  std::vector<Call> calls;
  float fast_depth = static_cast<float>(kWallDepth * kFastError);  ///< before the geometric passes
  std::function<void(const Call&)> before_answer;                  ///< may throw
  std::function<float(const Call&)> depth_of_answer;               ///< in place of all that
  std::function<void(int64_t id)> before_consistency;              ///< the check of a keyframe's maps; may throw

  ConsistencyResult FilterByConsistency(const EngineView& reference, const std::vector<EngineView>& sources,
                                        const FusionOptions& options) override {
    if (before_consistency) before_consistency(reference.frame->id);
    return FakeEngine::FilterByConsistency(reference, sources, options);
  }

 protected:
  EstimateState Answer(const PassRequest& request) override {
    Call call;
    call.pass = request.pass == Pass::kPhotometric   ? "photometric"
                : request.pass == Pass::kPlanarPrior ? "prior"
                                                     : "geometric";
    call.reference = request.reference();
    for (const EngineView& source : request.problem.sources) {
      const DepthMap depth = SourceDepth(request, source);
      call.sources.push_back(source.frame->id);
      call.source_depths.push_back(depth.empty() ? -1.0f : depth(0, 0));
    }
    call.geometric_pass = request.geometric_pass;
    call.range = request.problem.depth_range;
    call.width = request.camera().width;
    if (request.start) call.start_depth = DownloadDepth(request.start)(0, 0);
    calls.push_back(call);
    if (before_answer) before_answer(call);
    const float depth = depth_of_answer                    ? depth_of_answer(call)
                        : request.pass == Pass::kGeometric ? static_cast<float>(kWallDepth)
                                                           : fast_depth;
    return UniformState(request.camera(), {0, 0, -1, depth}, 0.05f);
  }
};

constexpr float kFastDepth = static_cast<float>(kWallDepth * WallEngine::kFastError);
constexpr float kRefinedDepth = static_cast<float>(kWallDepth);

/// A mapper over the fake that notes every callback as "fast 3", "refined 3" or "drop 3 reason".
class MapperHarness {
 public:
  /// @param output_engine as the mapper's, which has a thread for outputs then
  explicit MapperHarness(const DenseMapperOptions& options, DepthEngine* output_engine = nullptr)
      : has_thread(output_engine != nullptr), mapper(&engine, options, MakeCallbacks(), output_engine, &stop) {}

  /// What was called since the last time this was asked.
  std::vector<std::string> TakeEvents() { return std::exchange(events, {}); }

  std::vector<std::string> Add(FramePtr frame) {
    mapper.AddKeyframe(std::move(frame));
    return TakeEvents();
  }
  /// A capture of one companion without a keyframe.
  void AddSourceImage(FramePtr frame) { mapper.AddCapture({{}, {std::move(frame)}}); }
  std::vector<std::string> Flush() {
    mapper.Flush();
    return TakeEvents();
  }
  std::vector<std::string> Reset() {
    mapper.Reset();
    return TakeEvents();
  }

  WallEngine engine;
  std::vector<std::string> events;
  std::vector<std::string> said;  ///< all callbacks with what they said of maps and messages
  std::vector<KeyframeDepthPtr> fast;
  std::vector<KeyframeDepthPtr> refined;
  std::vector<KeyframeDrop> drops;
  std::vector<std::string> problems;
  std::vector<int64_t> refined_again;
  std::vector<std::pair<int64_t, std::string>> withdrawn;  ///< id, message
  StageTimes last_times;                                   ///< of the last of these
  bool keep_maps = true;
  StopRequest stop;
  const bool has_thread;
  DenseMapper mapper;

 private:
  /// In which thread it was called, too.
  void Say(std::string text) {
    EXPECT_NE(std::this_thread::get_id() == giver_, has_thread) << text;
    said.push_back(std::move(text));
  }
  void Say(const char* kind, const KeyframeDepth& maps) {
    std::string text = Concat(kind, " ", maps.frame->id, " ", maps.depth(0, 0), " ", maps.points_in_camera.size());
    if (!maps.confidence.empty()) text += Concat(" ", maps.confidence(0, 0));
    for (const int64_t id : maps.source_ids) text += Concat(" ", id);
    Say(text);
  }

  DenseMapper::Callbacks MakeCallbacks() {
    DenseMapper::Callbacks callbacks;
    callbacks.on_fast = [this](const KeyframeDepthPtr& depth) {
      events.push_back(Concat("fast ", depth->frame->id));
      Say("fast", *depth);
      if (keep_maps) fast.push_back(depth);
    };
    callbacks.on_refined = [this](const KeyframeDepthPtr& depth) {
      events.push_back(Concat("refined ", depth->frame->id));
      Say("refined", *depth);
      if (keep_maps) refined.push_back(depth);
    };
    callbacks.on_refined_again = [this](const KeyframeDepthPtr& depth) {
      refined_again.push_back(depth->frame->id);
      Say("again", *depth);
      last_times = depth->times;
    };
    callbacks.on_withdrawn = [this](const KeyframeDepthPtr& maps, const std::string& message) {
      EXPECT_TRUE(maps->depth.empty());
      events.push_back(Concat("withdrawn ", maps->frame->id));
      withdrawn.emplace_back(maps->frame->id, message);
    };
    callbacks.on_drop = [this](const KeyframeDrop& drop) {
      events.push_back(Concat("drop ", drop.frame->id, " ", drop.reason));
      Say(Concat(events.back(), drop.had_fast ? " had fast: " : ": ", drop.message));
      drops.push_back(drop);
      if (!keep_maps) drops.back().frame.reset();
    };
    callbacks.on_problem = [this](const std::string& reason, const std::string& message) {
      problems.push_back(reason + ": " + message);
      Say("problem " + problems.back());
    };
    return callbacks;
  }

  const std::thread::id giver_ = std::this_thread::get_id();
};

/// Each keyframe is refined once. Without the planar prior: the fake's answer does not depend on it.
inline DenseMapperOptions FakeOptions(int window_size, int lookahead, int min_source_views = 2) {
  DenseMapperOptions options;
  options.pipeline = MakePreset("acmh");
  options.pipeline.geometric_passes = 2;
  options.window_size = window_size;
  options.lookahead = lookahead;
  options.min_source_views = min_source_views;
  options.refine_again = false;
  return options;
}

inline DenseMapperOptions RefiningAgain(int window_size) {
  DenseMapperOptions options = FakeOptions(window_size, 1);
  options.refine_again = true;
  return options;
}

/// 0, 1 and 2 are poor views of each other, 3 and 4 good ones of all.
inline void AddPoorStartAndGoodViews(MapperHarness* harness) {
  for (int id = 0; id < 3; ++id) harness->Add(WallFrame(id, 0.08 * id));
  for (int id = 3; id < 5; ++id) harness->Add(WallFrame(id, 0.35 * (id - 2)));
}

/// The calls of a pass on a keyframe.
inline std::vector<WallEngine::Call> CallsOf(const WallEngine& engine, const std::string& pass, int64_t id) {
  std::vector<WallEngine::Call> calls;
  for (const auto& call : engine.calls) {
    if (call.pass == pass && call.reference == id) calls.push_back(call);
  }
  return calls;
}

}  // namespace acmp
