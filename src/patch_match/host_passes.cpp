#include "acmp_mapping/patch_match/host_passes.h"

#include <tbb/parallel_for.h>

#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/patch_match/host_functions.h"
#include "acmp_mapping/patch_match/kernel/depth_evidence.h"
#include "acmp_mapping/patch_match/kernel/initialize_pixel.h"
#include "acmp_mapping/patch_match/kernel/median_filter.h"
#include "acmp_mapping/patch_match/kernel/restore_detail.h"
#include "acmp_mapping/patch_match/kernel/update_pixel.h"
#include "acmp_mapping/patch_match/match_setup.h"

namespace acmp {
namespace {

/// The pixels with (col + row) % 2 == color.
template <class Function>
void ForEachPixelOfColor(const MatchContext<CpuSampler>& context, int color, const Function& function) {
  tbb::parallel_for(0, context.height, [&](int row) {
    for (int col = (row + color) % 2; col < context.width; col += 2) function(col, row);
  });
}

/// The median filter for the pixels of a row with (col + row) % 2 == color: several at a time, but where some of them
/// are near the border or masked ones.
void FilterMedians(const MatchContext<CpuSampler>& context, int row, int color) {
  const int stride = 2 * context.sampler.host.lanes;
  const bool is_inside = row >= kMedianReach && row + kMedianReach < context.height;
  const auto may_go_together = [&](int col) {
    if (!is_inside || col < kMedianReach || col + stride - 2 + kMedianReach >= context.width) return false;
    for (int i = 0; i < stride; i += 2) {
      if (context.IsNearMasked(col + i, row, kMedianReach)) return false;
    }
    return true;
  };
  for (int col = (row + color) % 2; col < context.width;) {
    if (may_go_together(col)) {
      context.sampler.host.filter_medians(context.rays, context.depth_min, context.depth_max, col, row, context.planes);
      col += stride;
    } else {
      MedianFilterPixel(context, col, row);
      col += 2;
    }
  }
}

template <Pass kPass, Method kMethod>
void Iterate(const MatchContext<CpuSampler>& context, int iterations) {
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
      tbb::parallel_for(0, context.height, [&](int row) { FilterMedians(context, row, color); });
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
    mask_distances.reserve(views.size());
    for (const MatchView& source : problem.sources) {
      images.push_back(source.gray);
      full_depths.push_back(source.depth);
      mask_distances.push_back(source.mask_distance);
      has_masks |= !source.mask_distance.empty();
    }
  }

  /// A context without maps.
  MatchContext<CpuSampler> MakeContext(const PatchMatchProblem& problem, const PatchMatchOptions& options, Pass kind,
                                       int geometric_pass) const {
    MatchContext<CpuSampler> context = MakeMatchContext<CpuSampler>(problem, options, kind, geometric_pass);
    context.sampler = {{problem.reference.gray, images.data()}, SupportedHostFunctions().back()};
    context.sources = views.data();
    context.full_depths = full_depths.data();
    context.mask_distance = problem.reference.mask_distance;
    context.source_mask_distances = has_masks ? mask_distances.data() : nullptr;
    return context;
  }

  std::vector<HalvedDepthMap> depths;
  std::vector<SourceView> views;
  std::vector<ImageView<const float>> images, full_depths;
  std::vector<ImageView<const unsigned char>> mask_distances;
  bool has_masks = false;  ///< of the sources
};

}  // namespace

EstimateState RunPass(const PatchMatchProblem& problem, const PatchMatchOptions& options, Pass kind,
                      EstimateState state, const PriorMap& prior, int geometric_pass) {
  Check(problem);
  const PinholeCamera& camera = problem.reference.camera;
  if (kind == Pass::kPhotometric) {
    state = {PlaneMap(camera.width, camera.height), CostMap(camera.width, camera.height)};
  } else {
    CheckSize("planes of the start", state.planes.width(), state.planes.height(), camera);
    CheckSize("costs of the start", state.cost.width(), state.cost.height(), camera);
  }
  if (kind == Pass::kPlanarPrior) CheckSize("prior", prior.numbers.width, prior.numbers.height, camera);
  const HostSources sources(problem, options.method);
  Image<uint32_t> selected_views(camera.width, camera.height);
  MatchContext<CpuSampler> context = sources.MakeContext(problem, options, kind, geometric_pass);
  context.planes = state.planes.View();
  context.cost = state.cost.View();
  context.selected_views = selected_views.View();
  context.prior = prior;
  VisitPass(kind, options.method,
            [&](auto pass, auto method) { Iterate<pass, method>(context, IterationsOf(kind, options)); });
  return state;
}

EstimateState RestoreDetails(const PatchMatchProblem& problem, const PatchMatchOptions& options, EstimateState start,
                             const ImageView<const PlaneHypothesis>& coarser) {
  Check(problem);
  const PinholeCamera& camera = problem.reference.camera;
  const PinholeCamera halved = camera.Halved();
  CheckSize("planes", start.planes.width(), start.planes.height(), camera);
  CheckSize("cost", start.cost.width(), start.cost.height(), camera);
  CheckSize("coarser planes", coarser.width, coarser.height, halved);
  const HostSources sources(problem, options.method);
  const CoarserEstimate estimate = {coarser, MakeRayGrid(halved)};
  MatchContext<CpuSampler> context = sources.MakeContext(problem, options, Pass::kPhotometric, 0);
  context.planes = start.planes.View();
  context.cost = start.cost.View();
  ForEachPixel(camera.width, camera.height, [&](int col, int row) { RestorePixel(context, estimate, col, row); });
  return start;
}

Image<float> MeasureEvidence(const PatchMatchProblem& problem, const PlaneMap& planes, int cell_size) {
  Check(problem);
  CheckSize("planes", planes.width(), planes.height(), problem.reference.camera);
  if (cell_size < 1) throw InvalidInputError(Concat("cell_size = ", cell_size, ": must be >= 1 px"));
  const HostSources sources(problem, Method::kOurs);
  PlaneMap read = planes.Clone();  // the context could write
  Image<float> evidence(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
  MatchContext<CpuSampler> context = sources.MakeContext(problem, {}, Pass::kGeometric, 0);
  context.planes = read.View();
  ForEachPixel(evidence.width(), evidence.height(),
               [&](int col, int row) { evidence(col, row) = EvidenceOfCell(context, col, row, cell_size); });
  return evidence;
}

DepthMap ToDepthMap(const PlaneMap& planes, const PinholeCamera& camera) {
  CheckSize("planes", planes.width(), planes.height(), camera);
  const RayGrid rays = MakeRayGrid(camera);
  DepthMap depth(planes.width(), planes.height());
  ForEachPixel(planes.width(), planes.height(), [&](int col, int row) {
    const PlaneHypothesis& plane = planes(col, row);
    if (!(plane.d > 0)) return;
    depth(col, row) = PlaneDepth(plane, rays.Ray(static_cast<float>(col), static_cast<float>(row)));
  });
  return depth;
}

NormalMap ToNormalMap(const PlaneMap& planes) {
  NormalMap normal(planes.width(), planes.height(), Vec3f{0, 0, 0});
  for (size_t i = 0; i < planes.size(); ++i) normal.data()[i] = planes.data()[i].normal();
  return normal;
}

}  // namespace acmp
