#include "acmp_mapping/geometry/similarity.h"

#include <cmath>

#include <gtest/gtest.h>

namespace acmp {
namespace {

constexpr double kExact = 1e-9;  ///< sums over a few hundred poses in double, values below 100

/// World_from_cam of a camera that walks along a curve and looks about.
RigidTransform OnCurve(int i) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << 0.1 * i, std::sin(0.05 * i), 0.2 * std::cos(0.11 * i);
  pose.rotate(Eigen::AngleAxisd(0.03 * i, Eigen::Vector3d(1, 2, 3).normalized()));
  return pose;
}

RigidTransform OnLine(int i) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << 0.1 * i, 0, 0;
  return pose;
}

Similarity AnySimilarity() {
  Similarity similarity;
  similarity.rigid.translation() << 3, -4, 5;
  similarity.rigid.rotate(Eigen::AngleAxisd(2.5, Eigen::Vector3d(-1, 1, 0.5).normalized()));
  similarity.scale = 1.7;
  return similarity;
}

TEST(Similarity, IsFoundFromPosesAlsoOnAStraightLine) {
  const Similarity expected = AnySimilarity();
  for (const auto& trajectory : {OnCurve, OnLine}) {
    std::vector<PosePair> poses;
    for (int i = 0; i < 8; ++i) poses.push_back({trajectory(i), expected.Moved(trajectory(i))});
    const Similarity found = FitSimilarity(poses);
    EXPECT_NEAR(found.scale, expected.scale, kExact);
    EXPECT_TRUE(found.rigid.isApprox(expected.rigid, kExact));
  }
}

/// Baselines are right, but each step turns the rest of the trajectory by 0.7 degrees.
TEST(Similarity, TakesNoDriftForAScale) {
  std::vector<PosePair> poses = {{OnLine(0), OnLine(0)}};
  for (int i = 1; i < 90; ++i) {
    RigidTransform received = poses.back().to * OnLine(i - 1).inverse() * OnLine(i);
    received.rotate(Eigen::AngleAxisd(0.012, Eigen::Vector3d::UnitZ()));
    poses.push_back({OnLine(i), received});
  }
  // Over four steps the turn shortens baselines by 0.03 %. Least squares of all centres give 0.97.
  EXPECT_NEAR(FitSimilarity(poses).scale, 1, 0.003);
}

TEST(PlaceAlong, PutsEachWorldWhereItsKeyframesWere) {
  std::vector<RefinedAndReceived> keyframes;
  for (int i = 0; i < 20; ++i) {
    Similarity received_from_refined = AnySimilarity();
    const uint64_t world = i < 8 ? 4 : 5;
    if (world == 5) received_from_refined.scale = 0.5;
    keyframes.push_back({{world, OnCurve(i), 2}, received_from_refined.Moved(OnCurve(i))});
  }
  keyframes.push_back({{6, OnCurve(20), 1}, OnCurve(21)});
  const std::vector<std::optional<PlacedCamera>> placed = PlaceAlong(keyframes);
  ASSERT_EQ(placed.size(), keyframes.size());
  for (size_t i = 0; i < 20; ++i) {
    ASSERT_TRUE(placed[i]);
    EXPECT_TRUE(placed[i]->world_from_cam.isApprox(keyframes[i].received, kExact)) << i;
    EXPECT_NEAR(placed[i]->scale, (i < 8 ? 1.7 : 0.5) / 2, kExact) << "points had been multiplied by 2";
  }
  EXPECT_FALSE(placed[20]) << "one keyframe does not tell where its world lies";
}

/// What a monocular frontend may do: its scale falls by a fifth and comes back.
TEST(PlaceAlong, KeepsTheFormWhereTheFrontendsScaleWanders) {
  std::vector<RefinedAndReceived> keyframes;
  RigidTransform received = OnLine(0);
  for (int i = 0; i < 90; ++i) {
    const double scale = 1 - 0.2 * std::exp(-0.5 * std::pow((i - 45) / 8.0, 2));
    keyframes.push_back({{1, OnLine(i), 1}, received});
    received.translation() += scale * (OnLine(i + 1).translation() - OnLine(i).translation());
  }
  const std::vector<std::optional<PlacedCamera>> placed = PlaceAlong(keyframes);
  double smallest = 2, largest = 0;
  for (size_t i = 0; i < placed.size(); ++i) {
    ASSERT_TRUE(placed[i]);
    smallest = std::min(smallest, placed[i]->scale);
    largest = std::max(largest, placed[i]->scale);
    // The frontend is a fifth too slow over about 20 keyframes of 0.1: at most 0.4 in all.
    EXPECT_LT((placed[i]->world_from_cam.translation() - keyframes[i].received.translation()).norm(), 0.2);
  }
  // Over all keyframes the frontend is short by 4.5 %. Twice that is left of 20 %.
  EXPECT_LT(largest - smallest, 0.04);
  EXPECT_NEAR(0.5 * (smallest + largest), 0.955, 0.03);
}

}  // namespace
}  // namespace acmp
