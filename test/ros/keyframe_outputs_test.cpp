#include "acmp_mapping/ros/keyframe_outputs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace acmp {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// Refined maps of a 4x3 image with so many points, all of them in its middle.
KeyframeDepthPtr RefinedMaps(int64_t id, size_t points, Mask mask = {}) {
  auto frame = std::make_shared<Frame>();
  frame->id = id;
  frame->camera = {4, 3, 10, 10, 1.5, 1};
  frame->mask = std::move(mask);
  auto maps = std::make_shared<KeyframeDepth>();
  maps->frame = frame;
  maps->depth = DepthMap(4, 3, 2.0f);
  maps->confidence = ConfidenceMap(4, 3, 0.5f);
  SurfacePoint point;
  point.position = {0, 0, 2};
  point.confidence = 0.5f;
  maps->points_in_camera.assign(points, point);
  if (points == 0) maps->no_points_reason = "reprojection (2 px) 90 %; check ~pose_is";
  maps->refined = true;
  return maps;
}

class KeyframeOutputsTest : public testing::Test {
 protected:
  void Refine(int64_t id, size_t points, Mask mask = {}) {
    KeyframeOutputs::Record record;
    record.origin.stamp_ns = 1000000000 * id;
    outputs_.Add(id, record);
    callbacks_.on_refined(RefinedMaps(id, points, std::move(mask)));
  }

  KeyframeOutputs::Hooks MakeHooks(std::vector<std::string>* warnings) {
    KeyframeOutputs::Hooks hooks;
    hooks.on_refined = [this](const KeyframeOutput& output) {
      keeps_middle_ = output.keep(2, 1);
      num_points_ = output.points_in_camera.size();
    };
    hooks.wants_refined_again = [] { return true; };
    hooks.on_refined_again = [this](const KeyframeOutput& output) {
      points_again_.push_back(output.points_in_camera.size());
    };
    hooks.on_drop = [warnings](const RejectedInput& drop) {
      EXPECT_FALSE(drop.ends_image) << "it is refined";
      warnings->push_back(drop.reason + ": " + drop.message);
    };
    return hooks;
  }

  std::vector<std::string> warnings_;
  int keeps_middle_ = 0;  ///< of the last refined keyframe, as the next
  size_t num_points_ = 0;
  std::vector<size_t> points_again_;  ///< of each message for the map
  KeyframeOutputs outputs_{MakeHooks(&warnings_)};
  DenseMapper::Callbacks callbacks_ = outputs_.MakeCallbacks();
};

TEST_F(KeyframeOutputsTest, WhileAbandonedNobodyWantsBetterMaps) {
  EXPECT_TRUE(callbacks_.wants_refined_again());
  outputs_.set_abandoned(true);
  EXPECT_FALSE(callbacks_.wants_refined_again()) << "a reset does not wait for a flush";
  outputs_.set_abandoned(false);
  EXPECT_TRUE(callbacks_.wants_refined_again());
}

TEST_F(KeyframeOutputsTest, WithdrawnPointsLeaveTheMapWithAWord) {
  Refine(1, 5);
  auto nothing = std::make_shared<KeyframeDepth>();
  nothing->frame = RefinedMaps(1, 0)->frame;
  callbacks_.on_withdrawn(nothing, "poses contradict the images");
  EXPECT_THAT(points_again_, ElementsAre(0));
  EXPECT_EQ(outputs_.status().withdrawn, 1u);
  EXPECT_THAT(warnings_, ElementsAre(AllOf(HasSubstr("withdrawn: image 1.0"), HasSubstr("poses contradict"))));
}

TEST_F(KeyframeOutputsTest, WarnOfARunWithoutPointsAndNameTheCheck) {
  Refine(1, 0);
  Refine(2, 0);
  Refine(3, 5);
  Refine(4, 0);
  Refine(5, 0);
  EXPECT_THAT(warnings_, IsEmpty()) << "single ones are usual";
  Refine(6, 0);
  EXPECT_THAT(warnings_, ElementsAre(AllOf(HasSubstr("no_points: the last 3 refined keyframes"), HasSubstr("6.000"),
                                           HasSubstr("reprojection (2 px) 90 %"), HasSubstr("~pose_is"))));
  EXPECT_EQ(outputs_.status().run_without_points, 3u);
  Refine(7, 1);
  EXPECT_EQ(outputs_.status().run_without_points, 0u);
  EXPECT_EQ(outputs_.status().no_points_reason, "");
}

TEST_F(KeyframeOutputsTest, SayThatAllPointsAreMasked) {
  for (int64_t id = 1; id <= 3; ++id) Refine(id, 5, Mask(4, 3, 0));
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("all 5 are masked")));
}

TEST_F(KeyframeOutputsTest, LeaveOutDepthOfLittleConfidenceAndNoPoints) {
  outputs_.set_min_depth_confidence(0.5);
  Refine(1, 5);
  EXPECT_EQ(keeps_middle_, 1);
  outputs_.set_min_depth_confidence(0.51);
  Refine(2, 5);
  EXPECT_EQ(keeps_middle_, 0);
  EXPECT_EQ(num_points_, 5u);
}

}  // namespace
}  // namespace acmp
