// Runs whose cloud is cut into tiles.
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/map_io.h"
#include "dataset/test_folder.h"
#include "fusion/engine_views.h"
#include "outputs.h"
#include "reconstruction/run_fixture.h"

namespace acmp {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

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
      for (float Vec3f::*axis : {&Vec3f::x, &Vec3f::y, &Vec3f::z}) {
        const size_t number = axis == &Vec3f::x ? 0 : axis == &Vec3f::y ? 1 : 2;
        float least = std::numeric_limits<float>::infinity(), most = -least;
        for (const SurfacePoint& point : points) {
          least = std::min(least, point.position.*axis);
          most = std::max(most, point.position.*axis);
        }
        EXPECT_EQ(tile.at("min").at(number).get<float>(), least);
        EXPECT_EQ(tile.at("max").at(number).get<float>(), most);
      }
    }
    const json summary = json::parse(ReadText(options_.output / "summary.json"));
    EXPECT_EQ(summary.at("points"), cloud.size());
    EXPECT_EQ(summary.at("tiles"), expected.size());
    EXPECT_THAT(ReadText(options_.output / "files.txt"), HasSubstr(" tiles/index.json\n"));
  }
}

TEST_F(TiledRunsTest, LittleMemoryAndOtherOutputsMakeTheSameTiles) {
  options_.tile_size = kTileSize;
  RunTo("much");
  const auto expected = Contents(output("much") / "tiles");
  options_.memory_limit_gb = 0;
  RunTo("little");
  EXPECT_TRUE(Contents(output("little") / "tiles") == expected);
  options_.colmap = true;
  RunTo("colmap");
  EXPECT_TRUE(Contents(output("colmap") / "tiles") == expected);
  const std::string landmarks = ReadText(output("colmap") / "colmap/sparse/0/points3D.bin");
  options_.tile_size.reset();
  RunTo("colmap_one");
  EXPECT_EQ(ReadText(output("colmap_one") / "colmap/sparse/0/points3D.bin"), landmarks);
}

SurfacePoint PointAt(float x, float y, float z, size_t number = 0) {
  return {{x, y, z}, {0, 0.6f, -0.8f}, {static_cast<unsigned char>(number), 2, 3}, static_cast<float>(number)};
}

PointCloud RandomCloud(size_t points, float extent) {
  RandomStream random(1, 2, 3);
  PointCloud cloud;
  cloud.reserve(points);
  for (size_t i = 0; i < points; ++i) {
    const float x = random.NextUniform(-extent, extent), y = random.NextUniform(-extent, extent);
    cloud.push_back(PointAt(x, y, random.NextUniform(-extent, extent), i));
  }
  return cloud;
}

class TiledCloudTest : public TestFolder {
 protected:
  const OutputFolder out_{folder() / "out", {}, false};
  StopRequest stop_;
};

TEST_F(TiledCloudTest, ATileKeepsTheOrderOfItsPoints) {
  PointCloud cloud = RandomCloud(150000, 5);
  for (SurfacePoint& point : cloud) point.position = point.position + Vec3f{5, 5, 5};
  TiledCloud tiles(&out_, 100);
  tiles.Add(PointCloud(cloud.begin(), cloud.begin() + 1000));
  tiles.Add(PointCloud(cloud.begin() + 1000, cloud.end()));
  tiles.Commit(stop_);
  EXPECT_EQ(tiles.tiles(), 1u);
  EXPECT_EQ(FirstDifference(ReadPly(out_.path() / "tiles/0_0_0.ply"), cloud), "");
}

TEST_F(TiledCloudTest, TilesThatAreTooSmallAreRefused) {
  TiledCloud tiles(&out_, 1e-6);
  for (const float x : {1e10f, std::numeric_limits<float>::infinity(), std::nanf("")}) {
    EXPECT_THAT(MessageOf<InvalidInputError>([&] { tiles.Add({PointAt(x, 0, 0)}); }),
                HasSubstr("must be within +-9007199254740992, so tiles must be larger"));
  }
}

}  // namespace
}  // namespace acmp
