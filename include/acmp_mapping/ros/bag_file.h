#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include <ros/time.h>
#include <rosbag/bag.h>

#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {

/// Checks the records of a bag, which rosbag does not, and opens it for read(bag). What rosbag throws, there too,
/// becomes an InvalidInputError that names the file and says whether it is missing, cut off, damaged or no bag;
/// InvalidInputErrors of read go through as they are.
/// @param when_cut_off what to do about a file that was cut off; ends a sentence
/// @param max_bytes that reading a chunk may take
void ReadBag(const std::filesystem::path& path, const char* when_cut_off,
             const std::function<void(const rosbag::Bag&)>& read, size_t max_bytes = kMemoryLimitBytes);

/// Writes a bag as an AtomicFile. The same messages in the same order give the same bytes.
class BagWriter {
 public:
  /// Throws InvalidInputError when `path` cannot name a file, ProcessingError with the system's reason when the folder
  /// cannot be written to.
  explicit BagWriter(const std::filesystem::path& path, Durability durability = Durability::kProcess,
                     rosbag::CompressionType compression = rosbag::compression::Uncompressed);
  /// Without Finish: removes what was written.
  ~BagWriter();
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  /// Throws ProcessingError when the disk is full.
  template <class Message>
  void Write(const std::string& topic, const ros::Time& stamp, const Message& message) {
    Reserve(ros::serialization::serializationLength(message));
    try {
      bag_->write(topic, stamp, message);
    } catch (const rosbag::BagException& error) {
      ThrowWriteError(error.what());
    }
    ++messages_;
  }

  /// Writes the index, reads the bag back (number of messages) and renames it. Throws ProcessingError.
  void Finish();

 private:
  /// Of the disk, for a message of so many bytes and the index. Throws ProcessingError: rosbag's compression cannot be
  /// ended any more once it could not write.
  void Reserve(size_t message_bytes);
  /// Closes the bag without its index, which may not fit on the disk.
  void CloseUnfinished();
  [[noreturn]] void ThrowWriteError(const std::string& reason);

  std::filesystem::path path_;
  AtomicFile file_;  ///< whose temporary file rosbag writes
  std::unique_ptr<rosbag::Bag> bag_;
  size_t messages_ = 0;
  uint64_t reserved_ = 0;
};

}  // namespace acmp
