#include "acmp_mapping/ros/keyframe_numbers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// Keyframes 0.1 s apart.
int64_t Stamp(int64_t index) { return 1000000000000 + index * 100000000; }

TEST(KeyframeNumbers, CountOnWhateverTheStampsDo) {
  KeyframeNumbers numbers;
  for (int64_t i = 0; i < 5; ++i) EXPECT_EQ(numbers.Assign(Stamp(i)), i);
  EXPECT_EQ(numbers.Assign(Stamp(0)), 5) << "a bag that loops";
}

TEST(KeyframeNumbers, AgreeWithThoseOfAPeer) {
  KeyframeNumbers numbers;
  EXPECT_EQ(numbers.Compare(7, Stamp(7)), "") << "nothing is known yet";
  for (int64_t i = 0; i < 5; ++i) numbers.Assign(Stamp(i));
  EXPECT_EQ(numbers.Compare(3, Stamp(3)), "");
  EXPECT_EQ(numbers.Compare(6, Stamp(6)), "") << "the peer is ahead";
  EXPECT_EQ(numbers.Assign(Stamp(5)), 5);
}

TEST(KeyframeNumbers, AfterAMissedKeyframeNumbersAreSkipped) {
  KeyframeNumbers numbers;
  for (const int64_t i : {0, 1, 2, 4, 5}) numbers.Assign(Stamp(i));  // 3 did not come
  EXPECT_THAT(numbers.Compare(3, Stamp(3)), AllOf(HasSubstr("number 3"), HasSubstr("1000.4"), HasSubstr("1000.3")));
  EXPECT_THAT(numbers.Compare(4, Stamp(4)), AllOf(HasSubstr("the number 4 there and 3 here")));
  EXPECT_NE(numbers.Compare(5, Stamp(5)), "") << "this one has its number already";
  EXPECT_EQ(numbers.Assign(Stamp(6)), 6);
  EXPECT_EQ(numbers.Compare(6, Stamp(6)), "");
}

TEST(KeyframeNumbers, WhoStartsLaterCatchesUpWithTheOther) {
  KeyframeNumbers late, early;
  for (int64_t i = 0; i < 500; ++i) early.Assign(Stamp(i));
  for (int64_t i = 490; i < 500; ++i) late.Assign(Stamp(i));
  EXPECT_NE(early.Compare(8, Stamp(498)), "") << "who is ahead does not go back";
  EXPECT_EQ(early.Assign(Stamp(500)), 500);
  EXPECT_NE(late.Compare(498, Stamp(498)), "");
  EXPECT_EQ(late.Assign(Stamp(500)), 500);
}

TEST(KeyframeNumbers, AreTakenFromAPeerThatIsAhead) {
  KeyframeNumbers numbers;
  numbers.Assign(Stamp(7));  // the first that came here
  for (const int64_t i : {8, 10, 11}) EXPECT_EQ(numbers.Compare(i, Stamp(i)), "");
  EXPECT_EQ(numbers.Assign(Stamp(8)), 8);
  EXPECT_EQ(numbers.Assign(Stamp(9)), 9);
  EXPECT_EQ(numbers.Assign(Stamp(11)), 11) << "10 did not come";
  EXPECT_EQ(numbers.Assign(Stamp(12)), 12);
}

TEST(KeyframeNumbers, NeverGiveAKeyframeTheNumberOfAnother) {
  KeyframeNumbers numbers;
  for (const int64_t i : {0, 1}) numbers.Assign(Stamp(i));
  EXPECT_EQ(numbers.Compare(2, Stamp(3)), "");  // the peer has missed keyframe 2 but is ahead
  EXPECT_EQ(numbers.Compare(3, Stamp(4)), "");
  EXPECT_EQ(numbers.Assign(Stamp(2)), 4);
  EXPECT_EQ(numbers.Assign(Stamp(3)), 5) << "then the peer corrects its own";
}

TEST(KeyframeNumbers, ALoopingBagIsNoDisagreement) {
  KeyframeNumbers numbers;
  for (int64_t i = 0; i < 20; ++i) numbers.Assign(Stamp(i));
  EXPECT_EQ(numbers.Compare(20, Stamp(0)), "") << "the peer has begun the next round";
  EXPECT_EQ(numbers.Assign(Stamp(0)), 20);
}

}  // namespace
}  // namespace acmp
