// COLMAP workspaces, and clouds far from the world's origin.

#include <Eigen/Geometry>
#include <filesystem>
#include <sstream>
#include <string>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "reconstruction/run_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

class ReconstructColmapTest : public ReconstructRunFixture {
 protected:
  ReconstructColmapTest() { options_.colmap = true; }

  /// The same scene as a COLMAP model with these image names.
  void WriteAsColmap(const std::vector<std::string>& names, const std::vector<ColmapModelPoint>& points) {
    const Scene from = ReadScene(scene());
    std::vector<ColmapModelImage> images;
    for (int i = 0; i < kImages; ++i) {
      images.push_back({10 + i, names[i], from.images[i].camera, from.images[i].cam_from_world});
      const auto path = folder() / "model/images" / names[i];
      std::filesystem::create_directories(path.parent_path());
      std::filesystem::copy_file(from.images[i].path, path);
    }
    WriteColmapModel(folder() / "model", images, points);
    options_.scene = folder() / "model";
    options_.depth_min = 3;
    options_.depth_max = 5;
  }

  void Run() { ReconstructRunFixture::Run(&fake_); }
  std::string Workspace(const std::string& name) const { return ReadText(output() / "colmap" / name); }
  bool Has(const std::string& name) const { return std::filesystem::exists(output() / "colmap" / name); }
};

TEST_F(ReconstructColmapTest, MapsAreThoseOfTheRunAtItsSize) {
  options_.max_image_size = 10;
  Run();
  const PinholeCamera camera = ReadScene(output() / "colmap", SceneFormat::kColmap).images[0].camera;
  EXPECT_EQ(std::vector<int>({camera.width, camera.height}), std::vector<int>({10, 8}));
  EXPECT_NEAR(camera.fy, 10.67, 0.01);
  const DepthMap depth = ReadPfm(output() / "depth/000002.pfm");
  const std::string content = Workspace("stereo/depth_maps/00000002.png.geometric.bin");
  ASSERT_EQ(content.substr(0, 7), "10&8&1&");
  EXPECT_EQ(content.substr(7), std::string(reinterpret_cast<const char*>(depth.data()), depth.size() * sizeof(float)));
  EXPECT_EQ(Workspace("stereo/normal_maps/00000002.png.geometric.bin").size(), 7u + depth.size() * 3 * sizeof(float));
  EXPECT_EQ(ReadColorImage(output() / "colmap/images/00000002.png").width(), 10);
  EXPECT_EQ(Workspace("stereo/fusion.cfg"), "00000000.png\n00000001.png\n00000002.png\n00000003.png\n");
  EXPECT_THAT(Workspace("stereo/patch-match.cfg"),
              HasSubstr("00000001.png\n00000000.png, 00000002.png, 00000003.png\n"));
}

TEST_F(ReconstructColmapTest, PointsAreThoseOfTheCloudAndOfTheImagesThatSeeThem) {
  Run();
  const Scene workspace = ReadScene(output() / "colmap", SceneFormat::kColmap);
  const PointCloud fused = ReadPly(output() / "fused.ply").vertices;
  EXPECT_GT(workspace.landmarks_in_world.size(), fused.size() / 2);
  EXPECT_LE(workspace.landmarks_in_world.size(), fused.size()) << "one per voxel";
  for (const SceneImage& image : workspace.images) {
    EXPECT_GT(image.landmark_indices.size(), kWidth * kHeight / 4u) << image.name;
    for (int landmark : image.landmark_indices) {
      const Eigen::Vector3d in_cam = image.cam_from_world * workspace.landmarks_in_world[landmark];
      ASSERT_TRUE(image.camera.Contains(image.camera.Project(in_cam)));
    }
  }
}

