#include "cuda_device.h"
#include "support/error_text.h"

#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <shared_mutex>
#include <thread>

namespace acmp {
namespace {

TEST(NoDeviceReasonTest, EachCauseHasItsWord) {
  EXPECT_THAT(NoDeviceReason(cudaErrorInsufficientDriver, 0, 13000, ""), StartsWith("no NVIDIA driver"));
  EXPECT_THAT(NoDeviceReason(cudaErrorInsufficientDriver, 11040, 13020, ""),
              AllOf(StartsWith("the NVIDIA driver is too old"), HasSubstr("11.4"), HasSubstr("13.2")));
  EXPECT_THAT(NoDeviceReason(cudaErrorNoDevice, 13000, 13000, "/dev/nvidia0"),
              AllOf(StartsWith("no permission"), HasSubstr("/dev/nvidia0")));
  EXPECT_THAT(NoDeviceReason(cudaErrorNoDevice, 13000, 13000, ""), HasSubstr("no GPU"));
  EXPECT_EQ(NoDeviceReason(cudaErrorECCUncorrectable, 13000, 13000, ""), cudaGetErrorString(cudaErrorECCUncorrectable));
}

class ForbiddenDeviceFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/acmp_devices_XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    folder_ = name;
    chmod(name, 0755);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  void Add(const std::string& name, mode_t mode) const {
    std::ofstream(folder_ + "/" + name) << "";
    ASSERT_EQ(chmod((folder_ + "/" + name).c_str(), mode), 0);
  }
  /// As a user without privileges sees it.
  std::string Found() const {
    const bool is_root = geteuid() == 0;
    constexpr uid_t kNobody = 65534;
    EXPECT_TRUE(!is_root || seteuid(kNobody) == 0);
    const std::string found = ForbiddenDeviceFile(folder_);
    EXPECT_TRUE(!is_root || seteuid(0) == 0);
    return found;
  }

  std::string folder_;
};

TEST_F(ForbiddenDeviceFileTest, NamesTheFileOfAGpu) {
  Add("nvidia0", 0666);
  Add("sda", 0);
  EXPECT_EQ(Found(), "");
  Add("nvidiactl", 0);
  EXPECT_EQ(Found(), folder_ + "/nvidiactl");
}

TEST_F(ForbiddenDeviceFileTest, ReadingIsNotEnough) {
  Add("nvmap", 0444);
  EXPECT_EQ(Found(), folder_ + "/nvmap");
}

TEST_F(ForbiddenDeviceFileTest, NoFolderIsNoFile) {
  folder_ += "/none";
  EXPECT_EQ(Found(), "");
}

TEST(FairSharedMutexTest, WhoWaitsToBeAloneGoesBeforeReadersThatComeLater) {
  FairSharedMutex mutex;
  mutex.lock_shared();
  std::atomic<bool> was_alone{false};
  std::thread alone([&] {
    const std::lock_guard<FairSharedMutex> lock(mutex);
    was_alone = true;
  });
  // From when the other thread waits on no reader comes in. Where readers go first this never ends.
  while (mutex.try_lock_shared()) mutex.unlock_shared();
  EXPECT_FALSE(was_alone);
  mutex.unlock_shared();
  alone.join();
  EXPECT_TRUE(was_alone);
  const std::shared_lock<FairSharedMutex> reader(mutex);
  EXPECT_TRUE(mutex.try_lock_shared()) << "readers share it";
  mutex.unlock_shared();
}

}  // namespace
}  // namespace acmp
