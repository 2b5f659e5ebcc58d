#include "keyframe_estimator.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "acmp_mapping/image/for_each_pixel.h"

namespace acmp {
namespace {

using Read = const EngineEstimatePtr& (WindowKeyframe::*)() const;

void ReadEstimates(const SourceViews& sources, Read estimate, EngineProblem* problem) {
  for (size_t i = 0; i < sources.keyframes.size(); ++i) {
    problem->sources[i].estimate = (*sources.keyframes[i].*estimate)();
  }
}

std::vector<MatchedView> MatchedViews(const EngineProblem& problem, const SourceViews& sources) {
  std::vector<MatchedView> views;
  const RigidTransform world_from_reference = problem.reference.cam_from_world().inverse();
  for (size_t i = 0; i < sources.keyframes.size(); ++i) {
    views.push_back({sources.keyframes[i], problem.sources[i].cam_from_world() * world_from_reference});
  }
  return views;
}

constexpr double kConfirmed_px = 1, kContradicted_px = 2;
constexpr double kMinShare = 0.5;  ///< of the pixels around, itself one of them

/// A view of the reference's own capture, with the depth that was matched for it.
struct InstantView {
  InstantView(const EngineView& of_reference, const EngineView& of_view, DepthMap of_its_pixels)
      : reference(of_reference.frame->camera),
        view(of_view.frame->camera),
        depth(std::move(of_its_pixels)),
        to_view(of_view.cam_from_world() * of_reference.cam_from_world().inverse()),
        back(to_view.inverse()) {}

  /// Forward-backward error of a depth, px; none where the view does not see the point or knows no depth there.
  std::optional<double> Error(const Eigen::Vector2d& pixel, double z) const {
    const Eigen::Vector3d point = to_view * reference.Unproject(pixel, z);
    if (!(point.z() > 0)) return std::nullopt;
    const Eigen::Vector2d there = view.Project(point);
    const auto col = std::lround(there.x()), row = std::lround(there.y());
    if (!(col >= 0 && row >= 0 && col < depth.width() && row < depth.height())) return std::nullopt;
    const double seen = depth(static_cast<int>(col), static_cast<int>(row));
    if (!(seen > 0)) return std::nullopt;
    const Eigen::Vector3d returned = back * view.Unproject(there, seen);
    if (!(returned.z() > 0)) return std::nullopt;
    return (reference.Project(returned) - pixel).norm();
  }

  const PinholeCamera &reference, &view;
  DepthMap depth;  ///< 0: unknown
  RigidTransform to_view, back;
};

/// What moves matches other captures where it is not: a thing that goes along with the camera looks farther away in all
/// of them alike. Its own capture shows it where it is. Pixels are taken for moved where a view of their own capture
/// confirms the depth that was matched with such views alone (forward-backward error below 1 px) and contradicts the
/// other one (above 2 px). Most around must be so: things are larger than what matching smears along outlines.
/// @param matched depth by all source views; 0: unknown
/// @param instant the same by the views of its own capture
/// @return of the reference's size: 1 where `instant` is to be taken
Image<unsigned char> FindMovedPixels(const std::vector<InstantView>& views, const DepthMap& matched,
                                     const DepthMap& instant) {
  const int width = matched.width(), height = matched.height();
  Image<unsigned char> differs(width, height, 0);
  ForEachPixel(width, height, [&](int col, int row) {
    const double all = matched(col, row), own = instant(col, row);
    if (!(all > 0 && own > 0)) return;
    const Eigen::Vector2d pixel(col, row);
    differs(col, row) = std::any_of(views.begin(), views.end(), [&](const InstantView& view) {
      const std::optional<double> of_own = view.Error(pixel, own), of_all = view.Error(pixel, all);
      return of_own && of_all && (*of_own < kConfirmed_px) && (*of_all > kContradicted_px);
    });
  });
  // Sums over rectangles from the first pixel on.
  Image<int> sums(width + 1, height + 1, 0);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      sums(col + 1, row + 1) = differs(col, row) + sums(col, row + 1) + sums(col + 1, row) - sums(col, row);
    }
  }
  const int reach = std::max(2, width / 64);
  Image<unsigned char> moved(width, height, 0);
  ForEachPixel(width, height, [&](int col, int row) {
    if (!(instant(col, row) > 0)) return;
    const int left = std::max(0, col - reach), right = std::min(width, col + reach + 1);
    const int top = std::max(0, row - reach), bottom = std::min(height, row + reach + 1);
    const int around = sums(right, bottom) - sums(left, bottom) - sums(right, top) + sums(left, top);
    moved(col, row) = around >= kMinShare * (right - left) * (bottom - top) ? 1 : 0;
  });
  return moved;
}

}  // namespace

EngineView KeyframeEstimator::MakeView(WindowKeyframe* keyframe) {
  const int levels = estimator_.options().start_level;
  if (!keyframe->image || keyframe->image_levels < levels) {
    keyframe->image = engine_->Load(keyframe->frame, levels);
    keyframe->image_levels = levels;
  }
  const std::optional<RefinedPlace> refined = keyframe->refined_place();
  return {keyframe->frame, keyframe->image, nullptr,
          refined ? std::optional<RigidTransform>(refined->cam_from_world) : std::nullopt};
}

