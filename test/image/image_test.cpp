#include "acmp_mapping/image/image.h"

#include <type_traits>

#include "gtest/gtest.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<ImageView<const float>>, "kernels take views by value");
static_assert(std::is_trivially_copyable_v<PlaneHypothesis> && std::is_trivially_copyable_v<Vec3f>, "copied as bytes");
static_assert(!std::is_copy_constructible_v<Image<float>> && !std::is_copy_assignable_v<Image<float>>,
              "copies are explicit");

TEST(ImageTest, MovedFromIsEmptyAndKeepsNoSize) {
  Image<int> source(4, 3);
  source(3, 2) = 11;
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
