#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include "acmp_mapping/reconstruction/reconstruct.h"

#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "reconstruction/run_fixture.h"
#include "support/pass_result.h"

namespace acmp {
namespace {

class ReconstructImagesTest : public ReconstructRunFixture {
 protected:
  std::vector<InputImage> Images() {
    std::vector<std::string> warnings;
    return ReadInputImages(options_, watcher_, &warnings);
  }

  ImageReconstruction RunOnCpu(std::vector<InputImage> images) {
    return ReconstructImages(
        std::move(images), options_, [&] { return FakeHost(&fake_); }, &watcher_);
  }

  /// @param free_bytes of each device's memory
  ImageReconstruction RunOnTwoFakeGpus(size_t free_bytes) {
    gpus_.free_bytes = free_bytes;
    return ReconstructImages(
        Images(), options_, [&] { return FakeGpus(2, 2, &gpus_); }, &watcher_);
  }

  void ExpectFilesOfTool(const ImageReconstruction& result) const {
    ASSERT_EQ(result.images.size(), size_t{kImages});
    for (int i = 0; i < kImages; ++i) {
      const ImageResult& image = result.images[static_cast<size_t>(i)];
      const std::string name = "/00000" + std::to_string(i) + ".pfm";
      EXPECT_TRUE(SamePixels(image.depth, ReadPfm(output() / ("depth" + name))));
      EXPECT_TRUE(SamePixels(image.cost, ReadPfm(output() / ("cost" + name))));
      EXPECT_TRUE(SamePixels(image.confidence, ReadPfm(output() / ("confidence" + name))));
      EXPECT_EQ(image.normal.size(), image.depth.size());
    }
    const PointCloud cloud = ReadPly(output() / "fused.ply");
    ASSERT_EQ(result.cloud.size(), cloud.size());
    for (size_t i = 0; i < cloud.size(); ++i) {
      ASSERT_EQ(std::memcmp(&result.cloud[i].position, &cloud[i].position, sizeof(Vec3f)), 0) << i;
    }
  }

  FakeGpuBehaviour gpus_;
};

TEST_F(ReconstructImagesTest, BitsOfTheToolOnAnyDeviceWithAnyMemory) {
  options_.max_image_size = 18;
  Run(&fake_);
  ExpectFilesOfTool(RunOnCpu(Images()));
  for (const size_t free_bytes : {size_t{1} << 30, size_t{60000}, size_t{1}}) {
    SCOPED_TRACE(free_bytes);
    ExpectFilesOfTool(RunOnTwoFakeGpus(free_bytes));
    EXPECT_EQ(gpus_.NumEstimatesAlive(), 0u);
  }
}

}  // namespace
}  // namespace acmp
