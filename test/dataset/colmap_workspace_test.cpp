#include "acmp_mapping/dataset/colmap_workspace.h"
#include <gmock/gmock.h>

#include <limits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;
using ColmapWorkspaceTest = TestFolder;

TEST_F(ColmapWorkspaceTest, MapsAreTheirChannelsOneAfterTheOther) {
  NormalMap normal(2, 1);
  normal(0, 0) = {1, 2, 3};
  normal(1, 0) = {4, 5, std::numeric_limits<float>::denorm_min()};
  WriteColmapMap(folder() / "n.bin", normal);
  EXPECT_EQ(ReadText(folder() / "n.bin"), "2&1&3&" + Bytes({1, 4, 2, 5, 3, normal(1, 0).z}));
}

std::vector<ColmapModelImage> SomeImages() {
  RigidTransform moved = RigidTransform::Identity();
  moved.linear() = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  moved.translation() = Eigen::Vector3d(0.1, -0.2, 0.3);
  const PinholeCamera camera{8, 6, 7.123456789012, 7.5, 3.5, 2.25};
  return {{1, "left/0.png", camera, RigidTransform::Identity()},
          {4, "left/1.png", camera, moved},
          {9, "right/0.jpg", {10, 6, 8, 8, 4.5, 2.5}, RigidTransform::Identity()}};
}

TEST_F(ColmapWorkspaceTest, ModelHasTheDocumentedText) {
  std::vector<ColmapModelImage> images = SomeImages();
  images.erase(images.begin() + 1);
  images[0].camera = {8, 6, 7, 7.5, 3.5, 2.25};
  WriteColmapModel(folder(), images, {{{0, 0, 2}, {10, 20, 30}, {0, 1}}, {{1, 0, 2}, {1, 2, 3}, {1}}});
  EXPECT_EQ(ReadText(folder() / "cameras.txt"),
            "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 2\n"
            "1 PINHOLE 8 6 7 7.5 4 2.75\n2 PINHOLE 10 6 8 8 5 3\n");
  EXPECT_EQ(ReadText(folder() / "images.txt"),
            "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n"
            "# Number of images: 2\n"
            "1 1 0 0 0 0 0 0 1 left/0.png\n4 2.75 1\n"
            "9 1 0 0 0 0 0 0 2 right/0.jpg\n5 3 1 9 3 2\n");
  EXPECT_EQ(ReadText(folder() / "points3D.txt"),
            "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n# Number of points: 2\n"
            "1 0 0 2 10 20 30 -1 1 0 9 0\n2 1 0 2 1 2 3 -1 9 1\n");
}

TEST(ColmapNames, OnlyThoseThatTheFilesCanHold) {
  for (const char* good : {"a.png", "left/0001.jpg", "a/b/c", "a..b.png", "über.png"}) {
    EXPECT_NO_THROW(CheckColmapName(good)) << good;
  }
  for (const char* bad :
       {"", "a b.png", "a,b.png", "a\tb", "#a.png", "/a.png", "../a.png", "a/../b.png", "./a.png", "a//b.png", ".."}) {
    EXPECT_THAT(MessageOf<InvalidInputError>([&] { CheckColmapName(bad); }), HasSubstr(Concat("\"", bad, "\"")));
  }
}

}  // namespace
}  // namespace acmp
