#include "completion_runner.h"

namespace acmp {

void CompletionRunner::Queue(const FusionSetup<DeviceFusionView>& sources, CompletionContext context,
                             const ImageView<PlaneHypothesis>& planes, float* cost, const CudaStream& stream) {
  const int width = planes.width, height = planes.height;
  const int cell_cols = CellsOf(width, context.cell_size), cell_rows = CellsOf(height, context.cell_size);
  const size_t cells = static_cast<size_t>(cell_cols) * cell_rows;
  sources_.Reserve(device_, sources.sources().size());
  sources_.Upload(sources.sources().data(), sources.sources().size(), stream);
  confirming_.Reserve(device_, static_cast<size_t>(width) * height);
  cells_.Reserve(device_, 2 * cells);
  const ImageView<unsigned char> confirming = {confirming_.data(), width, height, width};
  context.confirming = confirming;
  context.planes = planes;
  context.cost = {cost, width, height, width};
  context.anchors = {cells_.data(), cell_cols, cell_rows, cell_cols};
  context.fitted = {cells_.data() + cells, cell_cols, cell_rows, cell_cols};
  LaunchCompletion(sources.Context(sources_.data()), confirming, context, stream.get());
}

}  // namespace acmp
