// Runs on several devices: the same files, and which views are fused when and where.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <set>
#include <thread>

#include "acmp_mapping/dataset/map_io.h"
#include "fusion/engine_views.h"
#include "reconstruction/run_fixture.h"
#include "support/pass_result.h"

namespace acmp {
namespace {

/// Only a deadlock takes so long.
constexpr std::chrono::seconds kHang{60};

/// Which images are fused at the moment and in which order they were.
class Fusions {
 public:
  void Begin(int image) {
    const std::lock_guard<std::mutex> lock(mutex_);
    running_.insert(image);
    for (int other : running_) together_.insert({std::min(image, other), std::max(image, other)});
  }
  void End(int image) {
    const std::lock_guard<std::mutex> lock(mutex_);
    running_.erase(image);
    order_.push_back(image);
    changed_.notify_all();
  }
  /// False if the image is not fused before long.
  bool WaitFor(int image) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, kHang, [&] { return std::count(order_.begin(), order_.end(), image) > 0; });
  }
  const std::vector<int>& order() const { return order_; }
  bool WereTogether(int a, int b) const { return together_.count({std::min(a, b), std::max(a, b)}) > 0; }
  size_t PlaceOf(int image) const {
    return static_cast<size_t>(std::find(order_.begin(), order_.end(), image) - order_.begin());
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::set<int> running_;
  std::set<std::pair<int, int>> together_;
  std::vector<int> order_;
};

using Sources = std::vector<std::vector<int>>;

/// The three images before and after each.
Sources Sequence(int images) {
  Sources sources(static_cast<size_t>(images));
  for (int i = 0; i < images; ++i) {
    for (int step : {1, -1, 2, -2, 3, -3}) {
      if (i + step >= 0 && i + step < images) sources[static_cast<size_t>(i)].push_back(i + step);
    }
  }
  return sources;
}

/// Groups of three images that see each other.
Sources Groups(int images) {
  Sources sources(static_cast<size_t>(images));
  for (int i = 0; i < images; ++i) {
    for (int other = i / 3 * 3; other < i / 3 * 3 + 3; ++other) {
      if (other != i) sources[static_cast<size_t>(i)].push_back(other);
    }
  }
  return sources;
}

class ReconstructDevicesTest : public ReconstructRunFixture {
 protected:
  static constexpr int kTwelve = 12;

  void WriteTwelve(const Sources& sources) {
    WriteScene(kTwelve, kWidth, kHeight);
    WritePairs(sources);
    options_.quiet = true;
  }

  void RunOnFakeGpus(const std::string& name, int devices, int jobs = 2) {
    options_.output = output(name);
    Reconstruct(options_, {[&] { return FakeGpus(devices, jobs, &gpus_); }, watcher_, out_, log_, false});
  }