/// COLMAP's fusion has float32 coordinates.
TEST_F(ReconstructColmapTest, FarFromTheOriginTheModelHasAnOriginOfItsOwn) {
  Run();
  EXPECT_FALSE(Has("origin.txt"));
  const Scene close = ReadScene(output() / "colmap", SceneFormat::kColmap);
  offset_ = {500000, 5500000, 200};
  WriteScene(kImages, kWidth, kHeight);
  options_.output = output("far");
  Run();
  const Scene distant = ReadScene(options_.output / "colmap", SceneFormat::kColmap);
  std::istringstream file(ReadText(options_.output / "colmap/origin.txt"));
  Eigen::Vector3d origin;
  file >> origin.x() >> origin.y() >> origin.z();
  ASSERT_EQ(distant.images.size(), close.images.size());
  for (size_t i = 0; i < distant.images.size(); ++i) {
    const Eigen::Vector3d centre = distant.images[i].cam_from_world.inverse().translation();
    EXPECT_LT(centre.norm(), 100);
    EXPECT_LT((origin + centre - offset_ - close.images[i].cam_from_world.inverse().translation()).norm(), 1e-4);
  }
  ASSERT_FALSE(distant.landmarks_in_world.empty());
  EXPECT_LT(distant.landmarks_in_world.front().norm(), 100);
}

TEST_F(ReconstructColmapTest, KeepsNamesAndFolders) {
  WriteAsColmap({"left/0.png", "left/1.png", "right/0.png", "top.jpg"},
                {{{0, 0, 4}, {}, {0, 1, 2, 3}}, {{0.5, 0.1, 4}, {}, {1, 3}}, {{0.2, 0.1, 4}, {}, {2}}});
  Run();
  for (const std::string name : {"left/0.png", "left/1.png", "right/0.png", "top.jpg"}) {
    EXPECT_TRUE(Has("images/" + name) && Has("stereo/depth_maps/" + name + ".geometric.bin") &&
                Has("stereo/normal_maps/" + name + ".geometric.bin"))
        << name;
  }
  EXPECT_EQ(Workspace("images/top.jpg").substr(0, 2), "\xff\xd8") << "a PNG file under the name of a JPEG file";
  const Scene workspace = ReadScene(output() / "colmap", SceneFormat::kColmap);
  ASSERT_EQ(workspace.images.size(), 4u);
  EXPECT_EQ(workspace.images[2].name, "right/0.png");
  EXPECT_GT(workspace.landmarks_in_world.size(), 10u) << "of the cloud, not the three of the scene";
}

TEST_F(ReconstructColmapTest, NamesThatItCannotHoldAreRefusedBeforeTheFirstPass) {
  WriteAsColmap({"0.png", "one, two.png", "2.png", "3.png"}, {});
  EXPECT_REFUSED(Run(), "\"one, two.png\"");
  EXPECT_TRUE(fake_.calls.empty());
  EXPECT_FALSE(std::filesystem::exists(output()));
  options_.images = "0,2,3";
  EXPECT_NO_THROW(Run());
  EXPECT_EQ(Workspace("stereo/fusion.cfg"), "0.png\n2.png\n3.png\n");
}

TEST_F(ReconstructColmapTest, ImagesWithoutMapAreNoSources) {
  WriteText("scene/pair.txt", "4\n0\n2 1 1 2 1\n1\n2 0 1 3 1\n2\n2 1 1 0 1\n3\n1 0 1\n");
  options_.min_source_views = 2;
  Run();
  EXPECT_EQ(Workspace("stereo/fusion.cfg"), "00000000.png\n00000001.png\n00000002.png\n");
  EXPECT_THAT(Workspace("stereo/patch-match.cfg"), HasSubstr("00000001.png\n00000000.png\n"));
  EXPECT_THAT(Workspace("sparse/0/images.bin"), AllOf(HasSubstr("00000002.png"), Not(HasSubstr("00000003.png"))));
  EXPECT_FALSE(Has("images/00000003.png"));
}

/// In UTM coordinates float32 knows half metres only.
TEST_F(ReconstructRunFixture, FarFromTheOriginTheCloudIsTheSameInDouble) {
  RunTo("near");
  const PointCloud expected = ReadPly(output("near") / "fused.ply").vertices;
  offset_ = {500000, 5500000, 200};
  WriteScene(kImages, kWidth, kHeight);
  RunTo("far");
  EXPECT_THAT(ReadText(output("far") / "fused.ply"), HasSubstr("property double x"));
  ReadOrigin origin;
  const PointCloud far_off = ReadPly(output("far") / "fused.ply", &origin).vertices;
  ASSERT_EQ(far_off.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    const Vec3f &p = far_off[i].position, &q = expected[i].position;
    const Eigen::Vector3d moved = InWorld(*origin, p) - offset_ - Eigen::Vector3d(q.x, q.y, q.z);
    ASSERT_LT(moved.norm(), 1e-3) << i;
  }
}

}  // namespace
}  // namespace acmp
