#include "acmp_mapping/map/map_writer.h"

#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>

#include <gtest/gtest.h>
#include <sys/resource.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "support/decimal_comma.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

PointCloud MakeMap(int count) {
  PointCloud map;
  for (int i = 0; i < count; ++i) {
    map.push_back({{0.1f * static_cast<float>(i), -1.0f / 3, 1e-3f},
                   {0, 0.6f, -0.8f},
                   {200, 100, static_cast<unsigned char>(i)},
                   0.75f});
  }
  return map;
}

class MapWriterTest : public ::testing::Test {
 protected:
  MapWriterTest()
      : folder_(fs::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name()) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~MapWriterTest() override {}

  size_t FilesInFolder() const {
    return static_cast<size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  fs::path folder_;
};

TEST_F(MapWriterTest, OurReaderReadsBothPlyKinds) {
  const PointCloud map = MakeMap(5);
  for (const bool binary : {true, false}) {
    WriteMap(folder_ / "map.ply", {map}, MapFormat::kPly, binary);
    const PointCloud read = ReadPly(folder_ / "map.ply");
    ASSERT_EQ(read.size(), map.size());
    EXPECT_EQ(read[4].position.x, map[4].position.x);
    EXPECT_EQ(read[4].normal.z, map[4].normal.z);
    EXPECT_EQ(read[4].color.b, map[4].color.b);
    EXPECT_EQ(read[4].confidence, map[4].confidence) << "binary " << binary;
  }
  EXPECT_EQ(FilesInFolder(), 1u) << "no temporary file is left";
}

TEST_F(MapWriterTest, NumbersHaveAPointInAnyLocale) {
  const DecimalComma comma(folder_ / "locale");
  const MapCloud map = {MakeMap(5)};
  WriteMap(folder_ / "map.ply", map, MapFormat::kPly, false);
  EXPECT_EQ(ReadPly(folder_ / "map.ply")[4].position.x, map.points[4].position.x);
  WriteMap(folder_ / "map.pcd", map, MapFormat::kPcd, false);
  size_t not_finite = 0;
  EXPECT_EQ(ReadPcd(folder_ / "map.pcd", &not_finite)[4].position.x, map.points[4].position.x);
  MapMesh mesh = {{map.points, {{0, 1, 2}}}};
  WriteMap(folder_ / "mesh.obj", mesh, MeshFormat::kObj);
  for (const char* name : {"map.ply", "map.pcd", "mesh.obj"}) {
    std::ifstream file(folder_ / name);
    const std::string text(std::istreambuf_iterator<char>(file), {});
    EXPECT_EQ(text.find(','), std::string::npos) << name;
    EXPECT_NE(text.find("-0.333333343"), std::string::npos) << name;
  }
  if (!comma.has_c_locale()) GTEST_SKIP() << "there is no locale de_DE, and none can be made: streams alone were tried";
}

/// float32 knows half metres only there.
TEST_F(MapWriterTest, CoordinatesFarFromTheOriginAreDoubles) {
  const MapCloud map = {MakeMap(5), {500000, 5500000, 200}, 1};
  const auto text = [&](MapFormat format) {
    WriteMap(folder_ / "map", map, format, false);
    std::ifstream file(folder_ / "map");
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  for (const MapFormat format : {MapFormat::kPly, MapFormat::kPcd}) {
    EXPECT_NE(text(format).find("\n500000.400000006 5499999.66666666 200.001000000047 "), std::string::npos)
        << text(format);
  }
  WriteMap(folder_ / "map.ply", map, MapFormat::kPly, true);
  std::ifstream file(folder_ / "map.ply", std::ios::binary);
  const std::string ply(std::istreambuf_iterator<char>(file), {});
  EXPECT_NE(ply.find("property double x"), std::string::npos);
  double y = 0;
  std::memcpy(&y, &ply[ply.find("end_header\n") + 11 + 8], sizeof(y));
  EXPECT_EQ(y, 5500000 + double{-1.0f / 3});
  EXPECT_EQ(ReadPly(folder_ / "map.ply").size(), 5u);
  for (const bool binary : {true, false}) {
    WriteMap(folder_ / "map.pcd", map, MapFormat::kPcd, binary);
    size_t not_finite = 0;
    const PointCloud read = ReadPcd(folder_ / "map.pcd", &not_finite);
    ASSERT_EQ(read.size(), 5u);
    EXPECT_EQ(read[4].position.x, 500000.4f);
  }
}

TEST_F(MapWriterTest, RefusesAnEmptyMapAndBadPaths) {
  const PointCloud map = MakeMap(3);
  for (const MapFormat format : {MapFormat::kPly, MapFormat::kPcd}) {
    EXPECT_THROW(WriteMap(folder_ / "map", {}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap("", {map}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap(folder_, {map}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap(folder_ / "missing" / "map", {map}, format, true), InvalidInputError);
  }
  EXPECT_EQ(FilesInFolder(), 0u);
  try {
    WriteMap(folder_ / "missing" / "map.pcd", {map}, MapFormat::kPcd, true);
    ADD_FAILURE() << "written";
  } catch (const InvalidInputError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("missing/map.pcd"), std::string::npos) << text;
    EXPECT_NE(text.find("there is no folder \"" + (folder_ / "missing").string() + "\""), std::string::npos) << text;
  }
}

std::string RefusalOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "(accepted)";
}

TEST_F(MapWriterTest, TildeIsNotTakenForAName) {
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  const char* home = std::getenv("HOME");
  const std::string example = (fs::path(home ? home : "/home/you") / "map.ply").string();
  fs::create_directory(folder_ / "~");
  for (const std::string path : {"~", "~/map.ply", "~me/map.ply"}) {
    const std::string message = RefusalOf([&] { WriteMap(path, {MakeMap(3)}, MapFormat::kPly, true); });
    EXPECT_EQ(message.rfind("path = \"" + path + "\": ~ stands for no folder here: write it out, for example ", 0), 0u)
        << message;
    EXPECT_NE(message.find(example), std::string::npos) << message;
    const fs::path allowed = fs::canonical(folder_) / "map.ply";
    EXPECT_NE(RefusalOf([&] { MapPathBelow(folder_, path, ".ply"); }).find("for example " + allowed.string()),
              std::string::npos);
  }
  WriteMap("~map.ply", {MakeMap(3)}, MapFormat::kPly, true);  // as a shell does
  EXPECT_EQ(FilesInFolder(), 2u);
  fs::current_path(before);
}

TEST_F(MapWriterTest, PathsMustLieBelowTheFolder) {
  const fs::path top = fs::canonical(folder_);
  fs::create_directories(folder_ / "maps" / "inner");
  fs::create_directories(folder_ / "mapsibling");
  fs::create_directory_symlink(folder_ / "mapsibling", folder_ / "maps" / "out");
  fs::create_directory_symlink(folder_ / "maps" / "inner", folder_ / "mapsibling" / "in");
  const fs::path maps = folder_ / "maps";
  EXPECT_EQ(MapPathBelow(maps, "a.ply", ".ply"), top / "maps/a.ply");
  EXPECT_EQ(MapPathBelow(maps, "inner/../inner/a.ply", ".ply"), top / "maps/inner/a.ply");
  EXPECT_EQ(MapPathBelow(maps, folder_ / "mapsibling/in/a.ply", ".ply"), top / "maps/inner/a.ply");
  EXPECT_EQ(MapPathBelow("/", folder_ / "a.ply", ".ply"), top / "a.ply");
  for (const fs::path& path : {fs::path("../a.ply"), folder_ / "a.ply", folder_ / "mapsibling/a.ply",
                               fs::path("/a.ply"), fs::path("out/a.ply"), fs::path("inner/../../a.ply"),
                               fs::path("../none/a.ply"), fs::path("/none/none/a.ply")}) {
    EXPECT_EQ(RefusalOf([&] { MapPathBelow(maps, path, ".ply"); }),
              "path = \"" + path.string() + "\": must lie below " + (top / "maps").string() +
                  ", the parameter save_folder of the map server");
  }
  fs::create_directory(maps / ".ssh");
  for (const char* path : {".a.ply", ".ssh/a.ply", "inner/.a.ply", "none/.a.ply"}) {
    EXPECT_NE(RefusalOf([&] { MapPathBelow(maps, path, ".ply"); }).find("no name may begin with a dot"),
              std::string::npos);
  }
  for (const char* path : {"authorized_keys", "a.pcd", "a.ply.sh"}) {
    EXPECT_NE(RefusalOf([&] { MapPathBelow(maps, path, ".ply"); }).find("must end in .ply"), std::string::npos);
  }
  EXPECT_NE(RefusalOf([&] { MapPathBelow(maps, "a\n[ERROR]: b.ply", ".ply"); }).find("control characters"),
            std::string::npos);
  EXPECT_NE(RefusalOf([&] { MapPathBelow(maps, "none/a.ply", ".ply"); }).find("there is no folder"), std::string::npos);
  EXPECT_NE(RefusalOf([&] { MapPathBelow(maps, "", ".ply"); }).find("names no file"), std::string::npos);
  EXPECT_NE(RefusalOf([&] { MapPathBelow(maps, std::string("a\0b", 3), ".ply"); }).find("control characters"),
            std::string::npos);
  EXPECT_NE(RefusalOf([&] { MapPathBelow(folder_ / "none", "a.ply", ".ply"); }).find("save_folder = "),
            std::string::npos);
}

/// A limit on the size of files stands in for a full disk: writes fail in the middle.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    previous_handler_ = std::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &previous_);
    rlimit limit = previous_;
    limit.rlim_cur = bytes;
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &previous_);
    std::signal(SIGXFSZ, previous_handler_);
  }

 private:
  rlimit previous_{};
  void (*previous_handler_)(int);
};

TEST_F(MapWriterTest, ReportsAFullDiskAndKeepsTheOldFile) {
  for (const MapFormat format : {MapFormat::kPly, MapFormat::kPcd}) {
    for (const bool binary : {true, false}) {
      const fs::path path = folder_ / "map";
      std::ofstream(path) << "old";
      bool reported = false;
      {
        const FileSizeLimit limit(4096);
        try {
          WriteMap(path, {MakeMap(10000)}, format, binary);
        } catch (const ProcessingError&) {
          reported = true;
        }
      }
      EXPECT_TRUE(reported) << "format " << static_cast<int>(format) << ", binary " << binary;
      std::string content;
      std::ifstream(path) >> content;
      EXPECT_EQ(content, "old");
      EXPECT_EQ(FilesInFolder(), 1u);
    }
  }
}

}  // namespace
}  // namespace acmp
