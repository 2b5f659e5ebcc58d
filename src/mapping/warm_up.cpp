#include <random>
#include <utility>

#include "acmp_mapping/mapping/dense_mapper.h"

namespace acmp {

void WarmUp(DepthEngine* engine, DenseMapperOptions options, DepthEngine* output_engine, StopRequest* stop) {
  constexpr int kWidth = 128, kHeight = 96;
  constexpr double kBaseline = 0.2;  // 1/5 to 1/20 of the depths
  options.poses.refine = RefinePoses::kOff;
  options.fallback_depth_range = {1, 4};
  DenseMapper mapper(engine, options, {}, output_engine, stop);
  std::minstd_rand random;
  ColorImage image(kWidth, kHeight);
  for (Rgb& pixel : image) pixel.r = pixel.g = pixel.b = static_cast<unsigned char>(random() >> 16);
  const PinholeCamera camera = {kWidth, kHeight, kWidth, kWidth, 0.5 * kWidth, 0.5 * kHeight};
  for (int i = 0; i < options.max_source_views + 2; ++i) {
    RigidTransform pose = RigidTransform::Identity();
    pose.translation().x() = kBaseline * i;
    mapper.AddKeyframe(std::make_shared<const Frame>(MakeFrame(i, i, image.Clone(), camera, pose, {}, kWidth, {}, {})));
  }
  mapper.Flush();
}

}  // namespace acmp
