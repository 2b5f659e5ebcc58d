#include "completion_runner.h"

namespace acmp {
namespace {

ImageView<const float> EvidenceOf(const CompletionContext& evident, const float* evidence) {
  return {evidence, evident.fitted.width, evident.fitted.height, evident.fitted.width};
}

}  // namespace

void CompletionRunner::Queue(const FusionSetup<DeviceFusionView>& sources, CompletionContext context,
                             const ImageView<PlaneHypothesis>& planes, float* cost, const CompletionContext* evident,
                             const CudaStream& stream) {
  const int width = planes.width, height = planes.height;
  const int cell_cols = CellsOf(width, context.cell_size), cell_rows = CellsOf(height, context.cell_size);
  const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
  sources_.Reserve(device_, sources.sources().size());
  sources_.Upload(sources.sources().data(), sources.sources().size(), stream);
  sightings_.Reserve(device_, static_cast<size_t>(width) * height);
  cells_.Reserve(device_, 2 * cells);
  nearest_.Reserve(device_, cells);
  const ImageView<Sightings> sightings = {sightings_.data(), width, height, width};
  context.sightings = sightings;
  context.planes = planes;
  context.cost = {cost, width, height, width};
  context.anchors = {cells_.data(), cell_cols, cell_rows, cell_cols};
  context.fitted = {cells_.data() + cells, cell_cols, cell_rows, cell_cols};
  context.nearest = {nearest_.data(), cell_cols, cell_rows, cell_cols};
  LaunchLook(sources.Context(sources_.data()), sightings, stream.get());
  if (evident != nullptr) {
    CompletionContext search = *evident;
    search.sightings = sightings;
    search.anchor_views = context.anchor_views;
    ReserveEvident(&search);
    LaunchFindEvident(search, EvidenceOf(search, evidence_.data()), stream.get());
    context.evident = search.fitted;
    context.nearest_evident = search.nearest;
    context.evident_cell_size = search.cell_size;
  }
  LaunchCompletion(context, stream.get());
}

void CompletionRunner::QueueMedian(const FusionSetup<DeviceFusionView>& sources, const DeviceFusionView& completed,
                                   const CompletionContext& context, float* cost, PlaneHypothesis* filtered,
                                   const CudaStream& stream) {
  const int width = completed.depth.width, height = completed.depth.height;
  DeviceFusionContext views = sources.Context(sources_.data());
  views.reference = completed;
  const ImageView<Sightings> sightings = {sightings_.data(), width, height, width};
  MedianContext median = {};
  median.rays = context.rays;
  median.depth_min = context.depth_min;
  median.depth_max = context.depth_max;
  median.planes = completed.normal;
  median.depth = completed.depth;
  median.sightings = sightings;
  median.color = completed.color;
  median.filtered = {filtered, width, height, width};
  median.cost = {cost, width, height, width};
  LaunchWeightedMedian(views, sightings, median, stream.get());
}

float* CompletionRunner::ReserveEvidence(size_t cells) {
  evidence_.Reserve(device_, cells);
  return evidence_.data();
}

void CompletionRunner::ReserveEvident(CompletionContext* evident) {
  const int cell_cols = CellsOf(evident->planes.width, evident->cell_size);
  const int cell_rows = CellsOf(evident->planes.height, evident->cell_size);
  const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
  evident_.Reserve(device_, cells);
  nearest_evident_.Reserve(device_, cells);
  evident->fitted = {evident_.data(), cell_cols, cell_rows, cell_cols};
  evident->nearest = {nearest_evident_.data(), cell_cols, cell_rows, cell_cols};
}

void CompletionRunner::QueueRefutation(CompletionContext context, const CudaStream& stream) {
  ReserveEvident(&context);
  LaunchRefutation(context, EvidenceOf(context, evidence_.data()), stream.get());
}

}  // namespace acmp
