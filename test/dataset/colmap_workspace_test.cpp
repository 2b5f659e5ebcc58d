#include <algorithm>
#include <limits>
#include <set>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using ColmapWorkspaceTest = TestFolder;

TEST_F(ColmapWorkspaceTest, MapsAreTheirChannelsOneAfterTheOther) {
  NormalMap normal(2, 1);
  normal(0, 0) = {1, 2, 3};
  normal(1, 0) = {4, 5, std::numeric_limits<float>::denorm_min()};
  WriteColmapMap(folder() / "n.bin", normal);
  EXPECT_EQ(ReadText(folder() / "n.bin"), "2&1&3&" + Bytes({1, 4, 2, 5, 3, normal(1, 0).z}));
  Image<float> depth(7, 5);
  for (size_t i = 0; i < depth.size(); ++i) depth.data()[i] = 0.1f * static_cast<float>(i);
  WriteColmapMap(folder() / "d.bin", depth);
  EXPECT_TRUE(std::equal(depth.begin(), depth.end(), ReadColmapMap(folder() / "d.bin").begin()));
  EXPECT_REFUSED(ReadColmapMap(folder() / "n.bin"), "2&1&3&");
  WriteText("short.bin", "7&5&1&0000");
  EXPECT_REFUSED(ReadColmapMap(folder() / "short.bin"), "short.bin");
}

TEST_F(ColmapWorkspaceTest, ModelHasTheDocumentedBytes) {
  const std::vector<ColmapModelImage> images = {
      {1, "left/0.png", {8, 6, 7, 7.5, 3.5, 2.25}, RigidTransform::Identity()},
      {9, "right/0.jpg", {10, 6, 8, 8, 4.5, 2.5}, RigidTransform::Identity()}};
  WriteColmapModel(
      folder(), images,
      {{{0, 0, 2}, {10, 20, 30}, {0, 1}}, {{0, 0, -2}, {}, {1}}, {{0, 0, 2}, {}, {}}, {{1, 0, 2}, {1, 2, 3}, {1}}});
  const auto expect_bytes = [&](const char* name, const Binary& expected) {
    EXPECT_TRUE(ReadText(folder() / "sparse/0" / name) == expected.bytes()) << name;
  };
  Binary read_images, read_points;
  const std::vector<double> identity = {1, 0, 0, 0, 0, 0, 0};
  read_images.Add<uint64_t>(2);
  read_images.Add<uint32_t>(1).AddDoubles(identity).Add<uint32_t>(1).AddName("left/0.png").Add<uint64_t>(1);
  read_images.AddDoubles({4, 2.75}).Add<uint64_t>(1);
  read_images.Add<uint32_t>(9).AddDoubles(identity).Add<uint32_t>(2).AddName("right/0.jpg").Add<uint64_t>(2);
  read_images.AddDoubles({5, 3}).Add<uint64_t>(1).AddDoubles({9, 3}).Add<uint64_t>(2);
  expect_bytes("images.bin", read_images);
  read_points.Add<uint64_t>(2);  // not the one behind its image, nor the one that none sees
  read_points.Add<uint64_t>(1).AddDoubles({0, 0, 2}).Add<uint8_t>(10).Add<uint8_t>(20).Add<uint8_t>(30).Add(-1.0);
  read_points.Add<uint64_t>(2);
  for (const uint32_t of_track : {1, 0, 9, 0}) read_points.Add(of_track);  // image and its feature
  read_points.Add<uint64_t>(2).AddDoubles({1, 0, 2}).Add<uint8_t>(1).Add<uint8_t>(2).Add<uint8_t>(3).Add(-1.0);
  read_points.Add<uint64_t>(1);
  for (const uint32_t of_track : {9, 1}) read_points.Add(of_track);
  expect_bytes("points3D.bin", read_points);
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    EXPECT_EQ(ReadText(folder() / "sparse" / name), ReadText(folder() / "sparse/0" / name)) << "for OpenMVS and COLMAP";
    EXPECT_TRUE(std::filesystem::read_symlink(folder() / "sparse" / name).is_relative()) << "the folder may move";
  }
}

