#include "acmp_mapping/map/map_writer.h"

#include <cstdlib>
#include <cstring>

#include <gtest/gtest.h>

#include "acmp_mapping/dataset/map_io.h"
#include "dataset/test_folder.h"
#include "support/decimal_comma.h"
#include "support/error_text.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

PointCloud MakeMap(int count) {
  PointCloud map;
  for (int i = 0; i < count; ++i) {
    map.push_back({{0.1f * static_cast<float>(i), -1.0f / 3, 1e-3f},
                   {0, 0.6f, -0.8f},
                   {200, 100, static_cast<unsigned char>(i)},
                   0,
                   0.75f});
  }
  return map;
}

class MapWriterTest : public TestFolder {
 protected:
  size_t FilesInFolder() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(folder()), fs::directory_iterator()));
  }
};

TEST_F(MapWriterTest, NumbersHaveAPointInAnyLocale) {
  const DecimalComma comma(folder() / "locale");
  const MapCloud map = {MakeMap(5)};
  WriteMap(folder() / "map.ply", map, MapFormat::kPly, false);
  EXPECT_EQ(ReadPly(folder() / "map.ply").vertices[4].position.x, map.points[4].position.x);
  WriteMap(folder() / "map.pcd", map, MapFormat::kPcd, false);
  MapMesh mesh = {{map.points, {{0, 1, 2}}}};
  WriteMap(folder() / "mesh.obj", mesh, MeshFormat::kObj);
  for (const char* name : {"map.ply", "map.pcd", "mesh.obj"}) {
    const std::string text = ReadText(folder() / name);
    EXPECT_EQ(text.find(','), std::string::npos) << name;
    EXPECT_NE(text.find("-0.333333343"), std::string::npos) << name;
  }
  if (!comma.has_c_locale()) GTEST_SKIP() << "there is no locale de_DE, and none can be made: streams alone were tried";
}

/// float32 knows half metres only there.
TEST_F(MapWriterTest, CoordinatesFarFromTheOriginAreDoubles) {
  const MapCloud map = {MakeMap(5), {500000, 5500000, 200}, 1};
  const auto text = [&](MapFormat format) {
    WriteMap(folder() / "map", map, format, false);
    return ReadText(folder() / "map");
  };
  for (const MapFormat format : {MapFormat::kPly, MapFormat::kPcd}) {
    EXPECT_NE(text(format).find("\n500000.400000006 5499999.66666666 200.001000000047 "), std::string::npos)
        << text(format);
  }
  WriteMap(folder() / "map.ply", map, MapFormat::kPly, true);
  const std::string ply = ReadText(folder() / "map.ply");
  EXPECT_NE(ply.find("property double x"), std::string::npos);
  double y = 0;
  std::memcpy(&y, &ply[ply.find("end_header\n") + 11 + 8], sizeof(y));
  EXPECT_EQ(y, 5500000 + double{-1.0f / 3});
  EXPECT_EQ(ReadPly(folder() / "map.ply").vertices.size(), 5u);
  WriteMap(folder() / "map.pcd", map, MapFormat::kPcd, true);
  const std::string pcd = ReadText(folder() / "map.pcd");
  EXPECT_NE(pcd.find("SIZE 8 8 8 4 4 4 4 4\n"), std::string::npos);
  std::memcpy(&y, &pcd[pcd.find("DATA binary\n") + 12 + 8], sizeof(y));
  EXPECT_EQ(y, 5500000 + double{-1.0f / 3});
  EXPECT_EQ(pcd.size(), pcd.find("DATA binary\n") + 12 + 5 * (3 * 8 + 5 * 4));
}

