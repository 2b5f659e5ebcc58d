// Images of one capture in the window: who is matched against whom, what moves with what, what is counted. And when
// poses have moved since.

#include "acmp_mapping/mapping/dense_mapper.h"
#include "dense_mapper_fakes.h"
#include "keyframe_window.h"
#include "support/error_text.h"
#include "window_poses.h"

namespace acmp {
namespace {

constexpr double kRigBaseline = 0.2;  // 2.9 degrees at the wall

/// A keyframe at x and a companion beside it, with the id after its.
Capture WallPair(int64_t id, double x) { return {{WallFrame(id, x)}, {WallFrame(id + 1, x + kRigBaseline, {})}}; }

class CaptureHarness : public MapperHarness {
 public:
  using MapperHarness::MapperHarness;
  std::vector<std::string> AddPair(int64_t id, double x) {
    mapper.AddCapture(WallPair(id, x));
    return TakeEvents();
  }
  /// Of the first such pass on a keyframe.
  std::vector<int64_t> SourcesOf(const std::string& pass, int64_t id) const {
    const auto calls = CallsOf(engine, pass, id);
    return calls.empty() ? std::vector<int64_t>() : calls.front().sources;
  }
};

TEST(CaptureWindowTest, ACompanionIsEnoughForTheFirstKeyframeAndAStandingCamera) {
  CaptureHarness harness(FakeOptions(6, 1));
  EXPECT_THAT(harness.AddPair(0, 0), ElementsAre("fast 0"));
  EXPECT_THAT(harness.AddPair(2, 0), ElementsAre("fast 2", "refined 0"));
  EXPECT_THAT(harness.AddPair(4, 0.001), ElementsAre("fast 4", "refined 2")) << "poses of a standing camera jitter";
  EXPECT_THAT(harness.Flush(), ElementsAre("refined 4"));
  EXPECT_THAT(harness.SourcesOf("photometric", 4), ElementsAre(5))
      << "another capture's companion at this place shows what its own does, but for what has moved";
  EXPECT_THAT(harness.problems, IsEmpty());
}

TEST(CaptureWindowTest, ACompanionConfirmsWhatBothSee) {
  DenseMapperOptions options = FakeOptions(6, 0);
  options.pipeline.fusion = {};  // the papers ask for two views
  CaptureHarness harness(options);
  harness.AddPair(0, 0);
  EXPECT_THAT(harness.SourcesOf("photometric", 1), ElementsAre(0)) << "it has an estimate of its own";
  const auto geometric = CallsOf(harness.engine, "geometric", 0);
  ASSERT_THAT(geometric, SizeIs(2));
  EXPECT_THAT(geometric[0].source_depths, ElementsAre(kFastDepth));
  ASSERT_THAT(harness.refined, SizeIs(1));
  EXPECT_THAT(harness.refined[0]->points_in_camera, Not(IsEmpty()));
  EXPECT_EQ(harness.refined[0]->source_ids, std::vector<int64_t>{1});
}

TEST(CaptureWindowTest, ACompanionTakesNoWiderViewsPlace) {
  DenseMapperOptions options = FakeOptions(8, 0);
  options.max_source_views = 2;
  CaptureHarness harness(options);
  for (int i = 0; i < 6; ++i) harness.AddPair(2 * i, 0.35 * i);
  EXPECT_THAT(harness.SourcesOf("photometric", 10), UnorderedElementsAre(8, 6));
  EXPECT_THAT(CallsOf(harness.engine, "photometric", 10).back().sources, ElementsAre(11))
      << "once more against its own companion alone, for what moves";
}

TEST(CaptureWindowTest, CompanionsOfOtherCapturesAreNoSourceViews) {
  CaptureHarness harness(FakeOptions(8, 0));
  for (int i = 0; i < 3; ++i) harness.AddPair(2 * i, 0.35 * i);
  EXPECT_THAT(harness.SourcesOf("photometric", 4), UnorderedElementsAre(5, 0, 2));
}

TEST(CaptureWindowTest, AllImagesOfACaptureWithoutKeyframesAreSourceViews) {
  CaptureHarness harness(FakeOptions(8, 0));
  harness.AddPair(0, 0);
  harness.mapper.AddCapture({{}, {WallFrame(2, 0.35), WallFrame(3, 0.55)}});  // a wide image that overload leaves out
  harness.AddPair(4, 0.7);
  EXPECT_THAT(harness.SourcesOf("photometric", 4), UnorderedElementsAre(5, 0, 2, 3));
}

TEST(CaptureWindowTest, TheWindowHoldsSoManyCaptures) {
  CaptureHarness harness(FakeOptions(3, 0));
  for (int i = 0; i < 5; ++i) harness.AddPair(2 * i, 0.35 * i);
  EXPECT_THAT(harness.SourcesOf("photometric", 8), UnorderedElementsAre(9, 4, 6));
  EXPECT_THAT(harness.drops, IsEmpty());
  harness.TakeEvents();
  EXPECT_THAT(harness.Reset(), IsEmpty()) << "all have ended";
}

TEST(CaptureWindowTest, KeyframesOfOneCentreAreNoSourcesOfEachOther) {
  CaptureHarness harness(FakeOptions(6, 1));
  for (int i = 0; i < 3; ++i) {
    harness.mapper.AddCapture({{WallFrame(2 * i, 0.35 * i), WallFrame(2 * i + 1, 0.35 * i)}, {}});
  }
  EXPECT_THAT(harness.Flush(), Contains("refined 5"));
  EXPECT_THAT(harness.refined, SizeIs(6));
  EXPECT_THAT(harness.SourcesOf("photometric", 4), UnorderedElementsAre(0, 1, 2, 3));
  EXPECT_THAT(harness.SourcesOf("photometric", 5), UnorderedElementsAre(0, 1, 2, 3));
}

TEST(CaptureWindowTest, ACompanionWithoutBaselineIsNoSourceView) {
  CaptureHarness harness(FakeOptions(6, 1));
  harness.mapper.AddCapture({{WallFrame(0, 0)}, {WallFrame(1, 0)}});
  EXPECT_THAT(harness.Flush(), ElementsAre("drop 0 no_source_views"));
  EXPECT_THAT(harness.drops[0].message, HasSubstr("1 with no baseline"));
}

TEST(CaptureWindowTest, ACompanionThatCannotBeUsedIsToldAndLeftOut) {
  CaptureHarness harness(FakeOptions(6, 1));
  Capture capture = WallPair(0, 0);
  Frame broken = MakeWallFrame(1, kRigBaseline);
  broken.gray = GrayImage(3, 3);
  capture.companions = {std::make_shared<Frame>(std::move(broken)), WallFrame(2, -kRigBaseline)};
  harness.mapper.AddCapture(capture);
  EXPECT_THAT(harness.TakeEvents(), ElementsAre("fast 0"));
  EXPECT_THAT(harness.SourcesOf("photometric", 0), ElementsAre(2));
  EXPECT_THAT(harness.problems, ElementsAre(HasSubstr("companion_refused: keyframe 1: image size 3 x 3")));
  EXPECT_THROW(harness.mapper.AddCapture({}), InvalidInputError);
  Frame nowhere = MakeWallFrame(8, 0.5);
  nowhere.cam_from_world.translation().x() = std::nan("");
  harness.mapper.AddCapture({{std::make_shared<Frame>(std::move(nowhere))}, {WallFrame(9, 0.7)}});
  EXPECT_THAT(harness.TakeEvents(), ElementsAre("drop 8 invalid_input"));
  EXPECT_THAT(harness.problems.back(), HasSubstr("companion_refused: keyframe 8: the pose"))
      << "it is relative to that";
  EXPECT_THROW(harness.mapper.AddCapture({{WallFrame(10, 0)}, {WallFrame(10, 1)}}), InvalidInputError) << "ids ascend";
}

/// As the newest of a window.
WindowCapture AddTo(KeyframeWindow* window, const Capture& capture) {
  window->Add(WindowCapture(capture));
  return window->WithLater(0);
}

TEST(CaptureWindowTest, CompanionsMoveRigidlyWithTheRefinedPose) {
  KeyframeWindow window({});
  const WindowCapture added = AddTo(&window, WallPair(0, 1));
  WindowPoses poses(std::make_unique<PoseRefiner>(PoseRefinementOptions()), false);
  added.images.front()->range = {1, 10};
  poses.Add(added, window);
  poses.Finish(window);
  const WindowKeyframe& companion = *added.images[1];
  EXPECT_FALSE(companion.refined_place());
  EXPECT_EQ(companion.cam_from_world().matrix(), companion.frame->cam_from_world.matrix()) << "bit by bit";
  // A refined pose in a world that is half as large as the frontend's.
  RefinedPlace refined = {7, RigidTransform::Identity(), added.pose->capture_from_world, 2};
  refined.cam_from_world.linear() = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  refined.cam_from_world.translation() = Eigen::Vector3d(1, 2, 3);
  added.pose->refined = refined;
  const WindowCapture next = AddTo(&window, WallPair(2, 1));
  next.images.front()->range = {1, 10};
  poses.Add(next, window);
  const std::optional<RefinedPlace> of_keyframe = next.images[0]->refined_place(),
                                    of_companion = next.images[1]->refined_place();
  ASSERT_TRUE(of_keyframe && of_companion);
  const RigidTransform between = of_companion->cam_from_world * of_keyframe->cam_from_world.inverse();
  EXPECT_LT((between.translation() - Eigen::Vector3d(-kRigBaseline / 2, 0, 0)).norm(), 1e-12);
  EXPECT_LT((between.linear() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  const RigidTransform placed = of_companion->placed * of_keyframe->placed.inverse();
  EXPECT_LT((placed.translation() - Eigen::Vector3d(-kRigBaseline, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(of_companion->world, 7u);
}

TEST(HaveMovedTest, ByMoreThanAPixelAtTheDepthInTheWorldOfRefinedPoses) {
  KeyframeWindow window({});
  const WindowCapture reference_capture = AddTo(&window, {{WallFrame(0, 0)}, {}}),
                      source_capture = AddTo(&window, {{WallFrame(1, 0.3)}, {}});
  const WindowKeyframePtr reference = reference_capture.images.front(), source = source_capture.images.front();
  reference->range = {kWallDepth, kWallDepth * 1.0001f};
  const std::vector<MatchedView> views = {{source, source->cam_from_world() * reference->cam_from_world().inverse()}};
  const auto as_received = [](const Frame& frame, double scale) {
    return RefinedPlace{1, frame.cam_from_world, frame.cam_from_world, scale};
  };
  source_capture.pose->refined = as_received(*source->frame, 1);
  source_capture.pose->refined->cam_from_world.translation().x() += 0.7 * kWallDepth / kWallCamera.fx;  // by 0.7 px
  EXPECT_FALSE(HaveMoved(*reference, views));
  reference_capture.pose->refined = as_received(*reference->frame, 2);  // there the wall is at half of its depth
  EXPECT_TRUE(HaveMoved(*reference, views));
}

}  // namespace
}  // namespace acmp
