#include "acmp_mapping/ros/bag_file.h"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <rosbag/chunked_file.h>
#include <rosbag/stream.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr std::string_view kFirstLine = "#ROSBAG V2.0\n";

enum Op : uint8_t { kMessage = 2, kFileHeader = 3, kIndex = 4, kChunk = 5, kChunkInfo = 6, kConnection = 7 };

template <class T>
T NumberAt(std::string_view bytes, size_t position) {
  T value;
  std::memcpy(&value, bytes.data() + position, sizeof(T));
  return value;
}

/// The fields of a record's header: each has its length, its name, = and its value.
class RecordHeader {
 public:
  explicit RecordHeader(std::string_view bytes) {
    while (!bytes.empty()) {
      if (bytes.size() < sizeof(uint32_t)) throw InvalidInputError("a record's header ends within a field");
      const auto length = NumberAt<uint32_t>(bytes, 0);
      bytes.remove_prefix(sizeof(uint32_t));
      const size_t equals = bytes.substr(0, length).find('=');
      if (length > bytes.size() || equals == std::string_view::npos) {
        throw InvalidInputError("a record's header has a field that is none");
      }
      fields_[bytes.substr(0, equals)] = bytes.substr(equals + 1, length - equals - 1);
      bytes.remove_prefix(length);
    }
  }

  template <class T>
  T Number(const char* name) const {
    const std::string_view field = Text(name);
    if (field.size() != sizeof(T)) {
      throw InvalidInputError(
          Concat("field ", name, " of a record has ", field.size(), " bytes instead of ", sizeof(T)));
    }
    return NumberAt<T>(field, 0);
  }
  std::string_view Text(const char* name) const {
    const auto field = fields_.find(name);
    if (field == fields_.end()) throw InvalidInputError(Concat("a record has no field ", name));
    return field->second;
  }

 private:
  std::map<std::string_view, std::string_view> fields_;
};

/// Connections of the messages that begin at these positions of an unpacked chunk.
std::map<uint32_t, uint32_t> FindMessages(std::string_view chunk) {
  std::map<uint32_t, uint32_t> connections;
  size_t position = 0;
  const auto take = [&] {
    const size_t left = chunk.size() - position;
    const uint32_t length = left < sizeof(uint32_t) ? 0 : NumberAt<uint32_t>(chunk, position);
    if (left < sizeof(uint32_t) || length > left - sizeof(uint32_t)) {
      throw InvalidInputError("a chunk ends within a record");
    }
    position += sizeof(uint32_t) + length;
    return chunk.substr(position - length, length);
  };
  while (position < chunk.size()) {
    const auto begin = static_cast<uint32_t>(position);
    const RecordHeader header(take());
    take();
    if (header.Number<uint8_t>("op") == kMessage) connections[begin] = header.Number<uint32_t>("conn");
  }
  return connections;
}

/// Reads all records of a bag and checks what rosbag follows without looking: lengths, and the positions of chunks and
/// messages that the index gives. rosbag would read, and write, wherever these lead it.
class RecordReader {
 public:
  /// @param max_bytes that reading a chunk may take
  RecordReader(const std::filesystem::path& path, size_t max_bytes)
      : file_(path, std::ios::binary), size_(std::filesystem::file_size(path)), max_bytes_(max_bytes) {}

  /// Throws InvalidInputError without the file's name. A bag without index, which rosbag refuses, is left to it.
  void Check() {
    if (Take(kFirstLine.size()) != kFirstLine) throw InvalidInputError("is no bag of version 2.0");
    bool is_first = true;
    while (position_ < size_) {
      records_.insert(position_);
      const uint64_t begin = position_;
      const std::string header_bytes = TakeBlock();
      const RecordHeader header(header_bytes);
      const auto op = header.Number<uint8_t>("op");
      if (is_first && op != kFileHeader) throw InvalidInputError("its first record is not that of a bag");
      if (is_first) index_position_ = header.Number<uint64_t>("index_pos");
      if (index_position_ == 0) return;
      is_first = false;
      CheckRecord(begin, op, header);
    }
    if (index_position_ != size_ && records_.count(index_position_) == 0) {
      throw InvalidInputError(Concat("its index is to be at byte ", index_position_, ", where no record begins"));
    }
    for (const uint64_t position : chunks_of_index_) {
      if (chunks_.count(position) > 0) continue;
      throw InvalidInputError(Concat("its index has a chunk at byte ", position, ", where none begins"));
    }
  }

 private:
  void CheckRecord(uint64_t begin, uint8_t op, const RecordHeader& header) {
    if (op == kChunk) {
      chunks_.insert(begin);
      messages_ = FindMessages(Unpack(header, TakeBlock()));
    } else if (op == kIndex) {
      CheckIndex(header);
    } else if (op == kChunkInfo) {
      chunks_of_index_.push_back(header.Number<uint64_t>("chunk_pos"));
      CheckCount(header, TakeBlock(), 8);
    } else {
      TakeBlock();
    }
  }

  void CheckIndex(const RecordHeader& header) {
    constexpr size_t kEntryBytes = 12, kOffsetAt = 8;
    const std::string entries = TakeBlock();
    CheckCount(header, entries, kEntryBytes);
    const auto connection = header.Number<uint32_t>("conn");
    for (size_t at = kOffsetAt; at < entries.size(); at += kEntryBytes) {
      const auto offset = NumberAt<uint32_t>(entries, at);
      const auto message = messages_.find(offset);
      if (message != messages_.end() && message->second == connection) continue;
      throw InvalidInputError(Concat("its index has a message of connection ", connection, " at byte ", offset,
                                     " of a chunk, where none begins"));
    }
  }

