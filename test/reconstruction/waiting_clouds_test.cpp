#include "waiting_clouds.h"

#include <gmock/gmock.h>

#include <thread>

#include "acmp_mapping/common/error.h"
#include "dataset/test_folder.h"
#include "fusion/engine_views.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

PointCloud CloudOf(int points, float x) {
  PointCloud cloud(static_cast<size_t>(points));
  for (int i = 0; i < points; ++i) {
    cloud[static_cast<size_t>(i)] = {{x, static_cast<float>(i), 2}, {0, 0.6f, -0.8f}, {1, 2, 3}, 0.5f};
  }
  return cloud;
}

class WaitingCloudsTest : public TestFolder {
 protected:
  std::filesystem::path FileOf(int index) const { return out_.WorkFile(WaitingClouds::kKind, index); }

  const OutputFolder out_{folder() / "out", {}, false};
  WaitingClouds clouds_{&out_, 10 * sizeof(SurfacePoint)};
};

TEST_F(WaitingCloudsTest, FilesTakeWhatMemoryDoesNot) {
  for (int i = 0; i < 4; ++i) clouds_.Put(i, CloudOf(5, static_cast<float>(i)));
  EXPECT_FALSE(std::filesystem::exists(FileOf(0)) || std::filesystem::exists(FileOf(1)));
  EXPECT_TRUE(std::filesystem::exists(FileOf(2)) && std::filesystem::exists(FileOf(3)));
  for (int i : {2, 0}) EXPECT_EQ(FirstDifference(clouds_.Take(i), CloudOf(5, static_cast<float>(i))), "");
  EXPECT_FALSE(std::filesystem::exists(FileOf(2))) << "nobody reads it again";
  clouds_.Put(4, CloudOf(6, 4));  // more than has become free
  clouds_.Put(5, CloudOf(5, 5));
  EXPECT_TRUE(std::filesystem::exists(FileOf(4)));
  EXPECT_FALSE(std::filesystem::exists(FileOf(5)));
  for (int i : {5, 3, 1}) EXPECT_EQ(FirstDifference(clouds_.Take(i), CloudOf(5, static_cast<float>(i))), "");
  EXPECT_EQ(FirstDifference(clouds_.Take(4), CloudOf(6, 4)), "");
}

TEST_F(WaitingCloudsTest, AFileOfAnEarlierRunIsOverwritten) {
  WaitingClouds earlier(&out_, 0), later(&out_, 0);
  earlier.Put(3, CloudOf(9, 1));
  later.Put(3, CloudOf(4, 2));
  EXPECT_EQ(FirstDifference(later.Take(3), CloudOf(4, 2)), "");
}

TEST_F(WaitingCloudsTest, ADamagedFileIsAnError) {
  WaitingClouds in_files(&out_, 0);
  in_files.Put(0, CloudOf(5, 0));
  std::filesystem::resize_file(FileOf(0), 20);
  EXPECT_THAT(MessageOf<ProcessingError>([&] { in_files.Take(0); }), HasSubstr("5 points of " + FileOf(0).string()));
}

TEST_F(WaitingCloudsTest, AFileThatCannotBeWrittenIsAnError) {
  WaitingClouds in_files(&out_, 0);
  WriteText("out/work/clouds", "in the way of the folder");
  EXPECT_THROW(in_files.Put(0, CloudOf(5, 0)), InvalidInputError);  // as any folder that cannot be
}

TEST_F(WaitingCloudsTest, SeveralThreadsPutWhileAnotherTakes) {
  constexpr int kEach = 200;
  std::vector<std::thread> threads;
  for (int first : {0, 1}) {
    threads.emplace_back([&, first] {
      for (int i = first; i < 2 * kEach; i += 2) clouds_.Put(i, CloudOf(i % 4, static_cast<float>(i)));
    });
  }
  for (std::thread& thread : threads) thread.join();
  threads.clear();
  threads.emplace_back([&] {
    for (int i = 0; i < kEach; ++i) clouds_.Put(2 * kEach + i, CloudOf(i % 4, static_cast<float>(i)));
  });
  for (int i = 0; i < 2 * kEach; ++i) {
    EXPECT_EQ(FirstDifference(clouds_.Take(i), CloudOf(i % 4, static_cast<float>(i))), "") << i;
  }
  threads[0].join();
  for (int i = 0; i < kEach; ++i) {
    EXPECT_EQ(FirstDifference(clouds_.Take(2 * kEach + i), CloudOf(i % 4, static_cast<float>(i))), "") << i;
  }
}

}  // namespace
}  // namespace acmp