  FakeGpuBehaviour gpus_;
};

TEST_F(ReconstructDevicesTest, AnyNumberOfDevicesGivesTheSameFiles) {
  for (const Sources& sources : {Sequence(kTwelve), Groups(kTwelve)}) {
    WriteTwelve(sources);
    options_.overwrite = true;
    RunTo("cpu");
    ASSERT_GT(ReadPly(output("cpu") / "fused.ply").vertices.size(), 500u);
    for (int devices : {1, 2, 3}) {
      for (const double memory_limit_gb : {4.0, 0.0}) {
        options_.memory_limit_gb = memory_limit_gb;
        RunOnFakeGpus("gpu", devices);
        ExpectSameContents(output("cpu"), output("gpu"));
      }
      options_.memory_limit_gb = 4;
    }
  }
}

TEST_F(ReconstructDevicesTest, ViewsWithoutACommonFrameDoNotWaitForEachOther) {
  WriteTwelve(Groups(kTwelve));
  RunTo("cpu");
  Fusions fusions;
  bool waited_in_vain = false;
  gpus_.before = [&](int device, int image, int rank) {
    EXPECT_EQ(device, image / 6) << "fused where its maps are";
    EXPECT_EQ(rank, image);
    if (image == 0) waited_in_vain = !fusions.WaitFor(kTwelve - 1);
    fusions.Begin(image);
  };
  gpus_.after = [&](int, int image, int) { fusions.End(image); };
  RunOnFakeGpus("gpu", 2);
  EXPECT_FALSE(waited_in_vain) << "the last image waited for the first";
  ExpectSameContents(output("cpu"), options_.output);
}

TEST_F(ReconstructDevicesTest, PointsThatWaitStayWithinTheirMemory) {
  WriteTwelve(Groups(kTwelve));
  constexpr int kWaiting = 2;  // images whose points may wait for those of earlier ones
  options_.memory_limit_gb = (kWaiting + 0.5) * kWidth * kHeight * sizeof(SurfacePoint) / 0.1 * 1e-9;
  std::mutex mutex;
  std::set<int> begun;
  int most_ahead = 0;
  gpus_.before = [&](int, int image, int) {
    if (image == 0) std::this_thread::sleep_for(std::chrono::milliseconds(100));  // others may overtake it
    const std::lock_guard<std::mutex> lock(mutex);
    begun.insert(image);
    for (int first = 0; first < image; ++first) {
      if (begun.count(first) == 0) most_ahead = std::max(most_ahead, image - first);
    }
  };
  RunOnFakeGpus("gpu", 2);
  EXPECT_LE(most_ahead, kWaiting);
}

TEST_F(ReconstructDevicesTest, ViewsWithACommonFrameAreFusedInOrder) {
  for (const Sources& sources : {Sequence(kTwelve), Groups(kTwelve)}) {
    WriteTwelve(sources);
    options_.overwrite = true;
    Fusions fusions;
    gpus_.before = [&](int, int image, int) {
      fusions.Begin(image);
      std::this_thread::sleep_for(std::chrono::milliseconds(image % 3));
    };
    gpus_.after = [&](int, int image, int) { fusions.End(image); };
    RunOnFakeGpus("gpu", 3);
    for (int b = 0; b < kTwelve; ++b) {
      for (int a = 0; a < b; ++a) {
        if (!HaveCommonFrame(sources, a, b)) continue;
        EXPECT_FALSE(fusions.WereTogether(a, b)) << a << ", " << b;
        EXPECT_LT(fusions.PlaceOf(a), fusions.PlaceOf(b));
      }
    }
  }
}

class DeviceMemoryTest : public ReconstructDevicesTest {
 protected:
  /// A run on one GPU with so much free memory. Returns how many estimates were in work files at most when a view was
  /// fused.
  size_t EstimatesInFiles(const std::string& name, size_t free_bytes) {
    gpus_.free_bytes = free_bytes;
    std::mutex mutex;
    size_t most = 0;
    gpus_.before = [&](int, int, int) {
      const std::lock_guard<std::mutex> lock(mutex);
      size_t estimates = 0;
      std::error_code gone;  // other threads write and remove files meanwhile
      const std::filesystem::recursive_directory_iterator end;
      for (std::filesystem::recursive_directory_iterator file(output(name) / "work", gone); file != end;
           file.increment(gone)) {
        estimates += file->path().has_extension() ? 1 : 0;
      }
      most = std::max(most, estimates);
    };
    RunOnFakeGpus(name, 1);
    return most;
  }
};

TEST_F(DeviceMemoryTest, WhatDoesNotFitIntoMemoryIsInFiles) {
  WriteTwelve(Sequence(kTwelve));
  RunTo("cpu");
  EXPECT_EQ(EstimatesInFiles("enough", size_t{1} << 30), 0u);
  const size_t all = EstimatesInFiles("none", 0);
  const size_t some = EstimatesInFiles("little", 250 * kWidth * kHeight * sizeof(float));
  EXPECT_GT(some, 0u);
  EXPECT_GT(all, some);
  for (const char* name : {"enough", "none", "little"}) ExpectSameContents(output("cpu"), output(name));
}

TEST_F(DeviceMemoryTest, EstimatesGoWithTheirLastReader) {
  // Groups of three images that see each other: while one is matched all that is needed are its own estimates, of two
  // steps at most and what a step under way has made, and the final ones of views that still wait for their fusion.
  WriteTwelve(Groups(kTwelve));
  constexpr size_t kNeeded = 2 * 3 + 2 + kTwelve;
  size_t most = 0;
  gpus_.before_pass = [&] { most = std::max(most, gpus_.NumEstimatesAlive()); };
  RunOnFakeGpus("gpu", 1, 1);
  EXPECT_LE(most, kNeeded);
  EXPECT_GT(gpus_.estimates.size(), 2 * kNeeded) << "few were made: the test shows nothing";
  EXPECT_EQ(gpus_.NumEstimatesAlive(), 0u);
  gpus_.before_pass = [] {};
  EXPECT_LE(EstimatesInFiles("files", 0), kNeeded) << "those that found no room, too";
  // For that, steps that are farther on go first.
  options_.output = output("cpu");
  Run(&fake_);
  const auto is = [](const char* pass) { return [pass](const auto& call) { return call.pass == pass; }; };
  const auto first_geometric = std::find_if(fake_.calls.begin(), fake_.calls.end(), is("geometric 0"));
  EXPECT_TRUE(std::any_of(first_geometric, fake_.calls.end(), is("photometric")));
}

TEST_F(DeviceMemoryTest, ARunThatFailsAnywhereCanGoOn) {
  WriteTwelve(Sequence(kTwelve));
  RunTo("cpu");
  std::atomic<int> passes{0};
  gpus_.before_pass = [&] { ++passes; };
  RunOnFakeGpus("gpu", 1);
  const int all_passes = passes;
  for (const size_t room : {0, 250, 40000}) {
    gpus_.free_bytes = room * kWidth * kHeight * sizeof(float);
    for (int failing = 1; failing < all_passes; failing += 9) {
      const std::string name = Concat("gpu_", room, "_", failing);
      passes = 0;
      gpus_.before_pass = [&] {
        if (++passes == failing) throw ProcessingError("device lost");
      };
      EXPECT_EQ(MessageOf<ProcessingError>([&] { RunOnFakeGpus(name, 1); }), "device lost");
      const int begun = passes;
      passes = 0;
      gpus_.before_pass = [&] { ++passes; };
      RunOnFakeGpus(name, 1);
      ExpectSameContents(output("cpu"), output(name));
      EXPECT_LE(passes, all_passes);
      // With all in files only what the two threads had begun is made again.
      if (room == 0) {
        EXPECT_LE(passes, all_passes - begun + 2) << failing;
      }
    }
  }
}

TEST_F(ReconstructDevicesTest, OnlineRunsAreFusedWithTheMappersSources) {
  WriteTwelve(Sequence(kTwelve));
  options_.schedule = "online";
  RunTo("cpu");
  // Refined again, all have ten sources instead of two to ten, and a point takes the pixels of each: 405 points.
  ASSERT_GT(ReadPly(output("cpu") / "fused.ply").vertices.size(), 300u);
  for (const int devices : {1, 2}) {
    RunOnFakeGpus(Concat("gpu_", devices), devices);
    ExpectSameContents(output("cpu"), options_.output);
  }
}

class ReconstructImagesTest : public ReconstructRunFixture {
 protected:
  std::vector<InputImage> Images() {
    std::vector<std::string> warnings;
    return ReadInputImages(options_, watcher_, &warnings);
  }