void KeyframeEstimator::SetUp(KeyframeSteps* steps) {
  WindowKeyframe& keyframe = *steps->keyframe;
  EngineProblem problem;
  problem.reference = MakeView(&keyframe);
  for (const WindowKeyframePtr& source : steps->sources.keyframes) problem.sources.push_back(MakeView(source.get()));
  steps->refined = keyframe.refined_place();
  steps->pose_fit = keyframe.capture->fit;
  problem.depth_range = {keyframe.range.min / steps->scale(), keyframe.range.max / steps->scale()};
  steps->problem = std::move(problem);
}

void KeyframeEstimator::Initialise(KeyframeSteps* steps) {
  SetUp(steps);
  WindowKeyframe& keyframe = *steps->keyframe;
  keyframe.initial = estimator_.Run(estimator_.schedule().front(), steps->problem);
  keyframe.initial_score = steps->sources.score;
  keyframe.initial_views = MatchedViews(steps->problem, steps->sources);
  keyframe.times += estimator_.last_times();
  steps->problem.reference.estimate = keyframe.initial;
  steps->times = keyframe.times;
}

void KeyframeEstimator::Begin(KeyframeSteps* steps, bool lacks_future_views) {
  SetUp(steps);
  steps->problem.reference.estimate = steps->keyframe->initial;
  steps->lacks_future_views = lacks_future_views;
  steps->times = steps->keyframe->times;
}

void KeyframeEstimator::Step(size_t step, KeyframeSteps* steps) {
  EngineProblem problem = steps->problem;
  const KeyframeStep& kind = estimator_.schedule()[step];
  const bool is_last = kind.kind == KeyframeStep::Kind::kFillUnverified;
  if (is_last && steps->lacks_future_views) steps->after_passes = problem.reference.estimate;
  ReadEstimates(steps->sources, is_last ? &WindowKeyframe::EstimateAfterPasses : &WindowKeyframe::EstimateForPasses,
                &problem);
  steps->problem.reference.estimate.reset();  // a pass continues in memory that nobody else holds
  steps->problem.reference.estimate = estimator_.Run(kind, std::move(problem));
  steps->times += estimator_.last_times();
  steps->prior_depth_rejection = estimator_.prior_depth_rejection();
}

void KeyframeEstimator::KeepInstant(KeyframeSteps* steps) {
  const std::vector<WindowKeyframePtr>&of_capture = steps->sources.of_capture, &all = steps->sources.keyframes;
  if (of_capture.empty() || std::is_permutation(all.begin(), all.end(), of_capture.begin(), of_capture.end())) return;
  EngineProblem own = steps->problem;
  own.sources.clear();
  for (const WindowKeyframePtr& view : of_capture) own.sources.push_back(MakeView(view.get()));
  const EngineEstimatePtr matched = own.reference.estimate;
  own.reference.estimate.reset();
  const EngineEstimatePtr instant = estimator_.Run(estimator_.schedule().front(), own);
  steps->times += estimator_.last_times();
  std::vector<InstantView> views;
  for (size_t i = 0; i < own.sources.size(); ++i) {
    const EngineEstimatePtr& estimate = of_capture[i]->EstimateForPasses();
    if (estimate) views.emplace_back(own.reference, own.sources[i], engine_->DownloadDepth(estimate));
  }
  const Image<unsigned char> moved =
      FindMovedPixels(views, engine_->DownloadDepth(matched), engine_->DownloadDepth(instant));
  if (std::none_of(moved.begin(), moved.end(), [](unsigned char m) { return m != 0; })) return;
  EstimateState state = engine_->DownloadState(matched);
  const EstimateState of_instant = engine_->DownloadState(instant);
  for (size_t i = 0; i < moved.size(); ++i) {
    if (moved.data()[i] == 0) continue;
    state.planes.data()[i] = of_instant.planes.data()[i];
    state.cost.data()[i] = of_instant.cost.data()[i];
  }
  steps->problem.reference.estimate = engine_->UploadState(std::move(state), own.reference.frame->camera);
}

void KeyframeEstimator::Finish(KeyframeSteps* steps) {
  KeepInstant(steps);
  WindowKeyframe& keyframe = *steps->keyframe;
  ReadEstimates(steps->sources, &WindowKeyframe::EstimateAfterPasses, &steps->problem);
  // Without its future views other keyframes read the estimate before the last filling. Filled pixels confirm nothing:
  // where this keyframe is filled the others would be filled, too, and so on from keyframe to keyframe.
  keyframe.refined =
      steps->after_passes ? std::move(steps->after_passes) : EngineEstimatePtr(steps->problem.reference.estimate);
  keyframe.lacks_future_views = steps->lacks_future_views;
  keyframe.refined_score = steps->sources.score;
  keyframe.refined_views = MatchedViews(steps->problem, steps->sources);
  keyframe.times = StageTimes();
  if (!steps->lacks_future_views) keyframe.initial.reset();
}

}  // namespace acmp
