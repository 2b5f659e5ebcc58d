#include "acmp_mapping/backend/patch_match_cuda.h"

#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "cuda_device.h"
#include "cuda_resources.h"
#include "patch_match_kernels.h"

namespace acmp {
namespace {

/// The maps of the reference view on the device.
struct DeviceState {
  DeviceBuffer<PlaneHypothesis> planes, prior;
  DeviceBuffer<float> cost, gray;
  DeviceBuffer<uint32_t> selected_views;

  void Resize(size_t pixels, bool with_prior) {
    planes.Resize(pixels);
    cost.Resize(pixels);
    gray.Resize(pixels);
    selected_views.Resize(pixels);
    if (with_prior) prior.Resize(pixels);
  }
};

/// Rows of a view as one block, copied only if they are padded.
template <class T>
const T* Contiguous(const ImageView<const T>& image, std::vector<T>* storage) {
  if (image.stride == image.width) return image.data;
  storage->clear();
  storage->reserve(static_cast<size_t>(image.width) * image.height);
  for (int row = 0; row < image.height; ++row) {
    storage->insert(storage->end(), &image(0, row), &image(0, row) + image.width);
  }
  return storage->data();
}

class PatchMatchCuda final : public PatchMatch {
 public:
  explicit PatchMatchCuda(int index) : index_(index), properties_(SelectDevice(index)) {}

  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options) override {
    Check(problem);
    return Run<Pass::kPhotometric>(problem, options, nullptr, {}, 0, options.photometric_iterations);
  }

  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) override {
    Check(problem);
    CheckStart(problem, start);
    CheckPrior(problem, prior);
    return Run<Pass::kPlanarPrior>(problem, options, &start, prior, 0, options.planar_prior_iterations);
  }

  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                const PatchMatchResult& start, int pass) override {
    Check(problem);
    CheckStart(problem, start);
    return Run<Pass::kGeometric>(problem, options, &start, {}, pass, options.geometric_iterations);
  }

  PatchMatchTiming last_timing() const override { return timing_; }
  std::string device_name() const override { return Concat(properties_.name, " (cuda:", index_, ")"); }

 private:
  template <Pass kPass>
  PatchMatchResult Run(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                       const PatchMatchResult* start, ImageView<const PlaneHypothesis> prior, int geometric_pass,
                       int iterations) {
    Validate(options);
    CudaCheck(cudaSetDevice(index_), "select device");  // the calling thread may be another one than before
    try {
      return RunOnDevice<kPass>(problem, options, start, prior, geometric_pass, iterations);
    } catch (...) {
      cudaStreamSynchronize(stream_.get());  // queued copies must not outlive the host memory they use
      cudaGetLastError();
      throw;
    }
  }

  template <Pass kPass>
  PatchMatchResult RunOnDevice(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                               const PatchMatchResult* start, ImageView<const PlaneHypothesis> prior,
                               int geometric_pass, int iterations) {
    begin_.Record(stream_);
    CudaMatchContext context = MakeMatchContext<TextureSampler>(problem, options, PassNumber(kPass, geometric_pass));
    UploadSources(problem, &context);
    UploadReference(problem, start, prior, &context);
    uploaded_.Record(stream_);
    LaunchPass<kPass>(context, iterations, stream_.get());
    computed_.Record(stream_);
    PatchMatchResult result = Download(problem.reference.camera);
    timing_ = {CudaEvent::ElapsedMs(begin_, uploaded_), CudaEvent::ElapsedMs(uploaded_, computed_),
               CudaEvent::ElapsedMs(computed_, end_)};
    return result;
  }

  void UploadSources(const PatchMatchProblem& problem, CudaMatchContext* context) {
    const size_t count = problem.sources.size();
    while (source_depths_.size() < count) source_depths_.push_back(std::make_unique<DeviceBuffer<float>>());
    host_views_ = MakeSourceViews(problem);
    std::vector<ImageView<const float>> images;
    images.reserve(count);
    for (size_t i = 0; i < count; ++i) {
      const MatchView& source = problem.sources[i];
      images.push_back(source.gray);
      if (source.depth.empty()) continue;
      std::vector<float> storage;
      DeviceBuffer<float>& depth = *source_depths_[i];
      depth.Resize(static_cast<size_t>(source.depth.width) * source.depth.height);
      depth.Upload(Contiguous(source.depth, &storage), stream_);
      if (!storage.empty()) stream_.Synchronize();
      host_views_[i].depth = {depth.data(), source.depth.width, source.depth.height, source.depth.width};
    }
    views_.Resize(count);
    views_.Upload(host_views_.data(), stream_);
    source_images_.Upload(images, stream_);
    context->sources = views_.data();
    context->sampler.sources = source_images_.get();
  }

  void UploadReference(const PatchMatchProblem& problem, const PatchMatchResult* start,
                       ImageView<const PlaneHypothesis> prior, CudaMatchContext* context) {
    const int width = problem.reference.camera.width, height = problem.reference.camera.height;
    state_.Resize(static_cast<size_t>(width) * height, prior.data != nullptr);
    std::vector<float> storage;
    state_.gray.Upload(Contiguous(problem.reference.gray, &storage), stream_);
    if (!storage.empty()) stream_.Synchronize();
    if (start != nullptr) {
      state_.planes.Upload(start->planes.data(), stream_);
      state_.cost.Upload(start->cost.data(), stream_);
    }
    if (prior.data != nullptr) {
      std::vector<PlaneHypothesis> prior_storage;
      state_.prior.Upload(Contiguous(prior, &prior_storage), stream_);
      if (!prior_storage.empty()) stream_.Synchronize();
      context->prior = {state_.prior.data(), width, height, width};
    }
    context->sampler.reference = {state_.gray.data(), width, height, width};
    context->planes = {state_.planes.data(), width, height, width};
    context->cost = {state_.cost.data(), width, height, width};
    context->selected_views = {state_.selected_views.data(), width, height, width};
  }

  /// The pass's one synchronisation is after the copies back.
  PatchMatchResult Download(const PinholeCamera& camera) {
    PatchMatchResult result = {PlaneMap(camera.width, camera.height), CostMap(camera.width, camera.height),
                               Image<uint32_t>(camera.width, camera.height)};
    state_.planes.Download(result.planes.data(), stream_);
    state_.cost.Download(result.cost.data(), stream_);
    state_.selected_views.Download(result.selected_views.data(), stream_);
    end_.Record(stream_);
    stream_.Synchronize();
    return result;
  }

  const int index_;
  const cudaDeviceProp properties_;
  CudaStream stream_;
  CudaEvent begin_, uploaded_, computed_, end_;
  std::vector<std::unique_ptr<DeviceBuffer<float>>> source_depths_;  ///< grows to the most source views seen
  std::vector<SourceView> host_views_;                               ///< staging, alive until the synchronisation
  DeviceBuffer<SourceView> views_;
  DeviceTexture source_images_;
  DeviceState state_;
  PatchMatchTiming timing_;
};

}  // namespace

std::unique_ptr<PatchMatch> MakePatchMatchCuda(int cuda_index) { return std::make_unique<PatchMatchCuda>(cuda_index); }

}  // namespace acmp
