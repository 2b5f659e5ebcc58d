#include <algorithm>
#include <cmath>
#include <random>
#include <type_traits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/image/mask.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<ImageView<const float>>, "kernels take views by value");
static_assert(std::is_trivially_copyable_v<PlaneHypothesis> && std::is_trivially_copyable_v<Vec3f>, "copied as bytes");
static_assert(!std::is_copy_constructible_v<Image<float>> && !std::is_copy_assignable_v<Image<float>>,
              "copies are explicit");

/// About one pixel in `rarity` is ignored.
Mask RandomMask(int width, int height, int rarity) {
  std::mt19937 random(static_cast<unsigned>(width * 1000 + height));
  Mask mask(width, height);
  for (unsigned char& used : mask) used = random() % static_cast<unsigned>(rarity) == 0 ? 0 : 255;
  return mask;
}

Mask Full(int width, int height) { return Mask(width, height, 255); }

/// A picture that is 0 where the mask ignores and 1000 elsewhere, resized as images are: what is mixed with an ignored
/// pixel is less than 1000.
void ExpectResizedAsImages(const Mask& mask, int width, int height) {
  GrayImage picture(mask.width(), mask.height());
  std::transform(mask.begin(), mask.end(), picture.begin(),
                 [](unsigned char used) { return used == 0 ? 0.0f : 1000.0f; });
  const GrayImage expected = Resize(picture, width, height);
  const Mask resized = ResizeMask(mask, width, height);
  ASSERT_EQ(resized.width(), width);
  ASSERT_EQ(resized.height(), height);
  int ignored = 0, mixed = 0;
  for (size_t i = 0; i < resized.size(); ++i) {
    const bool is_ignored = resized.data()[i] == 0, is_mixed = expected.data()[i] < 999.9f;
    EXPECT_TRUE(is_ignored || !is_mixed) << "pixel " << i << " of " << width << " x " << height;
    ignored += is_ignored ? 1 : 0;
    mixed += is_mixed ? 1 : 0;
  }
  // A pixel of which 1e-6 and less is ignored is ignored, too, but nothing that is farther away.
  EXPECT_LE(ignored, mixed + mixed / 50 + 1);
  EXPECT_GT(ignored, 0);
  EXPECT_LT(ignored, width * height);
}

TEST(ToGrayTest, UsesTheLumaWeights) {
  ColorImage color(5, 1);
  color(0, 0) = {255, 0, 0};
  color(1, 0) = {0, 255, 0};
  color(2, 0) = {0, 0, 255};
  color(3, 0) = {255, 255, 255};
  color(4, 0) = {10, 20, 200};
  const GrayImage gray = ToGray(color);
  // ITU-R BT.601, in float: not rounded to whole grey levels.
  const auto luma = [](double r, double g, double b) { return 0.299 * r + 0.587 * g + 0.114 * b; };
  EXPECT_NEAR(gray(0, 0), luma(255, 0, 0), 1e-3);  // OpenCV's weights have three digits; float rounding of 255
  EXPECT_NEAR(gray(1, 0), luma(0, 255, 0), 1e-3);
  EXPECT_NEAR(gray(2, 0), luma(0, 0, 255), 1e-3);
  EXPECT_NEAR(gray(3, 0), 255, 1e-3);
  EXPECT_NEAR(gray(4, 0), luma(10, 20, 200), 1e-3);
}

TEST(MaskTest, ResizedItIgnoresWhatIsMixedWithAnIgnoredPixel) {
  const Mask mask = RandomMask(60, 45, 40);
  ExpectResizedAsImages(mask, 30, 15);
  ExpectResizedAsImages(mask, 41, 31);
  ExpectResizedAsImages(mask, 59, 44);
  ExpectResizedAsImages(mask, 60, 45);
  ExpectResizedAsImages(mask, 97, 70);
  EXPECT_TRUE(ResizeMask({}, 10, 10).empty());
}

TEST(MaskTest, HalvedItIgnoresPixelsThatCoverAnIgnoredOne) {
  for (int ignored_row = 0; ignored_row < 5; ++ignored_row) {
    for (int ignored_col = 0; ignored_col < 7; ++ignored_col) {
      Mask mask = Full(7, 5);
      mask(ignored_col, ignored_row) = 0;
      const Mask halved = HalveMask(mask);
      ASSERT_EQ(halved.width(), 3);
      ASSERT_EQ(halved.height(), 2);
      for (int row = 0; row < 2; ++row) {
        for (int col = 0; col < 3; ++col) {
          // The odd last column and row belong to the pixel before.
          const bool covers = col == std::min(ignored_col / 2, 2) && row == std::min(ignored_row / 2, 1);
          EXPECT_EQ(halved(col, row) == 0, covers) << ignored_col << ' ' << ignored_row;
        }
      }
    }
  }
  EXPECT_TRUE(HalveMask({}).empty());
}

TEST(MaskTest, IntersectedItIgnoresWhatEitherIgnores) {
  const Mask a = RandomMask(20, 10, 3), b = RandomMask(20, 10, 4);
  const Mask both = IntersectMasks(a.Clone(), b);
  for (size_t i = 0; i < both.size(); ++i) EXPECT_EQ(both.data()[i] == 0, a.data()[i] == 0 || b.data()[i] == 0);
  EXPECT_TRUE(std::equal(a.begin(), a.end(), IntersectMasks({}, a).begin()));
  EXPECT_TRUE(std::equal(a.begin(), a.end(), IntersectMasks(a.Clone(), {}).begin()));
  EXPECT_TRUE(IntersectMasks({}, {}).empty());
  EXPECT_THROW(IntersectMasks(a.Clone(), Full(10, 20)), InvalidInputError);
}

TEST(MaskDistanceTest, IsTheChessboardDistance) {
  const Mask mask = RandomMask(50, 30, 300);
  const MaskDistanceMap mask_distance = MakeMaskDistance(mask);
  for (int row = 0; row < 30; ++row) {
    for (int col = 0; col < 50; ++col) {
      int nearest = kMaxMaskDistance;
      for (int r = 0; r < 30; ++r) {
        for (int c = 0; c < 50; ++c) {
          if (mask(c, r) == 0) nearest = std::min(nearest, std::max(std::abs(c - col), std::abs(r - row)));
        }
      }
      ASSERT_EQ(mask_distance(col, row), nearest) << col << ' ' << row;
    }
  }
}

}  // namespace
}  // namespace acmp
