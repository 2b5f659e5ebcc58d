#include "cloud_output.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/map_io.h"
#include "dataset/test_folder.h"
#include "fusion/engine_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

constexpr size_t kAllInMemory = 1 << 30;
constexpr size_t kPointBytes = sizeof(SurfacePoint) + sizeof(uint32_t);  // in memory

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
  std::filesystem::path WorkFile() const { return out_.WorkFile(TiledCloud::kFolder, 0).string() + ".partial"; }
  std::filesystem::path Tiles() const { return out_.path() / "tiles"; }
  std::map<std::string, std::string> FilesOf() const {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(Tiles())) {
      files[entry.path().filename().string()] = ReadText(entry.path());
    }
    return files;
  }
  std::map<std::string, std::string> Write(const PointCloud& cloud, double tile_size, size_t max_bytes) const {
    TiledCloud tiles(&out_, tile_size, max_bytes);
    tiles.Add(cloud);
    tiles.Commit(stop_);
    return FilesOf();
  }

  const OutputFolder out_{folder() / "out", {}, false};
  StopRequest stop_;
};

TEST_F(TiledCloudTest, EachPointIsInTheTileOfItsCoordinates) {
  const float before = std::nextafter(2.0f, 0.0f), tiny = std::numeric_limits<float>::denorm_min();
  TiledCloud tiles(&out_, 2, kAllInMemory);
  tiles.Add({PointAt(0, 0, 0, 1), PointAt(before, 1, 1, 2), PointAt(2, 0, 0, 3)});
  tiles.Add({});
  tiles.Add({PointAt(-tiny, -2, -2.5f, 4), PointAt(-0.0f, 0.5f, 0, 5), PointAt(3, 1.5f, -0.0f, 6)});
  EXPECT_EQ(tiles.points(), 6u);
  EXPECT_EQ(tiles.tiles(), 3u);
  EXPECT_FALSE(std::filesystem::exists(Tiles())) << "no Commit yet";
  tiles.Commit(stop_);
  EXPECT_EQ(FilesOf().size(), 4u);
  EXPECT_EQ(FirstDifference(ReadPly(Tiles() / "0_0_0.ply"),
                            {PointAt(0, 0, 0, 1), PointAt(before, 1, 1, 2), PointAt(-0.0f, 0.5f, 0, 5)}),
            "");
  EXPECT_EQ(FirstDifference(ReadPly(Tiles() / "1_0_0.ply"), {PointAt(2, 0, 0, 3), PointAt(3, 1.5f, -0.0f, 6)}), "");
  EXPECT_EQ(FirstDifference(ReadPly(Tiles() / "-1_-1_-2.ply"), {PointAt(-tiny, -2, -2.5f, 4)}), "");
}

TEST_F(TiledCloudTest, AnyMemoryMakesTheSameBytes) {
  const PointCloud cloud = RandomCloud(3000, 5);
  const auto expected = Write(cloud, 4, kAllInMemory);
  EXPECT_EQ(expected.size(), 4u * 4 * 4 + 1);
  for (const size_t points : {0, 7, 500, 2999}) {
    std::filesystem::remove_all(Tiles());
    {
      TiledCloud tiles(&out_, 4, points * kPointBytes);
      for (size_t begin = 0; begin < cloud.size(); begin += 300) {
        const auto first = cloud.begin() + static_cast<ptrdiff_t>(begin);
        tiles.Add({first, first + 300});
      }
      EXPECT_GT(std::filesystem::file_size(WorkFile()), sizeof(SurfacePoint) * cloud.size() / 2) << points;
      tiles.Commit(stop_);
    }
    EXPECT_FALSE(std::filesystem::exists(WorkFile()));
    EXPECT_TRUE(FilesOf() == expected) << points;
  }
}

TEST_F(TiledCloudTest, ATileOfManyBlocksKeepsItsOrder) {
  PointCloud cloud = RandomCloud(150000, 5);
  for (SurfacePoint& point : cloud) point.position = point.position + Vec3f{5, 5, 5};
  for (const size_t max_bytes : {kAllInMemory, size_t{140000} * kPointBytes}) {
    EXPECT_EQ(Write(cloud, 100, max_bytes).size(), 2u);
    EXPECT_EQ(FirstDifference(ReadPly(Tiles() / "0_0_0.ply"), cloud), "");
  }
}

TEST_F(TiledCloudTest, TilesThatAreTooSmallAreRefused) {
  TiledCloud tiles(&out_, 1e-6, kAllInMemory);
  EXPECT_EQ(MessageOf<InvalidInputError>([&] { tiles.Add({PointAt(0, 1e10f, 0)}); }),
            "--tile-size = 1e-06: a point at 1e+10 would be in tile 1e+16: must be within +-9007199254740992, so tiles "
            "must be larger");
  for (const float x : {std::numeric_limits<float>::infinity(), std::nanf("")}) {
    EXPECT_THAT(MessageOf<InvalidInputError>([&] { tiles.Add({PointAt(x, 0, 0)}); }), HasSubstr("must be within"));
  }
}

TEST_F(TiledCloudTest, FilesThatCannotBeWrittenOrReadAreErrors) {
  TiledCloud tiles(&out_, 2, 1000);
  tiles.Add(RandomCloud(500, 5));
  std::filesystem::resize_file(WorkFile(), 1000);
  EXPECT_EQ(MessageOf<ProcessingError>([&] { tiles.Commit(stop_); }),
            "cannot read the points in " + WorkFile().string());
  std::filesystem::remove_all(Tiles());
  WriteText("out/tiles", "in the way of the folder");
  TiledCloud again(&out_, 2, 1000);
  again.Add(RandomCloud(500, 5));
  EXPECT_THROW(again.Commit(stop_), InvalidInputError);  // as any folder that cannot be
}

}  // namespace
}  // namespace acmp
