#include "bag_writer.h"

#include <cerrno>
#include <fstream>
#include <system_error>
#include <utility>

#include <rosbag/view.h>

#include "acmp_mapping/common/error.h"

namespace acmp {

BagWriter::BagWriter(std::filesystem::path path) : path_(std::move(path)), temporary_path_(path_) {
  temporary_path_ += ".partial";
  if (!path_.has_filename() || std::filesystem::is_directory(path_)) {
    throw InvalidInputError(Concat("output ", path_, ": is a folder; give the name of a file"));
  }
  // rosbag does not say why a file cannot be opened: ask the system first.
  errno = 0;
  if (!std::ofstream(temporary_path_)) {
    throw ProcessingError(Concat("cannot write ", temporary_path_, ": ", std::generic_category().message(errno)));
  }
  bag_ = std::make_unique<rosbag::Bag>(temporary_path_.string(), rosbag::bagmode::Write);
}

BagWriter::~BagWriter() {
  if (bag_ == nullptr) return;
  try {
    bag_->close();
  } catch (const rosbag::BagException&) {
    static_cast<void>(bag_.release());  // see ThrowWriteError
  }
  std::error_code ignored;
  std::filesystem::remove(temporary_path_, ignored);
}

void BagWriter::ThrowWriteError(const std::string& reason) {
  const int system_error = errno;
  // rosbag::Bag's destructor writes the index and throws when that fails, which would end the program: leave the object
  // to the end of the process.
  static_cast<void>(bag_.release());
  std::error_code ignored;
  std::filesystem::remove(temporary_path_, ignored);
  throw ProcessingError(Concat("cannot write ", path_, ": ", reason,
                               system_error != 0 ? " (" + std::generic_category().message(system_error) + ")" : ""));
}

void BagWriter::Finish() {
  errno = 0;
  try {
    bag_->close();
    // What is left in C's buffers is written when the file is closed, where rosbag overlooks some errors.
    const rosbag::Bag written(temporary_path_.string(), rosbag::bagmode::Read);
    const size_t readable = rosbag::View(written).size();
    if (readable != messages_) {
      ThrowWriteError(Concat("only ", readable, " of ", messages_, " messages could be read back"));
    }
    std::filesystem::rename(temporary_path_, path_);
  } catch (const rosbag::BagException& error) {
    ThrowWriteError(error.what());
  } catch (const std::filesystem::filesystem_error& error) {
    errno = 0;
    ThrowWriteError(error.what());
  }
  bag_.reset();
}

}  // namespace acmp
