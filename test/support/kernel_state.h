#pragma once

#include <vector>

#include "acmp_mapping/patch_match/kernel/window.h"
#include "acmp_mapping/patch_match/match_setup.h"

namespace acmp {

/// Owns all that a kernel context points to, to call single kernel functions on a problem. The problem's pixels belong
/// to the caller.
class KernelState {
 public:
  explicit KernelState(PatchMatchProblem problem, const PatchMatchOptions& options = {})
      : problem_(std::move(problem)),
        options_(options),
        depths_(HalveDepths(problem_)),
        views_(MakeSourceViews(problem_)),
        planes(problem_.reference.camera.width, problem_.reference.camera.height),
        cost(problem_.reference.camera.width, problem_.reference.camera.height),
        selected_views(problem_.reference.camera.width, problem_.reference.camera.height),
        prior_numbers(problem_.reference.camera.width, problem_.reference.camera.height) {
    for (size_t i = 0; i < views_.size(); ++i) {
      images_.push_back(problem_.sources[i].gray);
      full_depths_.push_back(problem_.sources[i].depth);
      mask_distances_.push_back(problem_.sources[i].mask_distance);
      views_[i].depth = depths_[i].View();
    }
  }

  /// Reads and writes this object's maps.
  MatchContext<BilinearSampler> Context(uint32_t pass_number = 0) {
    MatchContext<BilinearSampler> context = ContextWith(BilinearSampler{problem_.reference.gray, images_.data()});
    context.pass_number = pass_number;
    return context;
  }

  template <class Sampler>
  MatchContext<Sampler> ContextWith(const Sampler& sampler) {
    MatchContext<Sampler> context = MakeMatchContext<Sampler>(problem_, options_, Pass::kPhotometric, 0);
    context.sampler = sampler;
    context.sources = views_.data();
    context.full_depths = full_depths_.data();
    context.mask_distance = problem_.reference.mask_distance;
    context.source_mask_distances = mask_distances_.data();
    context.planes = planes.View();
    context.cost = cost.View();
    context.selected_views = selected_views.View();
    context.prior = Prior();
    return context;
  }

  PriorMap Prior() const { return {prior_planes.data(), prior_numbers.View()}; }
  const PatchMatchProblem& problem() const { return problem_; }
  const PatchMatchOptions& options() const { return options_; }
  int width() const { return problem_.reference.camera.width; }
  int height() const { return problem_.reference.camera.height; }

 private:
  PatchMatchProblem problem_;
  PatchMatchOptions options_;
  std::vector<HalvedDepthMap> depths_;
  std::vector<SourceView> views_;
  std::vector<ImageView<const float>> images_, full_depths_;
  std::vector<ImageView<const unsigned char>> mask_distances_;

 public:
  PlaneMap planes;
  CostMap cost;
  Image<uint32_t> selected_views;
  std::vector<PlaneHypothesis> prior_planes;
  Image<uint32_t> prior_numbers;
};

}  // namespace acmp
