#include <cuda_runtime_api.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "acmp_mapping/patch_match/kernel/geometric_cost.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "acmp_mapping/planar_prior/planar_prior.h"
#include "cuda_device.h"
#include "map_kernels.h"
#include "support/devices.h"
#include "support/pass_result.h"
#include "support/random_views.h"

// What the GPU makes of maps before a pass reads them, bit for bit as on the host.

namespace acmp {
namespace {

class MapKernelsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::unique_ptr<DepthEngine> engine;
    MakeEngineOrSkip(Device::kCuda, &engine);
    if (IsSkipped()) return;
    device_ = std::make_shared<CudaDevice>(0);
    stream_ = std::make_unique<CudaStream>();
  }

  template <class T>
  DeviceArray<T> Upload(const T* host, size_t count) const {
    DeviceArray<T> array(device_, count);
    array.Upload(host, count, *stream_);
    stream_->Synchronize();
    return array;
  }
  template <class T>
  Image<T> Download(const DeviceArray<T>& array, int width, int height) const {
    Image<T> image(width, height);
    array.Download(image.data(), image.size(), *stream_);
    stream_->Synchronize();
    return image;
  }

  CudaDevicePtr device_;
  std::unique_ptr<CudaStream> stream_;
};

TEST_F(MapKernelsTest, HalvedDepthsAreThoseOfTheHost) {
  for (const auto& [width, height] : {std::pair(1, 1), {64, 48}, {97, 35}}) {
    const DepthMap depth = RandomViews(1, width, height, 3)[0].depth.Clone();
    const HalvedDepthMap expected = HalveDepth(depth);
    const int half_width = expected.inverse.width(), half_height = expected.inverse.height();
    const DeviceArray<float> on_device = Upload(depth.data(), depth.size());
    const DeviceArray<uint16_t> inverse(device_, expected.inverse.size());
    const DeviceArray<float> largest(device_, 1);
    LaunchHalveDepth({on_device.data(), width, height, width}, largest.data(),
                     {inverse.data(), half_width, half_height, half_width}, stream_->get());
    EXPECT_TRUE(SamePixels(Download(inverse, half_width, half_height), expected.inverse)) << width << " x " << height;
    EXPECT_EQ(Download(largest, 1, 1)(0, 0) / kInverseSteps, expected.step);
  }
}

TEST_F(MapKernelsTest, PriorsAreThoseOfTheHost) {
  constexpr int kWidth = 131, kHeight = 77;
  constexpr DepthRange kRange = {2, 8};
  const PinholeCamera camera = TestCamera(kWidth, kHeight);
  TestRandom random(4);
  std::vector<SupportPoint> points;
  for (int row = 0; row < kHeight; row += 1 + random.Below(9)) {
    for (int col = random.Below(5); col < kWidth; col += 1 + random.Below(30)) {
      points.push_back({col, row, static_cast<float>(random(2, 8))});
    }
  }
  const PriorMesh mesh = MakePriorMesh(camera, points, {});
  std::vector<TriangleCorners> corners;
  for (const SupportTriangle& triangle : mesh.triangles) {
    TriangleCorners& added = corners.emplace_back();
    for (int k = 0; k < 3; ++k) {
      const SupportPoint& point = mesh.points[static_cast<size_t>(triangle.vertex[k])];
      added.col[k] = point.col;
      added.row[k] = point.row;
    }
  }
  const DeviceArray<TriangleCorners> device_corners = Upload(corners.data(), corners.size());
  const DeviceArray<PlaneHypothesis> device_planes = Upload(mesh.planes.data(), mesh.planes.size());
  const DeviceArray<uint32_t> device_numbers(device_, static_cast<size_t>(kWidth) * kHeight);
  LaunchRasterizePrior({device_corners.data(), device_planes.data(), static_cast<int>(corners.size())},
                       MakeRayGrid(camera), kRange.min, kRange.max, {device_numbers.data(), kWidth, kHeight, kWidth},
                       stream_->get());
  const Image<uint32_t> numbers = Download(device_numbers, kWidth, kHeight);
  PlaneMap prior(kWidth, kHeight);
  std::transform(numbers.begin(), numbers.end(), prior.begin(),
                 [&](uint32_t number) { return number > 0 ? mesh.planes[number - 1] : PlaneHypothesis(); });
  const PlaneMap expected = RasterizePrior(camera, mesh, kRange);
  // Where a plane leaves the range its depth decides, which fused products round differently.
  size_t differing = 0, known = 0;
  for (size_t i = 0; i < prior.size(); ++i) {
    differing += prior.data()[i].d != expected.data()[i].d ? 1 : 0;
    known += expected.data()[i].d > 0 ? 1 : 0;
  }
  EXPECT_LE(differing, 2u);
  EXPECT_GT(known, prior.size() / 4);
  EXPECT_LT(known, prior.size()) << "some planes leave the range";
}

}  // namespace
}  // namespace acmp