TEST_F(ColmapWorkspaceTest, DepthMapsTellWhichImagesSeeAPoint) {
  const PinholeCamera camera = {8, 6, 8, 8, 3.5, 2.5};
  DepthMap near(8, 6, 2.0f), unknown(8, 6, 0.0f);
  ColmapPoints points(
      {{{0, 0, 2.03f}, {}, {1, 2, 3}}, {{0, 0, 2.05f}, {}, {}}, {{9, 0, 2}, {}, {}}, {{0, 0, -2}, {}, {}}}, {0, 0, 10});
  RigidTransform pose = RigidTransform::Identity();
  pose.translation().z() = -10;
  points.AddImage(0, {camera, pose}, near);
  points.AddImage(1, {camera, pose}, unknown);
  points.AddImage(2, {camera, pose}, unknown);
  points.AddImage(3, {camera, pose}, near);
  EXPECT_REFUSED(points.AddImage(4, {camera, pose}, DepthMap(6, 8)), "6 x 8: must be the camera's, 8 x 6");
  const std::vector<ColmapModelPoint> found = points.Take();
  EXPECT_EQ(found[0].position_in_world.z(), 10 + double{2.03f});
  EXPECT_EQ(found[0].color.b, 3);
  EXPECT_THAT(found[0].images, ElementsAre(0, 3)) << "within 2 %";
  EXPECT_THAT(found[1].images, ElementsAre(1)) << "hidden from two; the first of those that do not know";
  EXPECT_THAT(found[2].images, ElementsAre()) << "beside the images";
  EXPECT_THAT(found[3].images, ElementsAre()) << "behind them";
}

TEST_F(ColmapWorkspaceTest, TracksAreBoundedAndOfAllImagesAlike) {
  constexpr size_t kCopies = 400, kImages = 40;
  const PinholeCamera camera = {8, 6, 8, 8, 3.5, 2.5};
  ColmapPoints points(PointCloud(kCopies, {{0, 0, 2}, {}, {}}));
  for (size_t i = 0; i < kImages; ++i) points.AddImage(i, {camera, RigidTransform::Identity()}, DepthMap(8, 6, 2.0f));
  std::vector<size_t> taken(kImages);
  for (const ColmapModelPoint& point : points.Take()) {
    EXPECT_EQ(point.images.size(), ColmapPoints::kMaxTrack);
    EXPECT_EQ(std::set<size_t>(point.images.begin(), point.images.end()).size(), point.images.size());
    for (size_t image : point.images) ++taken[image];
  }
  for (size_t image : taken) EXPECT_NEAR(image, 80, 40) << "five standard deviations of 400 draws of 8 in 40";
}

TEST_F(ColmapWorkspaceTest, OfALargeCloudEveryNthPointIsTaken) {
  PointCloud cloud(2 * ColmapPoints::kMaxPoints);
  for (size_t i = 0; i < cloud.size(); ++i) cloud[i].position.x = static_cast<float>(i);
  const std::vector<ColmapModelPoint> taken = ColmapPoints(cloud).Take();
  ASSERT_EQ(taken.size(), ColmapPoints::kMaxPoints);
  EXPECT_EQ(taken[1].position_in_world.x(), 2);
  EXPECT_EQ(taken.back().position_in_world.x(), 2.0 * ColmapPoints::kMaxPoints - 2);
}

TEST(ColmapNames, OnlyThoseThatTheFilesCanHold) {
  for (const char* good : {"a.png", "left/0001.jpg", "a/b/c", "a..b.png", "über.png"}) {
    EXPECT_NO_THROW(CheckColmapName(good)) << good;
  }
  for (const char* bad :
       {"", "a b.png", "a,b.png", "a\tb", "#a.png", "/a.png", "../a.png", "a/../b.png", "./a.png", "a//b.png", ".."}) {
    EXPECT_REFUSED(CheckColmapName(bad), Concat("\"", bad, "\""));
  }
  EXPECT_NO_THROW(CheckColmapName("a/" + std::string(220, 'n')));
  EXPECT_REFUSED(CheckColmapName(std::string(221, 'n')), "at most 220 bytes");
}

}  // namespace
}  // namespace acmp
