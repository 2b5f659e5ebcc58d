#include "acmp_mapping/ros/bag_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <system_error>
#include <vector>

#include <rosbag/view.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

const std::filesystem::path& CheckedPath(const std::filesystem::path& path) {
  if (!path.has_filename() || std::filesystem::is_directory(path)) {
    throw InvalidInputError(Concat("output ", path, ": is a folder; give the name of a file"));
  }
  return path;
}

/// rosbag::Bag's destructor writes the index and throws when that fails, which would end the program. It does not say
/// which descriptor is its own: what this process has opened for reading and writing under the name goes to /dev/null
/// from now on. Returns these descriptors.
std::vector<int> DiscardWrites(const std::filesystem::path& path) {
  struct stat wanted = {}, opened = {};
  const int null = open("/dev/null", O_RDWR | O_CLOEXEC);
  if (null < 0) return {};
  std::vector<int> discarded;
  std::error_code error;
  for (std::filesystem::directory_iterator entry("/proc/self/fd", error), end; !error && entry != end;
       entry.increment(error)) {
    const int descriptor = std::atoi(entry->path().filename().c_str());
    if (stat(path.c_str(), &wanted) == 0 && fstat(descriptor, &opened) == 0 && opened.st_ino == wanted.st_ino &&
        opened.st_dev == wanted.st_dev && (fcntl(descriptor, F_GETFL) & O_ACCMODE) == O_RDWR) {
      dup3(null, descriptor, O_CLOEXEC);
      discarded.push_back(descriptor);
    }
  }
  close(null);
  return discarded;
}

/// The first bytes are written here.
std::unique_ptr<rosbag::Bag> OpenBag(const std::filesystem::path& path, const std::filesystem::path& temporary_path) {
  try {
    return std::make_unique<rosbag::Bag>(temporary_path.string(), rosbag::bagmode::Write);
  } catch (const rosbag::BagException& error) {
    throw ProcessingError(Concat("cannot write ", path, ": ", error.what()));
  }
}

}  // namespace

BagWriter::BagWriter(const std::filesystem::path& path, Durability durability, rosbag::CompressionType compression)
    : path_(CheckedPath(path)), file_(path, durability), bag_(OpenBag(path_, file_.temporary_path())) {
  bag_->setCompression(compression);
}

BagWriter::~BagWriter() {
  if (bag_ != nullptr) CloseUnfinished();
}

void BagWriter::Reserve(size_t message_bytes) {
  constexpr uint64_t kStep = 1 << 20, kIndexBytes = 256;  // of a message's index
  const uint64_t needed = bag_->getSize() + 2 * bag_->getChunkThreshold() + 2 * message_bytes + kIndexBytes * messages_;
  if (needed <= reserved_) return;
  reserved_ = needed + kStep;
  file_.Reserve(reserved_);
}

void BagWriter::CloseUnfinished() {
  const std::vector<int> descriptors = DiscardWrites(file_.temporary_path());
  try {
    bag_->close();
    bag_.reset();
  } catch (const rosbag::BagException&) {
    static_cast<void>(bag_.release());  // its destructor would throw, which ends the program
    for (const int descriptor : descriptors) close(descriptor);
  }
}

void BagWriter::ThrowWriteError(const std::string& reason) {
  const int system_error = errno;
  CloseUnfinished();
  throw ProcessingError(Concat("cannot write ", path_, ": ", reason,
                               system_error != 0 ? " (" + std::generic_category().message(system_error) + ")" : ""));
}

void BagWriter::Finish() {
  errno = 0;
  try {
    bag_->close();
    // What is left in C's buffers is written when the file is closed, where rosbag overlooks some errors.
    const rosbag::Bag written(file_.temporary_path().string(), rosbag::bagmode::Read);
    const size_t readable = rosbag::View(written).size();
    if (readable != messages_) {
      ThrowWriteError(Concat("only ", readable, " of ", messages_, " messages could be read back"));
    }
  } catch (const rosbag::BagException& error) {
    ThrowWriteError(error.what());
  }
  bag_.reset();
  file_.Commit();
}

}  // namespace acmp
