#include "fill_runner.h"

namespace acmp {
void FillRunner::Queue(const FusionSetup<DeviceFusionView>& sources, FillContext context,
                       const ImageView<PlaneHypothesis>& planes, float* cost, const CudaStream& stream) {
  const int width = planes.width, height = planes.height;
  const int cell_cols = CellsOf(width, context.cell_size), cell_rows = CellsOf(height, context.cell_size);
  const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
  sources_.Reserve(device_, sources.sources().size());
  sources_.Upload(sources.sources().data(), sources.sources().size(), stream);
  support_.Reserve(device_, static_cast<size_t>(width) * height);
  cells_.Reserve(device_, 2 * cells);
  nearest_.Reserve(device_, cells);
  const ImageView<ViewSupport> support = {support_.data(), width, height, width};
  context.support = support;
  context.planes = planes;
  context.cost = {cost, width, height, width};
  context.seeds = {cells_.data(), cell_cols, cell_rows, cell_cols};
  context.fitted = {cells_.data() + cells, cell_cols, cell_rows, cell_cols};
  context.nearest = {nearest_.data(), cell_cols, cell_rows, cell_cols};
  LaunchLook(sources.Context(sources_.data()), support, stream.get());
  LaunchFill(context, stream.get());
}

void FillRunner::QueueMedian(const FusionSetup<DeviceFusionView>& sources, const DeviceFusionView& filled,
                             const FillContext& context, float* cost, PlaneHypothesis* filtered,
                             const CudaStream& stream) {
  const int width = filled.depth.width, height = filled.depth.height;
  DeviceFusionContext views = sources.Context(sources_.data());
  views.reference = filled;
  const ImageView<ViewSupport> support = {support_.data(), width, height, width};
  MedianContext median = {};
  median.rays = context.rays;
  median.depth_min = context.depth_min;
  median.depth_max = context.depth_max;
  median.planes = filled.normal;
  median.depth = filled.depth;
  median.support = support;
  median.color = filled.color;
  median.filtered = {filtered, width, height, width};
  median.cost = {cost, width, height, width};
  LaunchWeightedMedian(views, support, median, stream.get());
}

float* FillRunner::ReserveEvidence(size_t cells) {
  evidence_.Reserve(device_, cells);
  return evidence_.data();
}

void FillRunner::QueueFreeSpaceCheck(FillContext context, const CudaStream& stream) {
  const int cell_cols = CellsOf(context.planes.width, context.cell_size);
  const int cell_rows = CellsOf(context.planes.height, context.cell_size);
  const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
  cells_.Reserve(device_, cells);
  nearest_.Reserve(device_, cells);
  context.fitted = {cells_.data(), cell_cols, cell_rows, cell_cols};
  context.nearest = {nearest_.data(), cell_cols, cell_rows, cell_cols};
  LaunchFreeSpaceCheck(context, {evidence_.data(), cell_cols, cell_rows, cell_cols}, stream.get());
}

}  // namespace acmp
