#include "acmp_mapping/ros/keyframe_sequence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <boost/make_shared.hpp>

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

acmp_mapping::KeyframePointsConstPtr Keyframe(uint64_t number, double stamp_s = -1) {
  auto keyframe = boost::make_shared<acmp_mapping::KeyframePoints>();
  keyframe->number = number;
  keyframe->header.stamp = ros::Time(stamp_s >= 0 ? stamp_s : 100 + static_cast<double>(number));
  keyframe->shard_index = static_cast<uint16_t>(number % 2);
  keyframe->shard_count = 2;
  return keyframe;
}

std::vector<uint64_t> Numbers(const KeyframeSequence::Result& result) {
  std::vector<uint64_t> numbers;
  for (const auto& keyframe : result.keyframes) numbers.push_back(keyframe->number);
  return numbers;
}

TEST(KeyframeSequence, PutsKeyframesInOrder) {
  KeyframeSequence sequence;
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(1))), IsEmpty());
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(0))), ElementsAre(0, 1));
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(3))), IsEmpty());
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(4))), IsEmpty());
  EXPECT_EQ(sequence.held(), 2u);
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(2))), ElementsAre(2, 3, 4));
  EXPECT_EQ(sequence.held(), 0u);
  EXPECT_EQ(sequence.missing(), 0u);
}

TEST(KeyframeSequence, GivesUpOnMissingOnesAndTakesThemLate) {
  KeyframeSequence sequence;
  for (const uint64_t number : {0, 1, 4, 5, 7}) sequence.Add(Keyframe(number));
  KeyframeSequence::Result result = sequence.GiveUp();
  EXPECT_THAT(Numbers(result), ElementsAre(4, 5, 7));
  ASSERT_THAT(result.drops, SizeIs(2));
  EXPECT_EQ(result.drops[0].reason, "keyframe_missing");
  EXPECT_THAT(result.drops[0].message, HasSubstr("2 keyframes from number 2"));
  EXPECT_EQ(sequence.missing(), 3u);
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(3))), ElementsAre(3));
  EXPECT_EQ(sequence.missing(), 2u);
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(8))), ElementsAre(8));
  EXPECT_THAT(Numbers(sequence.GiveUp()), IsEmpty());
}

TEST(KeyframeSequence, MayBeginInTheMiddle) {
  KeyframeSequence sequence;
  sequence.Add(Keyframe(100));
  sequence.Add(Keyframe(101));
  const KeyframeSequence::Result result = sequence.GiveUp();
  EXPECT_THAT(Numbers(result), ElementsAre(100, 101));
  EXPECT_THAT(result.drops, IsEmpty()) << "nothing is known of what was before";
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(102))), ElementsAre(102));
}

TEST(KeyframeSequence, NoticesAKeyframeThatTwoShardsMade) {
  KeyframeSequence sequence;
  sequence.Add(Keyframe(0));
  sequence.Add(Keyframe(1, 101));
  KeyframeSequence::Result result = sequence.Add(Keyframe(2, 101));  // another number for the same image
  EXPECT_THAT(result.keyframes, IsEmpty());
  ASSERT_THAT(result.drops, SizeIs(1));
  EXPECT_EQ(result.drops[0].reason, "keyframe_twice");
  EXPECT_THAT(result.drops[0].message, HasSubstr("as number 1"));
  EXPECT_EQ(sequence.Add(Keyframe(1, 105)).drops[0].reason, "keyframe_twice");
  // The next round of a bag is no repetition.
  for (uint64_t number = 2; number < 30; ++number) sequence.Add(Keyframe(number));
  EXPECT_THAT(Numbers(sequence.Add(Keyframe(30, 100))), ElementsAre(30));
}

TEST(KeyframeSequence, HoldsABoundedNumber) {
  KeyframeSequence sequence;
  sequence.Add(Keyframe(0));
  size_t released = 0, given_up = 0;
  for (uint64_t number = 2; number < 200; number += 2) {
    const auto result = sequence.Add(Keyframe(number));
    released += result.keyframes.size();
    given_up += result.drops.size();
    EXPECT_LE(sequence.held(), KeyframeSequence::kMaxHeld);
  }
  EXPECT_EQ(released + sequence.held(), 99u);
  EXPECT_EQ(given_up, sequence.missing());
  sequence.Clear();
  EXPECT_EQ(sequence.held(), 0u);
}

}  // namespace
}  // namespace acmp
