#include "acmp_mapping/intake/reading_check.h"

#include <algorithm>
#include <chrono>
#include <future>
#include <random>
#include <utility>

#include <Eigen/Geometry>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

using Child = PoseSemantics::Child;
using Direction = PoseSemantics::Direction;

RigidTransform Turned(double degrees, const Eigen::Vector3d& axis, const Eigen::Vector3d& position = {0, 0, 0}) {
  RigidTransform transform = RigidTransform::Identity();
  transform.linear() = Eigen::AngleAxisd(degrees * M_PI / 180, axis.normalized()).toRotationMatrix();
  transform.translation() = position;
  return transform;
}

/// A pose that is sent of `truth` and read as `configured`.
RigidTransform ReadAs(const PoseSemantics& configured, const PoseSemantics& truth,
                      const RigidTransform& world_from_cam) {
  const RigidTransform world_from_child = world_from_cam * ChildFromCamera(truth).inverse();
  const bool inverse = truth.direction == Direction::kCamFromWorld;
  return WorldFromCamera(configured, inverse ? world_from_child.inverse() : world_from_child);
}

/// Numbers in -1..1.
class Numbers {
 public:
  double Next() { return static_cast<double>(random_() % 2001) / 1000 - 1; }
  Eigen::Vector3d Vector() {
    const double x = Next(), y = Next();
    return {x, y, Next()};
  }

 private:
  std::minstd_rand random_{3};
};

/// A camera that moves and turns before points at depths of 2 to 6, every other match of which is wrong by chance.
std::vector<MatchedImages> Pairs(const PoseSemantics& configured, const PoseSemantics& truth, size_t count = 12) {
  Numbers numbers;
  std::vector<MatchedImages> pairs;
  RigidTransform world_from_cam = Turned(70, {1, 2, 3}, {1, 2, 3});
  for (size_t i = 0; i < count; ++i) {
    const RigidTransform other = world_from_cam * Turned(6, numbers.Vector(), 0.3 * numbers.Vector());
    MatchedImages pair;
    pair.world_from_cam = ReadAs(configured, truth, world_from_cam);
    pair.other_from_world = ReadAs(configured, truth, other).inverse();
    pair.focal_length = 500;
    for (int match = 0; match < 100; ++match) {
      const Eigen::Vector3d point =
          (4 + 2 * numbers.Next()) * Eigen::Vector3d(0.5 * numbers.Next(), 0.4 * numbers.Next(), 1);
      pair.rays.push_back(point / point.z());
      const Eigen::Vector3d in_other = other.inverse() * world_from_cam * point;
      pair.other_rays.push_back(in_other / in_other.z());
      if (match % 5 == 0) pair.other_rays.back() = Eigen::Vector3d(0.5 * numbers.Next(), 0.4 * numbers.Next(), 1);
    }
    pairs.push_back(std::move(pair));
    world_from_cam = other;
  }
  return pairs;
}

std::string Described(const PoseSemantics& configured, const PoseSemantics& truth) {
  return JudgeReadings(configured, Pairs(configured, truth)).text;
}

const RigidTransform kBodyFromCam = Turned(90, {1, 0, 0}, {0.1, 0, 0.2}) * Turned(30, {0, 1, 0});

TEST(JudgeReadingsTest, NamesTheOneThatFits) {
  for (const Direction direction : {Direction::kWorldFromCam, Direction::kCamFromWorld}) {
    const PoseSemantics body = {direction, Child::kBody, kBodyFromCam};
    const PoseSemantics inverse = {direction, Child::kBody, kBodyFromCam.inverse()};
    const PoseSemantics camera = {direction, Child::kCameraOptical, std::nullopt};
    const PoseSemantics flu = {direction, Child::kCameraFlu, std::nullopt};
    EXPECT_THAT(Described(body, body), IsEmpty());
    EXPECT_THAT(Described(camera, camera), IsEmpty());
    EXPECT_THAT(Described(inverse, body), HasSubstr("what fits is the inverse of T_body_cam, ~pose_child: body ("));
    EXPECT_THAT(Described(body, camera), HasSubstr("what fits is poses of the camera, ~pose_child: camera_optical ("));
    EXPECT_THAT(Described(camera, flu), HasSubstr("what fits is poses of the camera, ~pose_child: camera_flu ("));
    EXPECT_THAT(Described({direction, Child::kCameraOptical, kBodyFromCam}, body),
                HasSubstr("what fits is poses of the body, ~pose_child: body, with the T_body_cam of tf ("));
  }
}

TEST(JudgeReadingsTest, FindsTheRotationOfABodyThatNobodyTold) {
  const PoseSemantics body = {Direction::kWorldFromCam, Child::kBody, Turned(90, {1, 0, 0}, {0.02, 0, 0})};
  EXPECT_THAT(Described({}, body),
              HasSubstr("what fits is poses of a body, ~pose_child: body, ~pose_is: T_world_cam, and "
                        "T_body_cam with a rotation of about [1 0 0; 0 0 -1; 0 1 0]"));
}

