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
KeyframeDepthPtr RefinedMaps(int64_t id, size_t points) {
  auto frame = std::make_shared<Frame>();
  frame->id = id;
  frame->camera = {4, 3, 10, 10, 1.5, 1};
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
  void Refine(int64_t id, size_t points) {
    KeyframeOutputs::Record record;
    record.origin.stamp_ns = 1000000000 * id;
    outputs_.Add(id, record);
    callbacks_.on_refined(RefinedMaps(id, points));
  }

  KeyframeOutputs::Hooks MakeHooks(std::vector<std::string>* warnings) {
    KeyframeOutputs::Hooks hooks;
    hooks.on_refined = [](const KeyframeOutput&) {};
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

TEST_F(KeyframeOutputsTest, NameTheLeastConfidenceOfWhatIsPublished) {
  outputs_.set_min_confidence(0.75);
  for (int64_t id = 1; id <= 3; ++id) Refine(id, 5);
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("all 5 are below ~min_confidence (0.75)")));
}

}  // namespace
}  // namespace acmp
