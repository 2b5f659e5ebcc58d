#include "completion_runner.h"

namespace acmp {
void CompletionRunner::Queue(const FusionSetup<DeviceFusionView>& sources, CompletionContext context,
                             const ImageView<PlaneHypothesis>& planes, float* cost, const CudaStream& stream) {
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

void CompletionRunner::QueueRefutation(CompletionContext context, const CudaStream& stream) {
  const int cell_cols = CellsOf(context.planes.width, context.cell_size);
  const int cell_rows = CellsOf(context.planes.height, context.cell_size);
  const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
  cells_.Reserve(device_, cells);
  nearest_.Reserve(device_, cells);
  context.fitted = {cells_.data(), cell_cols, cell_rows, cell_cols};
  context.nearest = {nearest_.data(), cell_cols, cell_rows, cell_cols};
  LaunchRefutation(context, {evidence_.data(), cell_cols, cell_rows, cell_cols}, stream.get());
}

}  // namespace acmp
