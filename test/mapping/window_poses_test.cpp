// A pose refinement that takes long holds up no keyframe.

#include "window_poses.h"

#include <future>
#include <memory>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "pose_scene.h"

namespace acmp {
namespace {

/// Waits with each result until a test lets it go on.
class SlowRefiner : public PoseRefiner {
 public:
  explicit SlowRefiner(std::shared_future<void> go_on) : PoseRefiner({RefinePoses::kOn}), go_on_(std::move(go_on)) {}

  bool Add(const Frame& frame, const DepthRange& range) override {
    added.push_back(frame.id);
    return PoseRefiner::Add(frame, range);
  }
  PoseRefinement Refine() override {
    ++refined;
    go_on_.wait();
    return PoseRefiner::Refine();
  }

  std::vector<int64_t> added;
  int refined = 0;

 private:
  const std::shared_future<void> go_on_;
};

class WindowPosesTest : public ::testing::Test {
 protected:
  void Make(bool live) {
    auto made = std::make_unique<SlowRefiner>(go_on_.get_future().share());
    refiner_ = made.get();
    poses_ = std::make_unique<WindowPoses>(std::move(made), live);
  }
  void Add(size_t i) { AddCapture(WindowCapture({{std::make_shared<Frame>(RoomFrame(i, received_[i]))}, {}})); }
  void AddCapture(const WindowCapture& added) {
    added.images.front()->range = kRoomRange;
    window_.Add(added);
    poses_->Add(added, window_);
  }
  const WindowKeyframe& Keyframe(size_t i) const { return *window_.WithLater(window_.size() - 1 - i).images.front(); }
  /// Whether a keyframe is turned against another as the received poses say; lengths depend on the scale, too.
  bool Follows(size_t i, size_t before) const {
    const auto turn = [](const RigidTransform& a, const RigidTransform& b) {
      return Eigen::Matrix3d(b.linear() * a.linear().transpose());
    };
    return turn(Keyframe(before).cam_from_world(), Keyframe(i).cam_from_world())
        .isApprox(turn(received_[before], received_[i]), 1e-9);
  }

  std::promise<void> go_on_;
  const std::vector<RigidTransform> received_ = Perturbed(TruePoses(), 0.3, 0.01);
  KeyframeWindow window_{10};
  SlowRefiner* refiner_ = nullptr;
  std::unique_ptr<WindowPoses> poses_;  // last: its thread uses the refiner
};

TEST_F(WindowPosesTest, LiveKeyframesDoNotWaitAndThoseOfMeanwhileAreRefinedTogether) {
  Make(true);
  constexpr size_t kCount = 1 + WindowPoses::kMaxWaiting;
  for (size_t i = 0; i < kCount; ++i) Add(i);  // hangs if one waits
  go_on_.set_value();
  poses_->Finish(window_);
  EXPECT_THAT(refiner_->added, testing::ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8));
  EXPECT_EQ(refiner_->refined, 2) << "the first alone, then the others";
  EXPECT_EQ(poses_->left_out(), 0u);
  EXPECT_TRUE(Keyframe(kCount - 1).refined_place());
  EXPECT_FALSE(Follows(kCount - 1, kCount - 2)) << "it is refined itself";
}

TEST_F(WindowPosesTest, LiveThoseWithoutTimeFollowTheOneBefore) {
  Make(true);
  constexpr size_t kLeftOut = 2, kCount = 1 + kLeftOut + WindowPoses::kMaxWaiting;
  for (size_t i = 0; i < kCount; ++i) Add(i);
  go_on_.set_value();
  poses_->Finish(window_);
  EXPECT_EQ(poses_->left_out(), kLeftOut);
  EXPECT_THAT(refiner_->added, testing::ElementsAre(0, 3, 4, 5, 6, 7, 8, 9, 10));
  for (const size_t left_out : {1, 2}) EXPECT_TRUE(Follows(left_out, 0));
  EXPECT_FALSE(Follows(3, 2));
}

TEST_F(WindowPosesTest, ElseEachKeyframeTakesInWhatTheOneBeforeHasTaught) {
  Make(false);
  go_on_.set_value();
  for (size_t i = 0; i < 12; ++i) {
    Add(i);
    if (i == 0) continue;
    EXPECT_TRUE(Follows(i, i - 1)) << i;
  }
  EXPECT_FALSE(Follows(10, 9)) << "it is refined itself";
  poses_->Finish(window_);
  EXPECT_EQ(refiner_->refined, 12);
}

TEST_F(WindowPosesTest, WhereTheFirstImageCannotBeUsedNoOtherTellsThePose) {
  Make(false);
  go_on_.set_value();
  for (size_t i = 0; i < 11; ++i) Add(i);
  constexpr size_t kMasked = 11;
  const auto face = [&](size_t id, double turn) {
    Frame frame = RoomFrame(kMasked, received_[kMasked]);
    frame.id = static_cast<int64_t>(id);
    frame.cam_from_world = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitY()) * frame.cam_from_world;
    return std::make_shared<Frame>(std::move(frame));
  };
  WindowCapture capture({{face(kMasked, 0), face(kMasked + 1, 0.5)}, {}});
  capture.images.erase(capture.images.begin());
  AddCapture(capture);
  poses_->Finish(window_);
  EXPECT_EQ(refiner_->added.back(), 10);
  const RigidTransform back = RigidTransform(Eigen::AngleAxisd(-0.5, Eigen::Vector3d::UnitY()));
  const auto turn_of = [](const RigidTransform& a, const RigidTransform& b) {
    return Eigen::Matrix3d(b.linear() * a.linear().transpose());
  };
  EXPECT_TRUE(turn_of(Keyframe(10).cam_from_world(), back * Keyframe(kMasked).cam_from_world())
                  .isApprox(turn_of(received_[10], received_[kMasked]), 1e-9))
      << "it follows the one before";
}

}  // namespace
}  // namespace acmp
