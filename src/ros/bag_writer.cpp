#include "acmp_mapping/ros/bag_writer.h"

#include <cerrno>
#include <system_error>

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

}  // namespace

BagWriter::BagWriter(const std::filesystem::path& path, Durability durability, rosbag::CompressionType compression)
    : path_(CheckedPath(path)),
      file_(path, durability),
      bag_(std::make_unique<rosbag::Bag>(file_.temporary_path().string(), rosbag::bagmode::Write)) {
  bag_->setCompression(compression);
}

BagWriter::~BagWriter() {
  if (bag_ == nullptr) return;
  try {
    bag_->close();
  } catch (const rosbag::BagException&) {
    static_cast<void>(bag_.release());  // see ThrowWriteError
  }
}

void BagWriter::ThrowWriteError(const std::string& reason) {
  const int system_error = errno;
  // rosbag::Bag's destructor writes the index and throws when that fails, which would end the program: leave the object
  // to the end of the process. It keeps the file open: what has been written must not fill the disk until then.
  static_cast<void>(bag_.release());
  std::error_code ignored;
  std::filesystem::resize_file(file_.temporary_path(), 0, ignored);
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
