#include "acmp_mapping/image/image.h"

#include <numeric>
#include <type_traits>

#include "gtest/gtest.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<ImageView<const float>>, "kernels take views by value");
static_assert(std::is_trivially_copyable_v<PlaneHypothesis> && std::is_trivially_copyable_v<Vec3f>, "copied as bytes");
static_assert(!std::is_copy_constructible_v<Image<float>> && !std::is_copy_assignable_v<Image<float>>,
              "copies are explicit");

Image<int> Counting(int width, int height) {
  Image<int> image(width, height);
  std::iota(image.begin(), image.end(), 0);
  return image;
}

TEST(ImageTest, IsRowMajorWithoutPadding) {
  Image<int> image = Counting(5, 3);
  EXPECT_EQ(image.width(), 5);
  EXPECT_EQ(image.height(), 3);
  EXPECT_EQ(image(4, 0), 4);
  EXPECT_EQ(image(0, 1), 5);
  EXPECT_EQ(image(4, 2), 14);
  image(2, 1) = -1;
  EXPECT_EQ(image.data()[7], -1);
}

TEST(ImageTest, ViewSharesPixelsAndHonoursItsStride) {
  Image<int> image = Counting(6, 4);
  const ImageView<int> whole = image.View();
  EXPECT_EQ(whole.stride, 6);
  whole(1, 1) = 70;
  EXPECT_EQ(image(1, 1), 70);
  const ImageView<int> window = {&image(2, 1), 3, 2, 6};
  EXPECT_EQ(window(0, 0), image(2, 1));
  EXPECT_EQ(window(2, 1), image(4, 2));
  EXPECT_TRUE(window.Contains(0, 0));
  EXPECT_TRUE(window.Contains(2, 1));
  for (const auto& [col, row] : {std::pair(-1, 0), {0, -1}, {3, 0}, {0, 2}}) EXPECT_FALSE(window.Contains(col, row));
}

TEST(ImageTest, MovedFromIsEmptyAndKeepsNoSize) {
  Image<int> source = Counting(4, 3);
  Image<int> target = std::move(source);
  EXPECT_EQ(target(3, 2), 11);
  EXPECT_EQ(source.width(), 0);   // NOLINT(bugprone-use-after-move): the contract under test
  EXPECT_EQ(source.height(), 0);  // NOLINT(bugprone-use-after-move)
  EXPECT_TRUE(source.empty() && source.View().data == nullptr);

  Image<int> other(1, 1);
  other = std::move(target);
  EXPECT_EQ(other.width(), 4);
  EXPECT_TRUE(target.empty());  // NOLINT(bugprone-use-after-move)
}

}  // namespace
}  // namespace acmp
