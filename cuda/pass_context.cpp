#include "pass_context.h"

#include <algorithm>
#include <vector>

#include "cuda_image.h"

namespace acmp {

CudaMatchContext PassContext::Prepare(const EngineProblem& problem, const PatchMatchProblem& match, int level,
                                      const PatchMatchOptions& options, Pass kind, int geometric_pass,
                                      CudaEstimate* estimate) {
  const CudaDevicePtr& device = queue_.device();
  const size_t count = problem.sources.size();
  views_.Reserve(device, kMaxSourceViews);
  full_depths_.Reserve(device, kMaxSourceViews);
  SourceView* views = host_views_.Reserve<SourceView>(kMaxSourceViews);
  auto* full_depths = host_full_depths_.Reserve<ImageView<const float>>(kMaxSourceViews);
  const std::vector<SourceView> projections = MakeSourceViews(match);
  std::copy(projections.begin(), projections.end(), views);
  if (kind == Pass::kGeometric) {
    AddDepths(problem, match, options.method, views, full_depths);
    if (options.method != Method::kOurs) full_depths_.Upload(full_depths, count, queue_.stream());
  }
  views_.Upload(views, count, queue_.stream());

  CudaMatchContext context = MakeMatchContext<TextureSampler>(match, options, kind, geometric_pass);
  context.sampler.images = device->images(level).texture();
  context.sampler.reference = queue_.Cast<CudaImage>(problem.reference.image).Layer(level);
  for (size_t i = 0; i < count; ++i) {
    context.sampler.layers[i] = queue_.Cast<CudaImage>(problem.sources[i].image).Layer(level);
  }
  context.sources = views_.data();
  context.full_depths = full_depths_.data();
  context.planes = estimate->PlaneView();
  context.cost = estimate->CostView();
  context.selected_views = estimate->NumbersView();
  AddMasks(problem, level, &context);
  return context;
}

void PassContext::AddMasks(const EngineProblem& problem, int level, CudaMatchContext* context) {
  context->clearance = queue_.Cast<CudaImage>(problem.reference.image).Clearance(level);
  auto* clearances = host_clearances_.Reserve<ImageView<const unsigned char>>(kMaxSourceViews);
  bool has_masks = false;
  for (size_t i = 0; i < problem.sources.size(); ++i) {
    clearances[i] = queue_.Cast<CudaImage>(problem.sources[i].image).Clearance(level);
    has_masks |= !clearances[i].empty();
  }
  if (!has_masks) return;
  clearances_.Reserve(queue_.device(), kMaxSourceViews);
  clearances_.Upload(clearances, problem.sources.size(), queue_.stream());
  context->source_clearances = clearances_.data();
}

void PassContext::AddDepths(const EngineProblem& problem, const PatchMatchProblem& match, Method method,
                            SourceView* views, ImageView<const float>* full_depths) {
  for (size_t i = 0; i < problem.sources.size(); ++i) {
    full_depths[i] = {};
    const EngineEstimatePtr& handle = problem.sources[i].estimate;
    if (!handle) continue;
    const CudaEstimate& estimate = queue_.Cast<CudaEstimate>(handle);
    CheckSize("estimate of a source view", estimate.width, estimate.height, match.sources[i].camera);
    if (method == Method::kOurs) {
      views[i].depth = halved_.Of(estimate);
    } else {
      full_depths[i] = estimate.DepthView();
    }
  }
}

}  // namespace acmp