  ImageReconstruction RunOn(const DeviceMaker& make_devices) {
    return ReconstructImages(Images(), options_, make_devices, &watcher_);
  }

  void ExpectFilesOfTool(const ImageReconstruction& result) const {
    ASSERT_EQ(result.images.size(), size_t{kImages});
    for (int i = 0; i < kImages; ++i) {
      const ImageResult& image = result.images[static_cast<size_t>(i)];
      const std::string name = "/00000" + std::to_string(i) + ".pfm";
      EXPECT_TRUE(SamePixels(image.maps.depth, ReadPfm(output() / ("depth" + name))));
      EXPECT_TRUE(SamePixels(image.maps.cost, ReadPfm(output() / ("cost" + name))));
      EXPECT_TRUE(SamePixels(image.maps.confidence, ReadPfm(output() / ("confidence" + name))));
      EXPECT_EQ(image.maps.normal.size(), image.maps.depth.size());
    }
    const PointCloud cloud = ReadPly(output() / "fused.ply").vertices;
    ASSERT_EQ(result.cloud.size(), cloud.size());
    for (size_t i = 0; i < cloud.size(); ++i) {
      ASSERT_EQ(std::memcmp(&result.cloud[i].position, &cloud[i].position, sizeof(Vec3f)), 0) << i;
    }
  }

  FakeGpuBehaviour gpus_;
};

TEST_F(ReconstructImagesTest, BitsOfTheToolOnAnyDeviceWithAnyMemory) {
  options_.max_image_size = 18;
  Run(&fake_);
  ExpectFilesOfTool(RunOn([&] { return FakeHost(&fake_); }));
  for (const size_t free_bytes : {size_t{1} << 30, size_t{60000}, size_t{1}}) {
    SCOPED_TRACE(free_bytes);
    gpus_.free_bytes = free_bytes;
    ExpectFilesOfTool(RunOn([&] { return FakeGpus(2, 2, &gpus_); }));
    EXPECT_EQ(gpus_.NumEstimatesAlive(), 0u);
  }
}

}  // namespace
}  // namespace acmp
