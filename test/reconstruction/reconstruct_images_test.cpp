#include "acmp_mapping/reconstruction/reconstruct_images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "reconstruction/run_fixture.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ReconstructImagesTest : public ReconstructRunFixture {
 protected:
  std::vector<InputImage> Images() {
    std::vector<std::string> warnings;
    return ReadInputImages(options_, watcher_, &warnings);
  }

  ImageReconstruction RunOnCpu(std::vector<InputImage> images) {
    return ReconstructImages(
        std::move(images), options_, [&] { return DevicesOf(&fake_); }, &watcher_);
  }

  /// @param free_bytes of each device's memory
  ImageReconstruction RunOnTwoFakeGpus(size_t free_bytes) {
    gpus_.free_bytes = free_bytes;
    return ReconstructImages(
        Images(), options_, [&] { return FakeGpus(2, 2, &gpus_); }, &watcher_);
  }

  std::string ErrorAfter(const std::function<void(std::vector<InputImage>*)>& change) {
    std::vector<InputImage> images = Images();
    change(&images);
    return MessageOf<InvalidInputError>([&] { RunOnCpu(std::move(images)); });
  }

  void ExpectFilesOfTool(const ImageReconstruction& result) const {
    ASSERT_EQ(result.images.size(), size_t{kImages});
    for (int i = 0; i < kImages; ++i) {
      const ImageResult& image = result.images[static_cast<size_t>(i)];
      const std::string name = "/00000" + std::to_string(i) + ".pfm";
      ExpectSame(image.depth, ReadPfm(output() / ("depth" + name)));
      ExpectSame(image.cost, ReadPfm(output() / ("cost" + name)));
      ExpectSame(image.confidence, ReadPfm(output() / ("confidence" + name)));
      EXPECT_EQ(image.normal.size(), image.depth.size());
    }
    const PointCloud cloud = ReadPly(output() / "fused.ply");
    ASSERT_EQ(result.cloud.size(), cloud.size());
    for (size_t i = 0; i < cloud.size(); ++i) {
      ASSERT_EQ(std::memcmp(&result.cloud[i].position, &cloud[i].position, sizeof(Vec3f)), 0) << i;
    }
  }

  FakeGpuBehaviour gpus_;

 private:
  static void ExpectSame(const Image<float>& map, const Image<float>& expected) {
    ASSERT_EQ(map.size(), expected.size());
    EXPECT_EQ(std::memcmp(map.data(), expected.data(), map.size() * sizeof(float)), 0);
  }
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

TEST_F(ReconstructImagesTest, TakesRangeAndSourceViewsAsTheyAreGiven) {
  std::vector<InputImage> images = Images();
  images[0].depth_range = DepthRange{2, 6};
  images[0].ranked_sources = {3, 1};
  const ImageReconstruction result = RunOnCpu(std::move(images));
  EXPECT_THAT(result.images[0].sources, ElementsAre(3, 1));
  EXPECT_NEAR(result.images[0].depth(4, 4), 4, 0.1) << "the stand-in's planes lie in the middle of the range";
  EXPECT_EQ(result.images[0].camera.width, kWidth);
}

TEST_F(ReconstructImagesTest, RefusesBadInput) {
  using Images = std::vector<InputImage>;
  EXPECT_THAT(ErrorAfter([](Images* images) { images->clear(); }), HasSubstr("number of images = 0"));
  EXPECT_THAT(ErrorAfter([](Images* images) { (*images)[1].camera.width = 19; }),
              HasSubstr("image 00000001.png: image size 20 x 15: must be the camera's, 19 x 15"));
  EXPECT_THAT(ErrorAfter([](Images* images) { (*images)[2].mask = Mask(15, 20); }), HasSubstr("mask size 15 x 20"));
  EXPECT_THAT(ErrorAfter([](Images* images) { (*images)[2].ranked_sources = {4}; }), HasSubstr("source view = 4"));
  EXPECT_THAT(ErrorAfter([](Images* images) { (*images)[2].ranked_sources = {2}; }), HasSubstr("its own source views"));
  EXPECT_THAT(ErrorAfter([](Images* images) { (*images)[2].ranked_sources = {1, 0, 1}; }), HasSubstr("more than once"));
  EXPECT_THAT(ErrorAfter([](Images* images) { (*images)[0].cam_from_world.linear() *= 2; }), HasSubstr("orthonormal"));
  EXPECT_THAT(ErrorAfter([](Images* images) {
                (*images)[0].depth_range = DepthRange{5, 4};
              }),
              HasSubstr("depth range"));
  EXPECT_THAT(ErrorAfter([](Images* images) {
                for (InputImage& image : *images) image.depth_range.reset();
              }),
              HasSubstr("no depth range"));
}

TEST_F(ReconstructImagesTest, StopsWhenAsked) {
  fake_.on_call = [&](int call) {
    if (call == 2) watcher_.Request();
  };
  std::vector<InputImage> images = Images();
  EXPECT_THROW(RunOnCpu(std::move(images)), Interrupted);
  EXPECT_LE(fake_.calls.size(), 4u) << "the passes of the step at hand";
}

}  // namespace
}  // namespace acmp
