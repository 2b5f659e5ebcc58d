#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "acmp_mapping/patch_match/patch_match.h"
#include "acmp_mapping/patch_match/restore_details.h"
#include "acmp_mapping/patch_match/window_sums.h"

namespace acmp {
namespace {

using Context = MatchContext<CpuSampler>;

/// The pixels with (col + row) % 2 == color.
template <class Function>
void ForEachPixelOfColor(const Context& context, int color, const Function& function) {
  tbb::parallel_for(0, context.height, [&](int row) {
    for (int col = (row + color) % 2; col < context.width; col += 2) function(col, row);
  });
}

template <Pass kPass, Method kMethod>
void RunPass(const Context& context, int iterations) {
  ForEachPixelOfColor(context, 0, [&](int col, int row) {
    if constexpr (kMethod == Method::kOurs) {
      InitializeUnmatched<kPass>(context, col, row);
    } else {
      InitializePixel<kPass, kMethod>(context, col, row);
    }
  });
  ForEachPixelOfColor(context, 1, [&](int col, int row) { InitializePixel<kPass, kMethod>(context, col, row); });
  for (int iteration = 0; iteration < iterations; ++iteration) {
    for (int color = 0; color < 2; ++color) {
      ForEachPixelOfColor(context, color,
                          [&](int col, int row) { UpdatePixel<kPass, kMethod>(context, col, row, iteration); });
    }
  }
  if constexpr (kMethod == Method::kOurs) {
    for (int color = 0; color < 2; ++color) {
      ForEachPixelOfColor(context, color, [&](int col, int row) { MedianFilterPixel(context, col, row); });
    }
  }
}

/// What a context's sampler and sources point to, in host memory.
struct HostSources {
  HostSources(const PatchMatchProblem& problem, Method method) : views(MakeSourceViews(problem)) {
    if (method == Method::kOurs) depths = HalveDepths(problem);
    for (size_t i = 0; i < depths.size(); ++i) views[i].depth = depths[i].View();
    images.reserve(views.size());
    full_depths.reserve(views.size());
    for (const MatchView& source : problem.sources) {
      images.push_back(source.gray);
      full_depths.push_back(source.depth);
    }
  }

  void SetUp(const PatchMatchProblem& problem, Context* context) const {
    context->sampler = {{problem.reference.gray, images.data()}, SupportedWindowFunctions().back()};
    context->sources = views.data();
    context->full_depths = full_depths.data();
  }

  std::vector<HalvedDepthMap> depths;
  std::vector<SourceView> views;
  std::vector<ImageView<const float>> images, full_depths;
};

class PatchMatchCpu final : public PatchMatch {
 public:
  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions& options) override {
    const int width = problem.reference.camera.width, height = problem.reference.camera.height;
    Check(problem);
    return Run<Pass::kPhotometric>(problem, options, {PlaneMap(width, height), CostMap(width, height), {}}, {}, 0,
                                   options.photometric_iterations);
  }

  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) override {
    Check(problem);
    CheckStart(problem, start);
    CheckPrior(problem, prior);
    return Run<Pass::kPlanarPrior>(problem, options, start.Clone(), prior, 0, options.planar_prior_iterations);
  }

  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                                const PatchMatchResult& start, int pass) override {
    Check(problem);
    CheckStart(problem, start);
    return Run<Pass::kGeometric>(problem, options, start.Clone(), {}, pass, options.geometric_iterations);
  }

  Image<float> MeasureEvidence(const PatchMatchProblem& problem, const PlaneMap& planes, int cell_size) override {
    Check(problem);
    CheckEvidenceInput(problem, planes, cell_size);
    Timer timer;
    const HostSources sources(problem, Method::kOurs);
    Context context = MakeMatchContext<CpuSampler>(problem, {}, Pass::kGeometric, 0);
    sources.SetUp(problem, &context);
    PlaneMap read = planes.Clone();  // the context could write
    context.planes = read.View();
    Image<float> evidence(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
    tbb::parallel_for(0, evidence.height(), [&](int row) {
      for (int col = 0; col < evidence.width(); ++col)
        evidence(col, row) = EvidenceOfCell(context, col, row, cell_size);
    });
    timing_ = {0, timer.Lap(), 0};
    return evidence;
  }

  PatchMatchTiming last_timing() const override { return timing_; }

  std::string device_name() const override {
    return Concat("cpu (", tbb::this_task_arena::max_concurrency(), " threads)");
  }

 private:
  template <Pass kPass>
  PatchMatchResult Run(const PatchMatchProblem& problem, const PatchMatchOptions& options, PatchMatchResult state,
                       ImageView<const PlaneHypothesis> prior, int geometric_pass, int iterations) {
    Validate(options);
    Timer timer;
    const HostSources sources(problem, options.method);
    state.selected_views = Image<uint32_t>(state.planes.width(), state.planes.height());
    Context context = MakeMatchContext<CpuSampler>(problem, options, kPass, geometric_pass);
    sources.SetUp(problem, &context);
    context.planes = state.planes.View();
    context.cost = state.cost.View();
    context.selected_views = state.selected_views.View();
    context.prior = {prior, {}};
    VisitMethod<kPass>(options.method, [&](auto method) { RunPass<kPass, method>(context, iterations); });
    timing_ = {0, timer.Lap(), 0};
    return state;
  }

  PatchMatchTiming timing_;
};

}  // namespace

void RestoreDetails(const PatchMatchProblem& problem, const PatchMatchOptions& options,
                    const ImageView<const PlaneHypothesis>& coarser, const ImageView<PlaneHypothesis>& planes,
                    const ImageView<float>& cost) {
  Check(problem);
  Validate(options);
  const PinholeCamera& camera = problem.reference.camera;
  const PinholeCamera halved = camera.Halved();
  CheckSize("planes", planes.width, planes.height, camera);
  CheckSize("cost", cost.width, cost.height, camera);
  CheckSize("coarser planes", coarser.width, coarser.height, halved);
  const HostSources sources(problem, options.method);
  Context context = MakeMatchContext<CpuSampler>(problem, options, Pass::kPhotometric, 0);
  sources.SetUp(problem, &context);
  context.planes = planes;
  context.cost = cost;
  const CoarserEstimate estimate = {coarser, MakeRayGrid(halved)};
  tbb::parallel_for(0, camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) RestorePixel(context, estimate, col, row);
  });
}

std::unique_ptr<PatchMatch> MakePatchMatchCpu() { return std::make_unique<PatchMatchCpu>(); }

}  // namespace acmp
