#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "acmp_mapping/common/error.h"

/// What the fuzz targets share. A target gets any bytes, reads them as a file or a message, and must end, without a
/// crash, in a result or in one of our two errors: any other exception is a finding.
namespace acmp::fuzz {

using Target = int (*)(const uint8_t* data, size_t size);

/// Of this program, by name.
inline std::map<std::string, Target>& Targets() {
  static std::map<std::string, Target> targets;
  return targets;
}

struct Registration {
  Registration(const char* name, Target target) { Targets()[name] = target; }
};

/// Runs what may refuse its input.
template <class Read>
void MayRefuse(const Read& read) {
  try {
    read();
  } catch (const InvalidInputError&) {
  } catch (const ProcessingError&) {
  }
}

/// Takes values from the front of an input; at its end zeros and empty texts.
class Bytes {
 public:
  Bytes(const uint8_t* data, size_t size) : rest_(reinterpret_cast<const char*>(data), size) {}

  template <class T>
  T Take() {
    T value{};
    const std::string_view bytes = Front(sizeof(T));
    std::memcpy(&value, bytes.data(), bytes.size());
    return value;
  }
  bool TakeBool() { return (Take<uint8_t>() & 1) != 0; }
  /// Begins with its length, a byte.
  std::string TakeText() { return std::string(Front(Take<uint8_t>())); }
  /// 16 bits; not more than there are, of so many bytes each.
  size_t TakeCount(size_t bytes) { return std::min<size_t>(Take<uint16_t>(), rest_.size() / bytes); }
  std::string_view Rest() { return Front(rest_.size()); }

 private:
  std::string_view Front(size_t bytes) {
    const std::string_view front = rest_.substr(0, bytes);
    rest_.remove_prefix(front.size());
    return front;
  }

  std::string_view rest_;
};

/// The parts of an input between lines "%%", the contents of the files of one folder; as many as asked for.
inline std::vector<std::string_view> Parts(const uint8_t* data, size_t size, size_t count) {
  constexpr std::string_view kSeparator = "\n%%\n";
  std::string_view rest(reinterpret_cast<const char*>(data), size);
  std::vector<std::string_view> parts(count);
  for (std::string_view& part : parts) {
    const size_t end = std::min(rest.find(kSeparator), rest.size());
    part = rest.substr(0, end);
    rest.remove_prefix(std::min(end + kSeparator.size(), rest.size()));
  }
  return parts;
}

/// A folder for the files that a reader is given, of this process alone and gone at its end.
class Folder {
 public:
  Folder() : path_((std::filesystem::temp_directory_path() / "acmp_fuzz_XXXXXX").string()) {
    if (!mkdtemp(path_.data())) std::abort();
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  /// Returns the file's path.
  std::filesystem::path Write(const std::string& name, std::string_view content) const {
    std::filesystem::path path = std::filesystem::path(path_) / name;
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary).write(content.data(), static_cast<std::streamsize>(content.size()));
    return path;
  }
  std::filesystem::path path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace acmp::fuzz

/// The head of a target's function of `data` and `size`, within a source file alone.
#define ACMP_FUZZ_TARGET(name)                                                         \
  static int FuzzTarget_##name(const uint8_t* data, size_t size);                      \
  static const acmp::fuzz::Registration registration_##name(#name, FuzzTarget_##name); \
  static int FuzzTarget_##name(const uint8_t* data, size_t size)
