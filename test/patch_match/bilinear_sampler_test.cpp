#include "acmp_mapping/patch_match/kernel/window.h"

#include <limits>

#include "gtest/gtest.h"

#include "support/random_views.h"
#include "support/reference_match.h"

namespace acmp {
namespace {

TEST(BilinearSamplerTest, ReturnsPixelsAtWholePositions) {
  const GrayImage image = RandomImage(9, 7, 1);
  for (int row = 0; row < 7; ++row) {
    for (int col = 0; col < 9; ++col) {
      EXPECT_EQ(SampleBilinear(std::as_const(image).View(), static_cast<float>(col), static_cast<float>(row)),
                image(col, row));
    }
  }
}

TEST(BilinearSamplerTest, AgreesWithTheReferenceInsideAndOutside) {
  for (const auto& [width, height] : {std::pair(9, 7), {1, 5}, {5, 1}, {1, 1}, {2, 2}, {64, 3}}) {
    const GrayImage image = RandomImage(width, height, 2);
    TestRandom random(3);
    for (int i = 0; i < 3000; ++i) {
      const auto x = static_cast<float>(random(-3, width + 3)), y = static_cast<float>(random(-3, height + 3));
      // Fractions and values round to 2^-24 relative to 64 px and 255 grey levels; the three steps add up.
      ASSERT_NEAR(SampleBilinear(std::as_const(image).View(), x, y),
                  reference::SampleBilinear(std::as_const(image).View(), x, y), 1e-4)
          << x << ", " << y << " in " << width << " x " << height;
    }
  }
}

TEST(BilinearSamplerTest, HonoursTheStride) {
  const GrayImage image = RandomImage(10, 8, 4);
  const ImageView<const float> window = {&image(3, 2), 4, 5, 10};
  TestRandom random(5);
  for (int i = 0; i < 500; ++i) {
    const auto x = static_cast<float>(random(-1, 5)), y = static_cast<float>(random(-1, 6));
    EXPECT_NEAR(SampleBilinear(window, x, y), reference::SampleBilinear(window, x, y), 1e-4);
  }
}

TEST(BilinearSamplerTest, AnyPositionGivesAPixelsValue) {
  const GrayImage image = RandomImage(9, 7, 6);
  const ImageView<const float> view = image.View();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(SampleBilinear(view, kInf, kInf), image(8, 6));
  EXPECT_EQ(SampleBilinear(view, -kInf, 3), image(0, 3));
  EXPECT_EQ(SampleBilinear(view, 1e30f, -1e30f), image(8, 0));
  EXPECT_EQ(SampleBilinear(view, kNan, kNan), image(0, 0));
  EXPECT_EQ(SampleBilinear(view, std::nextafter(8.0f, 0.0f), 6), image(8, 6) + (image(7, 6) - image(8, 6)) * 5e-7f);
}

TEST(BilinearSamplerTest, ConstantImagesStayConstant) {
  // What keeps flat source windows flat: interpolation adds exactly zero.
  for (const float value : {0.0f, 0.1f, 123.456f, 254.99f}) {
    const GrayImage image(9, 7, value);
    TestRandom random(7);
    for (int i = 0; i < 500; ++i) {
      ASSERT_EQ(SampleBilinear(std::as_const(image).View(), static_cast<float>(random(-1, 10)),
                               static_cast<float>(random(-1, 8))),
                value);
    }
  }
}

TEST(BilinearSamplerTest, SamplerReadsReferenceAndSources) {
  const GrayImage reference = RandomImage(5, 4, 8), first = RandomImage(6, 3, 9), second = RandomImage(3, 6, 10);
  const ImageView<const float> sources[] = {first.View(), second.View()};
  const BilinearSampler sampler = {reference.View(), sources};
  EXPECT_EQ(sampler.Reference(4, 3), reference(4, 3));
  EXPECT_EQ(sampler.SourceAt(0, 5, 2), first(5, 2));
  EXPECT_EQ(sampler.SourceAt(1, 2, 5), second(2, 5));
}

TEST(BilinearSamplerTest, WholeWindowsHaveTheValuesOfSingleSamples) {
  TestRandom random(11);
  for (const auto& [width, height] : {std::pair(1, 1), {1, 8}, {8, 1}, {2, 2}, {2, 9}, {3, 3}, {31, 23}}) {
    const GrayImage padded = RandomImage(width + 3, height + 2, 12);
    const ImageView<const float> image = {&padded(2, 1), width, height, width + 3};
    const BilinearSampler sampler = {image, &image};
    for (int i = 0; i < 500; ++i) {
      const auto real = [&](double low, double high) { return static_cast<float>(random(low, high)); };
      const PlaneWarp warp = {{real(-5, width + 5), real(-5, height + 5), 1.0f},
                              {real(-1, 1), real(-1, 1), real(-0.05, 0.05)},
                              {real(-1, 1), real(-1, 1), real(-0.05, 0.05)}};
      int count = 0;
      ForEachWindowSample(sampler, 0, warp, [&](int k, float value) {
        EXPECT_EQ(k, count++);
        const double dx = WindowCol(k), dy = WindowRow(k);
        const double z = warp.center.z + dx * warp.step_col.z + dy * warp.step_row.z;
        const double x = (warp.center.x + dx * warp.step_col.x + dy * warp.step_row.x) / z;
        const double y = (warp.center.y + dx * warp.step_col.y + dy * warp.step_row.y) / z;
        // Positions below 60 px are off by up to some 1e-5 px, times gradients of up to 150 grey levels per px.
        EXPECT_NEAR(value, reference::SampleBilinear(image, x, y), 5e-3) << image.width << " x " << image.height;
      });
      ASSERT_EQ(count, kPatchSamples);
    }
  }
}

TEST(BilinearSamplerTest, WholeWindowsOfConstantImagesStayConstant) {
  const GrayImage image(9, 7, 123.456f);
  const ImageView<const float> view = image.View();
  const BilinearSampler sampler = {view, &view};
  TestRandom random(13);
  for (int i = 0; i < 500; ++i) {
    const auto real = [&](double low, double high) { return static_cast<float>(random(low, high)); };
    const PlaneWarp warp = {{real(-5, 14), real(-5, 12), 1.0f},
                            {real(-1, 1), real(-1, 1), real(-0.05, 0.05)},
                            {real(-1, 1), real(-1, 1), real(-0.05, 0.05)}};
    ForEachWindowSample(sampler, 0, warp, [&](int, float value) { EXPECT_EQ(value, 123.456f); });
  }
}

}  // namespace
}  // namespace acmp