TEST_F(MapWriterTest, RefusesAnEmptyMapAndBadPaths) {
  const PointCloud map = MakeMap(3);
  for (const MapFormat format : {MapFormat::kPly, MapFormat::kPcd}) {
    EXPECT_THROW(WriteMap(folder() / "map", {}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap("", {map}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap(folder(), {map}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap(folder() / "missing" / "map", {map}, format, true), InvalidInputError);
  }
  EXPECT_EQ(FilesInFolder(), 0u);
  EXPECT_REFUSED(WriteMap(folder() / "missing" / "map.pcd", {map}, MapFormat::kPcd, true), "missing/map.pcd",
                 "there is no folder \"" + (folder() / "missing").string() + "\"");
}

TEST_F(MapWriterTest, OnlyFilesThatWereSavedHereAreReplaced) {
  WriteText("scan.ply", "of somebody else");
  EXPECT_REFUSED(ClaimMapFile(folder() / "scan.ply"), "scan.ply");
  ClaimMapFile(folder() / "map.ply");
  WriteMap(folder() / "map.ply", {MakeMap(3)}, MapFormat::kPly, true);
  ClaimMapFile(folder() / "map.ply");
  fs::remove(folder() / "map.ply");
  fs::create_symlink("scan.ply", folder() / "map.ply");
  ClaimMapFile(folder() / "other.ply");
  EXPECT_REFUSED(ClaimMapFile(folder() / "map.ply"), "map.ply");
}

TEST_F(MapWriterTest, TildeIsNotTakenForAName) {
  const fs::path before = fs::current_path();
  fs::current_path(folder());
  const char* home = std::getenv("HOME");
  fs::create_directory(folder() / "~");
  for (const std::string path : {"~", "~/map.ply", "~me/map.ply"}) {
    EXPECT_REFUSED(WriteMap(path, {MakeMap(3)}, MapFormat::kPly, true),
                   "path = \"" + path + "\": ~ stands for no folder",
                   (fs::path(home ? home : "/home/you") / "map.ply").string());
    EXPECT_REFUSED(MapPathBelow(folder(), path, ".ply"), (fs::canonical(folder()) / "map.ply").string());
  }
  WriteMap("~map.ply", {MakeMap(3)}, MapFormat::kPly, true);  // as a shell does
  EXPECT_EQ(FilesInFolder(), 2u);
  fs::current_path(before);
}

TEST_F(MapWriterTest, PathsMustLieBelowTheFolder) {
  const fs::path top = fs::canonical(folder());
  fs::create_directories(folder() / "maps" / "inner");
  fs::create_directories(folder() / "mapsibling");
  fs::create_directory_symlink(folder() / "mapsibling", folder() / "maps" / "out");
  fs::create_directory_symlink(folder() / "maps" / "inner", folder() / "mapsibling" / "in");
  const fs::path maps = folder() / "maps";
  EXPECT_EQ(MapPathBelow(maps, "a.ply", ".ply"), top / "maps/a.ply");
  EXPECT_EQ(MapPathBelow(maps, "inner/../inner/a.ply", ".ply"), top / "maps/inner/a.ply");
  EXPECT_EQ(MapPathBelow(maps, folder() / "mapsibling/in/a.ply", ".ply"), top / "maps/inner/a.ply");
  EXPECT_EQ(MapPathBelow("/", folder() / "a.ply", ".ply"), top / "a.ply");
  for (const fs::path& path : {fs::path("../a.ply"), folder() / "a.ply", folder() / "mapsibling/a.ply",
                               fs::path("/a.ply"), fs::path("out/a.ply"), fs::path("inner/../../a.ply"),
                               fs::path("../none/a.ply"), fs::path("/none/none/a.ply")}) {
    EXPECT_REFUSED(MapPathBelow(maps, path, ".ply"), path.string(), "must lie below " + (top / "maps").string());
  }
  fs::create_directory(maps / ".ssh");
  for (const char* path : {".a.ply", ".ssh/a.ply", "inner/.a.ply", "none/.a.ply"}) {
    EXPECT_REFUSED(MapPathBelow(maps, path, ".ply"), "no name may begin with a dot");
  }
  for (const char* path : {"authorized_keys", "a.pcd", "a.ply.sh"}) {
    EXPECT_REFUSED(MapPathBelow(maps, path, ".ply"), "must end in .ply");
  }
  EXPECT_REFUSED(MapPathBelow(maps, "a\n[ERROR]: b.ply", ".ply"), "control characters");
  EXPECT_REFUSED(MapPathBelow(maps, "none/a.ply", ".ply"), "there is no folder");
  EXPECT_REFUSED(MapPathBelow(maps, "", ".ply"), "names no file");
  EXPECT_REFUSED(MapPathBelow(maps, std::string("a\0b", 3), ".ply"), "control characters");
  EXPECT_REFUSED(MapPathBelow(folder() / "none", "a.ply", ".ply"), "save_folder = ");
}

}  // namespace
}  // namespace acmp
