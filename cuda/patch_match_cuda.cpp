#include "acmp_mapping/backend/patch_match_cuda.h"

#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "pass_runner.h"

namespace acmp {
namespace {

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

/// One pass at a time with everything from and to host memory: for comparison with the CPU. The pipeline uses the
/// engine, which leaves on the device what the next pass reads.
class PatchMatchCuda final : public PatchMatch {
 public:
  explicit PatchMatchCuda(int index) : runner_(std::make_shared<CudaDevice>(index)) {}

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

  Image<float> MeasureEvidence(const PatchMatchProblem& problem, const PlaneMap& planes, int cell_size) override {
    Check(problem);
    CheckEvidenceInput(problem, planes, cell_size);
    return OnDevice([&] {
      begin_.Record(runner_.stream());
      Loaded loaded;
      Load(problem, nullptr, {}, &loaded);
      loaded.planes.Upload(planes.data(), planes.size(), runner_.stream());
      Image<float> evidence(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
      DeviceArray<float> cells(runner_.device(), evidence.size());
      const std::shared_lock<std::shared_mutex> images(runner_.device()->images_mutex());
      const CudaMatchContext context = runner_.Prepare(problem, {}, loaded.data, Pass::kGeometric, 0);
      uploaded_.Record(runner_.stream());
      runner_.QueueEvidence(context, cell_size, {cells.data(), evidence.width(), evidence.height(), evidence.width()});
      computed_.Record(runner_.stream());
      cells.Download(evidence.data(), evidence.size(), runner_.stream());
      FinishTiming();
      return evidence;
    });
  }

  PatchMatchTiming last_timing() const override { return timing_; }
  std::string device_name() const override {
    return Concat(runner_.device()->properties().name, " (cuda:", runner_.device()->index(), ")");
  }

 private:
  /// What belongs to one run; kept for its duration.
  struct Loaded {
    std::vector<std::unique_ptr<ImageLayer>> layers;
    std::vector<DeviceArray<uint16_t>> halved_depths;
    std::vector<DeviceArray<float>> full_depths;
    DeviceArray<PlaneHypothesis> planes, prior;
    DeviceArray<float> cost;
    DeviceArray<uint32_t> selected_views;
    PassData data;
  };

  template <Pass kPass>
  PatchMatchResult Run(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                       const PatchMatchResult* start, ImageView<const PlaneHypothesis> prior, int geometric_pass,
                       int iterations) {
    Validate(options);
    return OnDevice([&] {
      begin_.Record(runner_.stream());
      Loaded loaded;
      Load(problem, start, prior, &loaded);
      const std::shared_lock<std::shared_mutex> images(runner_.device()->images_mutex());
      const CudaMatchContext context = runner_.Prepare(problem, options, loaded.data, kPass, geometric_pass);
      uploaded_.Record(runner_.stream());
      runner_.Queue<kPass>(context, iterations);
      computed_.Record(runner_.stream());
      return Download(problem.reference.camera, loaded);
    });
  }

  template <class Work>
  auto OnDevice(const Work& work) -> decltype(work()) {
    runner_.device()->MakeCurrent();  // the calling thread may be another one than before
    try {
      return work();
    } catch (...) {
      cudaStreamSynchronize(runner_.stream().get());  // queued copies must not outlive the host memory they use
      cudaGetLastError();
      throw;
    }
  }

  void Load(const PatchMatchProblem& problem, const PatchMatchResult* start, ImageView<const PlaneHypothesis> prior,
            Loaded* loaded) {
    const CudaDevicePtr& device = runner_.device();
    const size_t pixels = static_cast<size_t>(problem.reference.camera.width) * problem.reference.camera.height;
    PassData& data = loaded->data;
    data.reference_layer = LoadImage(problem.reference.gray, loaded);
    for (const MatchView& source : problem.sources) {
      data.source_layers.push_back(LoadImage(source.gray, loaded));
      data.source_depths.push_back(LoadHalvedDepth(source.depth, loaded));
      data.full_depths.push_back(LoadFullDepth(source.depth, loaded));
    }
    loaded->planes = DeviceArray<PlaneHypothesis>(device, pixels);
    loaded->cost = DeviceArray<float>(device, pixels);
    loaded->selected_views = DeviceArray<uint32_t>(device, pixels);
    data.planes = loaded->planes.data();
    data.cost = loaded->cost.data();
    data.selected_views = loaded->selected_views.data();
    if (start != nullptr) {
      loaded->planes.Upload(start->planes.data(), pixels, runner_.stream());
      loaded->cost.Upload(start->cost.data(), pixels, runner_.stream());
    }
    if (prior.data == nullptr) return;
    loaded->prior = DeviceArray<PlaneHypothesis>(device, pixels);
    data.prior.planes = {loaded->prior.data(), prior.width, prior.height, prior.width};
    std::vector<PlaneHypothesis> storage;
    loaded->prior.Upload(Contiguous(prior, &storage), pixels, runner_.stream());
    runner_.stream().Synchronize();
  }

  int LoadImage(const ImageView<const float>& gray, Loaded* loaded) {
    const CudaDevicePtr& device = runner_.device();
    loaded->layers.push_back(std::make_unique<ImageLayer>(device, 0, gray.width, gray.height, runner_.stream()));
    const int layer = loaded->layers.back()->layer();
    device->images(0).Upload(gray, layer, &staging_, runner_.stream());
    return layer;
  }

  HalvedDepth LoadHalvedDepth(const ImageView<const float>& depth, Loaded* loaded) {
    if (depth.empty()) return {};
    const HalvedDepthMap halved = HalveDepth(depth);
    const Image<uint16_t>& inverse = halved.inverse;
    loaded->halved_depths.emplace_back(runner_.device(), inverse.size());
    loaded->halved_depths.back().Upload(inverse.data(), inverse.size(), runner_.stream());
    runner_.stream().Synchronize();
    return {{loaded->halved_depths.back().data(), inverse.width(), inverse.height(), inverse.width()}, halved.step};
  }

  ImageView<const float> LoadFullDepth(const ImageView<const float>& depth, Loaded* loaded) {
    if (depth.empty()) return {};
    const size_t pixels = static_cast<size_t>(depth.width) * depth.height;
    std::vector<float> storage;
    loaded->full_depths.emplace_back(runner_.device(), pixels);
    loaded->full_depths.back().Upload(Contiguous(depth, &storage), pixels, runner_.stream());
    runner_.stream().Synchronize();
    return {loaded->full_depths.back().data(), depth.width, depth.height, depth.width};
  }

  PatchMatchResult Download(const PinholeCamera& camera, const Loaded& loaded) {
    PatchMatchResult result = {PlaneMap(camera.width, camera.height), CostMap(camera.width, camera.height),
                               Image<uint32_t>(camera.width, camera.height)};
    const size_t pixels = result.planes.size();
    loaded.planes.Download(result.planes.data(), pixels, runner_.stream());
    loaded.cost.Download(result.cost.data(), pixels, runner_.stream());
    loaded.selected_views.Download(result.selected_views.data(), pixels, runner_.stream());
    FinishTiming();
    return result;
  }

  /// Once everything is queued: waits for it.
  void FinishTiming() {
    end_.Record(runner_.stream());
    runner_.stream().Synchronize();
    timing_ = {CudaEvent::ElapsedMs(begin_, uploaded_), CudaEvent::ElapsedMs(uploaded_, computed_),
               CudaEvent::ElapsedMs(computed_, end_)};
  }

  PassRunner runner_;
  CudaEvent begin_, uploaded_, computed_, end_;
  PinnedBuffer staging_;
  PatchMatchTiming timing_;
};

}  // namespace

std::unique_ptr<PatchMatch> MakePatchMatchCuda(int cuda_index) { return std::make_unique<PatchMatchCuda>(cuda_index); }

}  // namespace acmp
