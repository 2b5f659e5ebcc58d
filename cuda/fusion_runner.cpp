#include "fusion_runner.h"

namespace acmp {

DeviceFusionContext FusionRunner::Upload(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream) {
  const size_t count = setup.sources().size();
  sources_.Reserve(device_, count);
  if (count > 0) sources_.Upload(setup.sources().data(), count, stream);
  return setup.Context(sources_.data());
}

PointOutput FusionRunner::ReservePoints(int width, int height) {
  points_.Reserve(device_, static_cast<size_t>(width) * height);
  count_.Reserve(device_, 1);
  scratch_.Reserve(device_, PointScratchBytes(width, height));
  log_error_.Reserve(device_, static_cast<size_t>(width) * height);
  return {points_.data(), count_.data(), scratch_.data(), log_error_.data()};
}

PointCloud FusionRunner::Download(const CudaStream& stream) {
  auto* count = count_on_host_.Reserve<unsigned>(1);
  count_.Download(count, 1, stream);
  stream.Synchronize();
  PointCloud points(*count);
  download_.Run(points_, points.size(), stream, points.data());
  return points;
}

void FusionRunner::QueueFilter(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream) {
  const DeviceFusionContext context = Upload(setup, stream);
  const int width = context.reference.depth.width, height = context.reference.depth.height;
  const size_t pixels = static_cast<size_t>(width) * height;
  consistent_views_.Reserve(device_, pixels);
  confidence_.Reserve(device_, pixels);
  LaunchFilterByConsistency(context, {consistent_views_.data(), width, height, width},
                            {confidence_.data(), width, height, width}, ReservePoints(width, height), stream.get());
}

ConsistencyResult FusionRunner::Filter(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream) {
  QueueFilter(setup, stream);
  const int width = setup.reference().depth.width, height = setup.reference().depth.height;
  ConsistencyResult result = {Image<unsigned char>(width, height), ConfidenceMap(width, height), {}};
  download_.Run(confidence_, result.confidence.size(), stream, result.confidence.data());
  download_.Run(consistent_views_, result.consistent_views.size(), stream, result.consistent_views.data());
  result.points_in_camera = Download(stream);
  return result;
}

ConfidenceMap FusionRunner::MeasureConfidence(const FusionSetup<DeviceFusionView>& setup, const CudaStream& stream) {
  QueueFilter(setup, stream);
  ConfidenceMap confidence(setup.reference().depth.width, setup.reference().depth.height);
  download_.Run(confidence_, confidence.size(), stream, confidence.data());
  return confidence;
}

PointCloud FusionRunner::Fuse(const FusionSetup<DeviceFusionView>& setup, int width, int height,
                              const CudaStream& stream) {
  LaunchFuseView(Upload(setup, stream), ReservePoints(width, height), stream.get());
  return Download(stream);
}

}  // namespace acmp
