#include "pass_runner.h"

#include <algorithm>

namespace acmp {

ImageLayer::ImageLayer(CudaDevicePtr device, int level, int width, int height, const CudaStream& stream)
    : device_(std::move(device)),
      level_(level),
      layer_(device_->images(level).Acquire(width, height, stream, &device_->images_mutex())) {}

ImageLayer::~ImageLayer() { device_->images(level_).Release(layer_); }

CudaMatchContext PassRunner::Prepare(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                     const PassData& data, Pass kind, int geometric_pass) {
  const int width = problem.reference.camera.width, height = problem.reference.camera.height;
  const size_t count = problem.sources.size();
  views_.Reserve(device_, kMaxSourceViews);

  std::vector<SourceView> views = MakeSourceViews(problem);
  for (size_t i = 0; i < count; ++i) {
    if (i < data.source_depths.size()) views[i].depth = data.source_depths[i];
  }
  SourceView* staged = host_views_.Reserve<SourceView>(kMaxSourceViews);
  std::copy(views.begin(), views.end(), staged);
  views_.Upload(staged, count, stream_);
  full_depths_.Reserve(device_, kMaxSourceViews);
  auto* staged_depths = host_full_depths_.Reserve<ImageView<const float>>(kMaxSourceViews);
  std::copy(data.full_depths.begin(), data.full_depths.end(), staged_depths);
  if (!data.full_depths.empty()) full_depths_.Upload(staged_depths, count, stream_);

  CudaMatchContext context = MakeMatchContext<TextureSampler>(problem, options, kind, geometric_pass);
  context.sampler.images = device_->images(data.level).texture();
  context.sampler.reference = data.reference_layer;
  std::copy(data.source_layers.begin(), data.source_layers.end(), context.sampler.layers);
  context.sources = views_.data();
  context.full_depths = full_depths_.data();
  context.planes = {data.planes, width, height, width};
  context.cost = {data.cost, width, height, width};
  context.selected_views = {data.selected_views, width, height, width};
  context.prior = data.prior;
  return context;
}

}  // namespace acmp