  static void CheckCount(const RecordHeader& header, const std::string& data, size_t bytes_each) {
    const auto count = header.Number<uint32_t>("count");
    if (data.size() == count * bytes_each) return;
    throw InvalidInputError(Concat("a part of its index has ", data.size(), " bytes for ", count, " entries"));
  }

  std::string_view Unpack(const RecordHeader& header, const std::string& packed) {
    constexpr uint64_t kCopies = 3;  // rosbag's, the message that it makes of it, and what the reader makes of that
    const auto size = header.Number<uint32_t>("size");
    CheckMemory(Concat("a chunk of ", packed.size(), " bytes, ", size, " unpacked,"), size, kCopies, max_bytes_);
    const std::string_view compression = header.Text("compression");
    rosbag::CompressionType type = rosbag::compression::Uncompressed;
    if (compression == "bz2") {
      type = rosbag::compression::BZ2;
    } else if (compression == "lz4") {
      type = rosbag::compression::LZ4;
    } else if (compression != "none") {
      throw InvalidInputError(Concat("a chunk has compression \"", compression, "\": must be none, bz2 or lz4"));
    } else if (size != packed.size()) {
      throw InvalidInputError(Concat("a chunk has ", packed.size(), " bytes instead of ", size));
    }
    unpacked_.assign(size, 0);
    std::vector<uint8_t> source(packed.begin(), packed.end());  // rosbag's parameter is not const
    streams_.getStream(type)->decompress(unpacked_.data(), size, source.data(), static_cast<unsigned>(source.size()));
    return {reinterpret_cast<const char*>(unpacked_.data()), size};
  }

  std::string Take(uint64_t bytes) {
    if (bytes > size_ - position_) {
      throw InvalidInputError(Concat("a record at byte ", position_, " would have ", bytes, " bytes, and the file has ",
                                     size_ - position_, " more"));
    }
    std::string taken(bytes, '\0');
    if (!file_.read(taken.data(), static_cast<std::streamsize>(bytes))) throw InvalidInputError("cannot be read");
    position_ += bytes;
    return taken;
  }
  /// With its length before it.
  std::string TakeBlock() { return Take(NumberAt<uint32_t>(Take(sizeof(uint32_t)), 0)); }

  std::ifstream file_;
  const uint64_t size_;
  const size_t max_bytes_;
  uint64_t position_ = 0;
  uint64_t index_position_ = 0;
  std::set<uint64_t> records_, chunks_;  ///< where they begin
  std::vector<uint64_t> chunks_of_index_;
  std::map<uint32_t, uint32_t> messages_;  ///< of the last chunk
  std::vector<uint8_t> unpacked_;
  rosbag::ChunkedFile no_file_;
  rosbag::StreamFactory streams_{&no_file_};
};

/// Whether the path is a recording of ROS 2, or its folder: by its first bytes, or by the list of its files.
bool IsOfRos2(const std::filesystem::path& path) {
  if (std::filesystem::is_directory(path)) return std::filesystem::is_regular_file(path / "metadata.yaml");
  if (!std::filesystem::is_regular_file(path)) return false;  // a pipe would be waited for
  constexpr std::string_view kSqlite("SQLite format 3\0", 16), kMcap("\x89MCAP0\r\n", 8);
  std::string begin(kSqlite.size(), '\0');
  std::ifstream(path, std::ios::binary).read(begin.data(), static_cast<std::streamsize>(begin.size()));
  return begin == kSqlite || begin.compare(0, kMcap.size(), kMcap) == 0;
}

}  // namespace

void ReadBag(const std::filesystem::path& path, const char* when_cut_off,
             const std::function<void(const rosbag::Bag&)>& read, size_t max_bytes) {
  if (IsOfRos2(path)) {
    const std::filesystem::path folder =
        std::filesystem::is_directory(path) ? path : std::filesystem::absolute(path).parent_path();
    throw InvalidInputError(Concat(path, ": is a recording of ROS 2. Make a bag of it with: rosbags-convert --src ",
                                   folder, " --dst NAME.bag --dst-typestore ros1_noetic (pip install rosbags)"));
  }
  if (!std::filesystem::exists(path)) throw InvalidInputError(Concat(path, ": no such file"));
  if (!std::filesystem::is_regular_file(path)) {
    throw InvalidInputError(Concat(path, ": is a folder, device, pipe or socket: give the name of a file"));
  }
  if (!std::ifstream(path)) throw InvalidInputError(Concat(path, ": cannot be opened: ", std::strerror(errno)));
  bool opened = false;
  try {
    RecordReader(path, max_bytes).Check();
    const rosbag::Bag bag(path.string(), rosbag::bagmode::Read);
    opened = true;
    read(bag);
  } catch (const rosbag::BagUnindexedException&) {
    throw InvalidInputError(Concat(path, ": has no index, so it was cut off; ", when_cut_off));
  } catch (const std::exception& error) {
    // Of a bag: rosbag's and roscpp's, and out of memory or range from corrupt lengths.
    const bool is_of_bag = dynamic_cast<const ros::Exception*>(&error) || dynamic_cast<const std::bad_alloc*>(&error) ||
                           dynamic_cast<const std::logic_error*>(&error);
    if (opened && !is_of_bag) throw;
    throw InvalidInputError(Concat(path, ": is truncated, corrupt or not a bag: ", error.what()));
  }
}

}  // namespace acmp
