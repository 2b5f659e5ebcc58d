// The work on a cell shared by many group, as on a GPU, against one thread that does all of it.

#include <random>

#include "fill/fill_kernel_fixture.h"
#include "support/group_threads.h"

namespace acmp {
namespace {

constexpr int kThreads = 32;

/// One thread of a warp.
class GroupThread {
 public:
  static constexpr int kSize = kThreads;
  GroupThread(int rank, MeetingPoint<PlaneFit, kThreads>* fits, MeetingPoint<SeedChoice, kThreads>* choices)
      : rank_(rank), fits_(fits), choices_(choices) {}

  int Rank() const { return rank_; }
  void AddUp(PlaneFit* fit) const {
    PlaneFit sum;
    for (const PlaneFit& of_thread : fits_->Meet(rank_, *fit)) {
      sum.s1 += of_thread.s1, sum.sx += of_thread.sx, sum.sy += of_thread.sy;
      sum.sxx += of_thread.sxx, sum.sxy += of_thread.sxy, sum.syy += of_thread.syy;
      sum.q += of_thread.q, sum.qx += of_thread.qx, sum.qy += of_thread.qy;
    }
    *fit = sum;
  }
  void Best(SeedChoice* choice) const {
    for (const SeedChoice& of_thread : choices_->Meet(rank_, *choice)) {
      if (of_thread.views > 0 && (choice->views == 0 || of_thread.IsBetterThan(*choice))) *choice = of_thread;
    }
  }

 private:
  int rank_;
  MeetingPoint<PlaneFit, kThreads>* fits_;
  MeetingPoint<SeedChoice, kThreads>* choices_;
};

TEST(ThreadsOfRowTest, TheFewestThatTakeARowAtOnce) {
  EXPECT_EQ(ThreadsOfRow(1, 15), 1);
  EXPECT_EQ(ThreadsOfRow(8, 15), 8);
  EXPECT_EQ(ThreadsOfRow(32, 33), 32);
  EXPECT_EQ(ThreadsOfRow(32, 17), 32);
  EXPECT_EQ(ThreadsOfRow(32, 16), 16);
  EXPECT_EQ(ThreadsOfRow(32, 15), 16);
  EXPECT_EQ(ThreadsOfRow(32, 11), 16);
  EXPECT_EQ(ThreadsOfRow(32, 1), 1);
}

/// A floor and a wall, noisy, with gaps, in more cells than a fit reaches.
class SharedCellTest : public FillKernelTest {
 protected:
  static constexpr int kCols = 52, kRows = 44;

  SharedCellTest() : FillKernelTest(kCols * kCell, kRows * kCell) {
    std::mt19937 random(7);
    for (int row = 0; row < planes_.height(); ++row) {
      for (int col = 0; col < planes_.width(); ++col) {
        const Vec3f ray = Ray(col, row);
        const float noise = 1 + std::uniform_real_distribution<float>(-0.003f, 0.003f)(random);
        const Vec3f normal = Normalized(row < 90 ? Vec3f{0.2f, 0, -1} : Vec3f{0, -1, -0.4f});
        planes_(col, row) = PlaneThrough(normal, ray, noise * (row < 90 ? 6 + 0.01f * static_cast<float>(col) : 4));
        cost_(col, row) = std::uniform_real_distribution<float>(0, 0.5f)(random);
        support_(col, row) = PackViewSupport(static_cast<int>(random() % 5), static_cast<int>(random() % 3), false, 0);
      }
    }
  }

  /// The group of a warp, each for all cells.
  template <class Work>
  static void OnAllThreads(const Work& work) {
    MeetingPoint<PlaneFit, kThreads> fits;
    MeetingPoint<SeedChoice, kThreads> choices;
    OnThreads(kThreads, [&](int rank) {
      const GroupThread thread(rank, &fits, &choices);
      for (int row = 0; row < kRows; row += 3) {
        for (int col = 0; col < kCols; col += 3) work(col, row, thread);
      }
    });
  }
};

TEST_F(SharedCellTest, ManyThreadsFindTheSameSeeds) {
  FindAll();
  const Image<SeedCell> expected = seeds_.Clone();
  OnAllThreads([&](int col, int row, const GroupThread& thread) { FindSeed(context_, col, row, thread); });
  int found = 0;
  for (int row = 0; row < kRows; row += 3) {
    for (int col = 0; col < kCols; col += 3) {
      found += expected(col, row).views > 0 ? 1 : 0;
      ASSERT_EQ(seeds_(col, row).views, expected(col, row).views) << col << ", " << row;
      ASSERT_EQ(seeds_(col, row).col, expected(col, row).col) << col << ", " << row;
      ASSERT_EQ(seeds_(col, row).row, expected(col, row).row) << col << ", " << row;
    }
  }
  EXPECT_GT(found, 100);
}

TEST_F(SharedCellTest, ManyThreadsFitTheSamePlanes) {
  FindAll();
  FitAll();
  const Image<SeedCell> expected = fitted_.Clone();
  for (SeedCell& cell : fitted_) cell = {};
  OnAllThreads([&](int col, int row, const GroupThread& thread) { FitSeed(context_, col, row, thread); });
  int fitted = 0;
  for (int row = 0; row < kRows; row += 3) {
    for (int col = 0; col < kCols; col += 3) {
      const SeedCell &cell = fitted_(col, row), &of_one = expected(col, row);
      ASSERT_EQ(cell.views, of_one.views);
      if (of_one.views == 0) continue;
      ++fitted;
      const Vec3f ray = Ray(of_one.col, of_one.row);
      // 121 terms summed in another order, and solved for slopes that hang on their differences: some hundred times the
      // rounding of float (6e-8), and far from what a row or column left out would do (the noise is 3e-3).
      ASSERT_NEAR(Dot(cell.inverse_plane, ray) / Dot(of_one.inverse_plane, ray), 1, 1e-5) << col << ", " << row;
      const Vec3f change = cell.inverse_plane - of_one.inverse_plane;
      ASSERT_LT(Norm(change), 1e-4f * Norm(of_one.inverse_plane)) << col << ", " << row;
    }
  }
  EXPECT_GT(fitted, 100);
}

TEST_F(SharedCellTest, LookingAtSeveralCellsAtOnceFindsTheSameNearestSeeds) {
  std::mt19937 random(3);
  for (SeedCell& cell : fitted_) {
    cell.views = random() % 25 == 0 ? 3 : 0;  // far between, so that the search goes on over several times eight cells
    cell.is_strong = cell.views > 0 && random() % 3 == 0;
  }
  for (const int strong_views : {0, 3}) {
    context_.strong_views = strong_views;
    FindAllNearest();
    const Image<NearestSeeds> expected = nearest_.Clone();
    int found = 0;
    for (int row = 0; row < kRows; ++row) {
      for (int col = 0; col < kCols; ++col) {
        for (int direction = 0; direction < kNumDirections; ++direction) {
          nearest_(col, row).cell[direction] = -2;
          FindNearestSeed<8>(context_, col, row, direction);
          const int cell = nearest_(col, row).cell[direction];
          ASSERT_EQ(cell, expected(col, row).cell[direction]) << col << ", " << row << ", direction " << direction;
          found += cell >= 0 ? 1 : 0;
        }
      }
    }
    EXPECT_GT(found, kRows * kCols * kNumDirections / 4) << "sure views: " << strong_views;
    EXPECT_LT(found, kRows * kCols * kNumDirections) << "some look out of the image";
  }
}

}  // namespace
}  // namespace acmp
