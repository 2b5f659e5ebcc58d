// Which mask an image gets, and how long it waits for it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/intake/input_matcher.h"
#include "intake/samples.h"

namespace acmp {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// Something that can be told apart. The matcher does not look into it.
std::shared_ptr<const EncodedImage> Picture() {
  const auto owner = std::make_shared<int>();
  return {owner, reinterpret_cast<const EncodedImage*>(owner.get())};
}

class MaskMatchingTest : public ::testing::Test {
 protected:
  MaskMatchingTest() {
    matcher_.set_obstacle(std::nullopt);
    matcher_.set_clouds_expected(false);
    matcher_.set_masks_expected(true);
  }

  void AddImage(int64_t stamp_ns) {
    matcher_.AddImage({stamp_ns, Picture()});
    matcher_.AddPose(PoseAt(stamp_ns));
  }
  std::shared_ptr<const EncodedImage> AddMask(int64_t stamp_ns) {
    const auto mask = Picture();
    matcher_.AddMask({stamp_ns, mask});
    return mask;
  }

  struct Taken {
    std::vector<int64_t> stamps;
    std::vector<std::shared_ptr<const EncodedImage>> masks, prior_depths;
    std::vector<std::string> reasons;  ///< of what was rejected
  };
  static Taken Sort(const std::vector<MatchEvent>& events) {
    Taken taken;
    for (const MatchEvent& event : events) {
      if (const auto* match = std::get_if<MatchedInput>(&event)) {
        taken.stamps.push_back(match->image.stamp_ns);
        taken.masks.push_back(match->mask);
        taken.prior_depths.push_back(match->prior_depth);
      } else if (const auto* rejected = std::get_if<RejectedInput>(&event)) {
        EXPECT_FALSE(rejected->ends_image);
        taken.reasons.push_back(rejected->reason);
      }
    }
    return taken;
  }
  Taken Take(double now_s) { return Sort(matcher_.Take(now_s)); }

  InputMatcher matcher_{{}};
};

TEST_F(MaskMatchingTest, AnImageWaitsForTheMaskOfItsStamp) {
  AddImage(kT0);
  EXPECT_THAT(Take(10).stamps, IsEmpty());
  AddMask(kT0 - 30 * kMs);  // of an earlier image
  EXPECT_THAT(Take(10.1).stamps, IsEmpty());
  const auto mask = AddMask(static_cast<int64_t>(static_cast<double>(kT0) * 1e-9 * 1e9));  // through a double
  const Taken taken = Take(10.2);
  EXPECT_THAT(taken.stamps, ElementsAre(kT0));
  EXPECT_THAT(taken.masks, ElementsAre(mask));
  EXPECT_THAT(taken.reasons, IsEmpty());
}

TEST_F(MaskMatchingTest, NoImageWaitsLongerThanMaskWait) {
  AddImage(kT0);
  AddImage(kT0 + 100 * kMs);
  EXPECT_THAT(Take(10).stamps, IsEmpty());
  EXPECT_THAT(Take(10.49).stamps, IsEmpty());
  const Taken taken = Take(10.5);
  EXPECT_THAT(taken.stamps, ElementsAre(kT0, kT0 + 100 * kMs)) << "they wait at the same time";
  EXPECT_THAT(taken.masks, ElementsAre(nullptr, nullptr));
  EXPECT_THAT(taken.reasons, ElementsAre("no_mask", "no_mask"));
}

TEST_F(MaskMatchingTest, NoImageWaitsOnceTheMaskOfALaterOneIsThere) {
  AddImage(kT0);
  AddImage(kT0 + 100 * kMs);
  const auto mask = AddMask(kT0 + 100 * kMs);
  const Taken taken = Take(0);
  EXPECT_THAT(taken.masks, ElementsAre(nullptr, mask));
  EXPECT_THAT(taken.reasons, ElementsAre("no_mask"));
}

TEST_F(MaskMatchingTest, WithoutPublisherNobodyWaitsAndNothingIsSaid) {
  matcher_.set_masks_expected(false);
  AddImage(kT0);
  const Taken taken = Take(0);
  EXPECT_THAT(taken.masks, ElementsAre(nullptr));
  EXPECT_THAT(taken.reasons, IsEmpty());
}

TEST_F(MaskMatchingTest, TakeAllWaitsForNothing) {
  AddImage(kT0);
  EXPECT_THAT(Sort(matcher_.TakeAll()).stamps, ElementsAre(kT0));
}

TEST_F(MaskMatchingTest, PriorDepthIsMatchedBesideMasksAndWaitedForNoLonger) {
  matcher_.set_prior_depth_expected(true);
  AddImage(kT0);
  AddImage(kT0 + 100 * kMs);
  const auto mask = AddMask(kT0), later_mask = AddMask(kT0 + 100 * kMs);
  EXPECT_THAT(Take(10).stamps, IsEmpty());
  const auto depth = Picture();
  matcher_.AddPriorDepth({kT0, depth});
  const Taken first = Take(10.1);
  EXPECT_THAT(first.masks, ElementsAre(mask));
  EXPECT_THAT(first.prior_depths, ElementsAre(depth));
  EXPECT_THAT(first.reasons, IsEmpty());
  matcher_.AddPriorDepth({kT0 + 50 * kMs, Picture()});  // of no image
  EXPECT_THAT(Take(10.4).stamps, IsEmpty());
  const Taken second = Take(10.5);
  EXPECT_THAT(second.masks, ElementsAre(later_mask));
  EXPECT_THAT(second.prior_depths, ElementsAre(nullptr));
  EXPECT_THAT(second.reasons, ElementsAre("no_prior_depth"));
}

TEST_F(MaskMatchingTest, MasksOfTheRunBeforeAreForgotten) {
  AddMask(kT0);
  AddImage(kT0);
  AddMask(kT0 + 1000 * kMs);
  AddImage(kT0 + 1000 * kMs);
  EXPECT_EQ(Take(0).masks.size(), 2u);
  AddImage(kT0);  // the recording begins anew
  EXPECT_THAT(Take(1).stamps, IsEmpty()) << "the old mask of this stamp is not its own";
  const auto mask = AddMask(kT0);
  EXPECT_THAT(Take(1.1).masks, ElementsAre(mask));
}

}  // namespace
}  // namespace acmp
