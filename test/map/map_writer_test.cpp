#include "acmp_mapping/map/map_writer.h"

#include <csignal>
#include <fstream>

#include <gtest/gtest.h>
#include <sys/resource.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"

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
    WriteMap(folder_ / "map.ply", map, MapFormat::kPly, binary);
    const PointCloud read = ReadPly(folder_ / "map.ply");
    ASSERT_EQ(read.size(), map.size());
    EXPECT_EQ(read[4].position.x, map[4].position.x);
    EXPECT_EQ(read[4].normal.z, map[4].normal.z);
    EXPECT_EQ(read[4].color.b, map[4].color.b);
    EXPECT_EQ(read[4].confidence, map[4].confidence) << "binary " << binary;
  }
  EXPECT_EQ(FilesInFolder(), 1u) << "no temporary file is left";
}

TEST_F(MapWriterTest, RefusesAnEmptyMapAndBadPaths) {
  const PointCloud map = MakeMap(3);
  for (const MapFormat format : {MapFormat::kPly, MapFormat::kPcd}) {
    EXPECT_THROW(WriteMap(folder_ / "map", {}, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap("", map, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap(folder_, map, format, true), InvalidInputError);
    EXPECT_THROW(WriteMap(folder_ / "missing" / "map", map, format, true), InvalidInputError);
  }
  EXPECT_EQ(FilesInFolder(), 0u);
  try {
    WriteMap(folder_ / "missing" / "map.pcd", map, MapFormat::kPcd, true);
  } catch (const InvalidInputError& error) {
    EXPECT_NE(std::string(error.what()).find("missing/map.pcd"), std::string::npos) << error.what();
  }
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
          WriteMap(path, MakeMap(10000), format, binary);
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
