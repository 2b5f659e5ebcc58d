// COLMAP workspaces, and clouds that are cut into tiles.

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "acmp_mapping/dataset/colmap_workspace.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/test_folder.h"
#include "fusion/engine_views.h"
#include "outputs.h"
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
  const PointCloud fused = ReadPly(output() / "fused.ply");
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

using nlohmann::json;

class TiledRunsTest : public ReconstructRunFixture {
 protected:
  static constexpr double kTileSize = 0.4;

  /// Options go on with that output.
  int RunTo(const std::string& name) {
    options_.output = output(name);
    return ReconstructRunFixture::RunTo(name);
  }
  json Index() const { return json::parse(ReadText(options_.output / "tiles/index.json")); }

  static std::map<std::string, PointCloud> Cut(const PointCloud& cloud) {
    std::map<std::string, PointCloud> tiles;
    for (const SurfacePoint& point : cloud) {
      const auto number = [](float x) { return std::to_string(static_cast<int>(std::floor(x / kTileSize))); };
      const Vec3f& p = point.position;
      tiles[number(p.x) + "_" + number(p.y) + "_" + number(p.z) + ".ply"].push_back(point);
    }
    return tiles;
  }
};

/// In UTM coordinates float32 knows half metres only.
TEST_F(TiledRunsTest, FarFromTheOriginTheyAreTheSame) {
  RunTo("near");
  const PointCloud expected = ReadPly(options_.output / "fused.ply");
  offset_ = {500000, 5500000, 200};
  WriteScene(kImages, kWidth, kHeight);
  for (const bool tiles : {false, true}) {
    if (tiles) options_.tile_size = kTileSize;
    RunTo(tiles ? "far_tiles" : "far");
    double sum_x = 0, expected_x = 0;
    size_t points = 0;
    for (const auto& entry : std::filesystem::directory_iterator(options_.output / (tiles ? "tiles" : ""))) {
      if (entry.path().extension() != ".ply") continue;
      const std::string ply = ReadText(entry.path());
      ASSERT_THAT(ply, HasSubstr("property double x"));
      constexpr size_t kRecord = 3 * sizeof(double) + 4 * sizeof(float) + 3;
      for (size_t at = ply.find("end_header\n") + 11; at < ply.size(); at += kRecord) {
        double place[3];
        std::memcpy(place, &ply[at], sizeof(place));
        ASSERT_NEAR(place[2] - offset_.z(), kPlaneDepth, 2);
        sum_x += place[0] - offset_.x();
        ++points;
      }
    }
    ASSERT_EQ(points, expected.size());
    for (const SurfacePoint& point : expected) expected_x += point.position.x;
    EXPECT_NEAR(sum_x / static_cast<double>(points), expected_x / static_cast<double>(points), 1e-5);
  }
  EXPECT_NEAR(Index()["tiles"][0]["min"][1].get<double>() - offset_.y(), 0, 2);
  EXPECT_EQ(Index()["tiles"][0]["file"].get<std::string>().substr(0, 5), "12499");
}

TEST_F(TiledRunsTest, TilesAreTheCloudCut) {
  for (const char* schedule : {"offline", "online"}) {
    options_.schedule = schedule;
    options_.window_size = 4;
    options_.lookahead = 1;
    options_.tile_size.reset();
    RunTo(std::string("one_") + schedule);
    const PointCloud cloud = ReadPly(options_.output / "fused.ply");
    const auto expected = Cut(cloud);
    ASSERT_GT(expected.size(), 4u);
    ASSERT_EQ(expected.begin()->first.front(), '-') << "no negative number: the test shows less";

    options_.tile_size = kTileSize;
    RunTo(std::string("tiles_") + schedule);
    EXPECT_FALSE(Has("fused.ply"));
    EXPECT_THAT(out_.str(), HasSubstr(std::to_string(cloud.size()) + " points in " + std::to_string(expected.size()) +
                                      " tiles; took "));
    const json index = Index();
    EXPECT_EQ(index.at("tile_size"), kTileSize);
    EXPECT_EQ(index.at("points"), cloud.size());
    ASSERT_EQ(index.at("tiles").size(), expected.size());
    for (const json& tile : index.at("tiles")) {
      const std::string name = tile.at("file");
      ASSERT_EQ(expected.count(name), 1u) << name;
      const PointCloud points = ReadPly(options_.output / "tiles" / name);
      EXPECT_EQ(FirstDifference(points, expected.at(name)), "") << name;
      EXPECT_EQ(tile.at("points"), points.size());
      Eigen::AlignedBox3f box;
      for (const SurfacePoint& p : points) box.extend(Eigen::Vector3f(p.position.x, p.position.y, p.position.z));
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(tile.at("min").at(axis).get<float>(), box.min()[axis]);
        EXPECT_EQ(tile.at("max").at(axis).get<float>(), box.max()[axis]);
      }
    }
    const json summary = json::parse(ReadText(options_.output / "summary.json"));
    EXPECT_EQ(summary.at("points"), cloud.size());
    EXPECT_EQ(summary.at("tiles"), expected.size());
    EXPECT_THAT(ReadText(options_.output / "files.txt"), HasSubstr(" tiles/index.json\n"));
  }
}

TEST_F(TiledRunsTest, OtherOutputsMakeTheSameTiles) {
  options_.tile_size = kTileSize;
  RunTo("much");
  const auto expected = Contents(output("much") / "tiles");
  options_.colmap = true;
  RunTo("colmap");
  EXPECT_TRUE(Contents(output("colmap") / "tiles") == expected);
  const std::string landmarks = ReadText(output("colmap") / "colmap/sparse/0/points3D.bin");
  options_.tile_size.reset();
  RunTo("colmap_one");
  EXPECT_EQ(ReadText(output("colmap_one") / "colmap/sparse/0/points3D.bin"), landmarks);
}

using TiledCloudTest = TestFolder;

TEST_F(TiledCloudTest, ATileKeepsTheOrderOfItsPoints) {
  PointCloud cloud(150000);
  for (size_t i = 0; i < cloud.size(); ++i) cloud[i] = {{1e-5f * static_cast<float>(i), 1, 2}, {0, 0.6f, -0.8f}, {}, 1};
  const OutputFolder out(folder() / "out", {}, false);
  TiledCloud tiles(&out, 100);
  tiles.Add(PointCloud(cloud.begin(), cloud.begin() + 1000));
  tiles.Add(PointCloud(cloud.begin() + 1000, cloud.end()));
  tiles.Commit(StopRequest());
  EXPECT_EQ(tiles.tiles(), 1u);
  EXPECT_EQ(FirstDifference(ReadPly(out.path() / "tiles/0_0_0.ply"), cloud), "");
}

TEST_F(TiledCloudTest, TilesThatAreTooSmallAreRefused) {
  const OutputFolder out(folder() / "out", {}, false);
  TiledCloud tiles(&out, 1e-6);
  for (const float x : {1e10f, std::numeric_limits<float>::infinity(), std::nanf("")}) {
    EXPECT_REFUSED(tiles.Add({{{x, 0, 0}, {0, 0, -1}, {}, 1}}),
                   "must be within +-9007199254740992, so tiles must be larger");
  }
}

}  // namespace
}  // namespace acmp