TEST(JudgeReadingsTest, FindsARotationThatIsWrongAtACameraFarFromTheBody) {
  const PoseSemantics truth = {Direction::kWorldFromCam, Child::kBody, Turned(90, {1, 0, 0}, {0.6, 0, 0.5})};
  PoseSemantics turned = truth;
  turned.body_from_cam->linear() = Turned(90, {0, 0, 1}).linear();
  EXPECT_THAT(Described(turned, truth), HasSubstr("T_body_cam with a rotation of about [1 0 0; 0 0 -1; 0 1 0]"));
}

TEST(JudgeReadingsTest, TellsTheDirectionOfACameraThatDoesNotTurn) {
  std::vector<MatchedImages> pairs = Pairs({}, {});
  for (MatchedImages& pair : pairs) {  // an inverse has the same epipolar lines, behind the camera
    const RigidTransform other_from_one = pair.other_from_world * pair.world_from_cam;
    for (size_t i = 0; i < pair.rays.size(); ++i) pair.rays[i] = other_from_one.linear() * pair.rays[i];
    for (Eigen::Vector3d& ray : pair.rays) ray /= ray.z();
    pair.world_from_cam = RigidTransform::Identity();
    pair.other_from_world = RigidTransform(Eigen::Translation3d(other_from_one.translation())).inverse();
  }
  EXPECT_THAT(JudgeReadings({}, pairs).text, HasSubstr("~pose_child: camera_optical, ~pose_is: T_cam_world"));
}

TEST(JudgeReadingsTest, OrdersNothingWhereSeveralFitAlike) {
  const PoseSemantics half_turn = {Direction::kWorldFromCam, Child::kBody, Turned(180, {1, 0, 0})};
  EXPECT_THAT(Described({Direction::kWorldFromCam, Child::kCameraOptical, half_turn.body_from_cam}, half_turn),
              AllOf(HasSubstr("several readings fit, and one of them is right"), HasSubstr("poses of the body"),
                    HasSubstr("the inverse of T_body_cam"), Not(HasSubstr("what fits is"))));
}

TEST(JudgeReadingsTest, SaysNothingWhereNothingFitsOrLittleIsSeen) {
  const PoseSemantics body = {Direction::kWorldFromCam, Child::kBody, kBodyFromCam};
  std::vector<MatchedImages> lost = Pairs({}, {});
  Numbers numbers;
  for (MatchedImages& pair : lost)
    pair.other_from_world = Turned(9, numbers.Vector(), numbers.Vector()) * pair.other_from_world;
  EXPECT_THAT(JudgeReadings({}, lost).text, IsEmpty());
  EXPECT_TRUE(JudgeReadings({}, lost).NothingFits());
  EXPECT_FALSE(JudgeReadings({}, Pairs({}, body, 3)).share) << "300 matches";
}

TEST(ReadingCheckTest, ThinImagesTellNothing) {
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(8, 8), std::pair(40, 30), std::pair(2000, 3)}) {
    ReadingCheck check;
    for (int i = 0; i < 3; ++i) {
      Frame frame;
      frame.camera = {width, height, 100, 100, 0.5 * width, 0.5 * height};
      frame.gray = GrayImage(width, height);
      check.Add(frame);
    }
    EXPECT_THAT(check.Judge({}).text, IsEmpty()) << width << " x " << height;
  }
}

// It takes some tenths of a second, in which keyframes must not wait: of that time none waits for half, though a busy
// machine may stop this thread now and then.
TEST(ReadingCheckTest, KeyframesComeInWhileItJudges) {
  using Clock = std::chrono::steady_clock;
  constexpr int kSize = 480, kImages = 12, kMostRounds = 5;
  Numbers numbers;
  Frame frame;
  frame.camera = {kSize, kSize, kSize, kSize, 0.5 * kSize, 0.5 * kSize};
  frame.gray = GrayImage(kSize, kSize);
  for (float& pixel : frame.gray) pixel = static_cast<float>(128 + 127 * numbers.Next());
  bool waits = true;
  for (int round = 0; round < kMostRounds && waits; ++round) {
    ReadingCheck check;
    for (int i = 0; i < kImages; ++i) {
      frame.cam_from_world.translation().x() = i;
      check.Add(frame);
    }
    std::future<Clock::duration> judge = std::async(std::launch::async, [&] {
      const Clock::time_point begin = Clock::now();
      check.Judge({});
      return Clock::now() - begin;
    });
    Clock::duration longest{0};
    for (Clock::time_point last = Clock::now(); judge.wait_for(std::chrono::seconds(0)) != std::future_status::ready;) {
      check.Add(frame);
      longest = std::max(longest, Clock::now() - std::exchange(last, Clock::now()));
    }
    waits = longest > judge.get() / 2;
  }
  EXPECT_FALSE(waits);
}

}  // namespace
}  // namespace acmp
