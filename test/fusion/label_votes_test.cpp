#include "acmp_mapping/fusion/label_votes.h"

#include <gtest/gtest.h>

#include "acmp_mapping/fusion/packed_cloud.h"
#include "acmp_mapping/fusion/voxel_map.h"

namespace acmp {
namespace {

const PinholeCamera kCamera = {9, 7, 8, 8, 4, 3};
constexpr Label kWood = 3, kMetal = 200;

SurfacePoint PointAt(float x, float y, float z, Label label = 0, float confidence = 0.5f) {
  return {{x, y, z}, {0, 0, -1}, {}, label, confidence};
}

/// Views from the same place, each of one class, and of one depth; the first is the points' own.
struct Votes {
  std::vector<LabelImage> images;
  std::vector<LabeledView> views;

  explicit Votes(const std::vector<std::pair<Label, float>>& labels_and_depths) {
    for (const auto& [label, depth] : labels_and_depths) images.emplace_back(9, 7, label);
    for (size_t i = 0; i < images.size(); ++i) {
      views.push_back({{kCamera}, &images[i], DepthMap(9, 7, labels_and_depths[i].second), i == 0});
    }
  }
  Label Of(const SurfacePoint& point) const {
    PointCloud points = {point};
    VoteForLabels(views, {kCamera}, 0.02, &points);
    return points.front().label;
  }
};

TEST(VoteForLabels, MostViewsThatSeeThePointWin) {
  const SurfacePoint point = PointAt(0, 0, 2);
  constexpr std::pair<Label, float> kOwn = {0, 2.0f}, kA = {kWood, 2.0f}, kB = {kMetal, 2.0f}, kUnknown = {0, 2.0f};
  EXPECT_EQ(Votes({kOwn, kA, kB, kB}).Of(point), kMetal);
  EXPECT_EQ(Votes({kOwn, kA, kB}).Of(point), kWood) << "the first of equally many";
  EXPECT_EQ(Votes({kOwn, kA, kUnknown, kUnknown}).Of(point), kWood) << "unknown is no vote";
  EXPECT_EQ(Votes({kOwn, kA, {kMetal, 1.9f}, {kMetal, 2.1f}}).Of(point), kWood) << "of other surfaces";
  EXPECT_EQ(Votes({kOwn, kA, {kMetal, 0.0f}, {kMetal, 0.0f}}).Of(point), kWood) << "of unknown depth";
  EXPECT_EQ(Votes({{kWood, 2.0f}}).Of(PointAt(5, 0, 2)), 0) << "outside of the image";
  EXPECT_EQ(Votes({}).Of(PointAt(0, 0, 2, kMetal)), kMetal) << "without views it keeps what it has";
}

TEST(VoteForLabels, InTheOwnViewThePixelsAroundVoteThatShowTheSameSurface) {
  Votes votes({{kWood, 2.0f}});
  LabelImage& labels = votes.images[0];
  labels(4, 3) = kMetal;  // a wrong pixel
  EXPECT_EQ(votes.Of(PointAt(0, 0, 2)), kWood);
  votes.views[0].is_own = false;
  EXPECT_EQ(votes.Of(PointAt(0, 0, 2)), kMetal) << "of another view the pixel alone";
  votes.views[0].is_own = true;
  for (int row = 2; row <= 4; ++row) {  // a post, a pixel wide
    for (const int col : {3, 5}) votes.views[0].depth(col, row) = 2.5f;
    labels(4, row) = kMetal;
  }
  EXPECT_EQ(votes.Of(PointAt(0, 0, 2)), kMetal);
}

TEST(VoxelFilter, VotesForLabelsWeighByConfidence) {
  const auto label_of = [](const PointCloud& points) { return VoxelFilter(points, 10).at(0).label; };
  EXPECT_EQ(label_of({PointAt(1, 1, 1, kWood, 0.3f), PointAt(2, 1, 1, kMetal, 0.2f), PointAt(3, 1, 1, kMetal, 0.2f)}),
            kMetal);
  EXPECT_EQ(label_of({PointAt(1, 1, 1, kWood, 0.3f), PointAt(2, 1, 1, kMetal, 0.2f)}), kWood);
  EXPECT_EQ(label_of({PointAt(1, 1, 1, 0, 0.9f), PointAt(2, 1, 1, kMetal, 0.1f)}), kMetal);
  EXPECT_EQ(label_of({PointAt(1, 1, 1)}), 0);
}

TEST(PackedCloud, KeepsLabels) {
  const PackedCloud packed({PointAt(1, 1, 1), PointAt(2, 1, 1, kMetal), PointAt(3, 1, 1, kWood)});
  EXPECT_EQ(packed[0].label, 0);
  EXPECT_EQ(packed[1].label, kMetal);
  EXPECT_EQ(packed.Unpack()[2].label, kWood);
}

}  // namespace
}  // namespace acmp
