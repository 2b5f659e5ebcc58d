#pragma once

#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"

namespace acmp {

/// A synthetic scene, with the ranges of depth that its landmarks tell.
struct RenderedScene {
  explicit RenderedScene(const SyntheticSceneOptions& options)
      : views(MakeSyntheticScene(options)), surface(SampleSyntheticSurface(views, 0.02f)) {
    for (SyntheticView& view : views) frames.push_back(std::make_shared<const Frame>(std::move(view.frame)));
    for (const FramePtr& frame : frames) {
      const auto range = DepthRangeFromLandmarks(frame->landmarks_in_world, frame->camera, frame->cam_from_world);
      if (!range) throw std::logic_error("a frame has too few landmarks");
      ranges.push_back(*range);
    }
  }

  std::vector<SyntheticView> views;  ///< without their frames
  PointCloud surface;
  std::vector<FramePtr> frames;
  std::vector<DepthRange> ranges;
};

inline std::vector<EngineView> LoadFrames(const std::vector<FramePtr>& frames, DepthEngine* engine,
                                          int levels = kMaxLevels) {
  std::vector<EngineView> views;
  for (const FramePtr& frame : frames) views.push_back({frame, engine->Load(frame, levels), nullptr});
  return views;
}

/// All views but one.
inline std::vector<EngineView> Others(std::vector<EngineView> views, size_t i) {
  views.erase(views.begin() + static_cast<ptrdiff_t>(i));
  return views;
}

/// One step of all views, each against all others as the step before has left them.
inline std::vector<EngineView> TakeStep(DepthEstimator* estimator, const KeyframeStep& step,
                                        const std::vector<EngineView>& before, const std::vector<DepthRange>& ranges) {
  std::vector<EngineView> views = before;
  for (size_t i = 0; i < views.size(); ++i) {
    views[i].estimate = estimator->Run(step, {before[i], Others(before, i), ranges[i]});
  }
  return views;
}

/// All steps of the estimator's schedule.
inline std::vector<EngineView> TakeAllSteps(DepthEstimator* estimator, std::vector<EngineView> views,
                                            const std::vector<DepthRange>& ranges) {
  for (const KeyframeStep& step : estimator->schedule()) views = TakeStep(estimator, step, views, ranges);
  return views;
}

}  // namespace acmp
