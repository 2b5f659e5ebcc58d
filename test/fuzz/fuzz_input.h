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

#include "acmp_mapping/common/error.h"

/// What the fuzz targets share. A target gets any bytes, reads them as a file or a message, and must end, without a
/// crash, in a result or in one of our two errors: any other exception is a finding.
namespace acmp::fuzz {

/// Takes values from the front of an input; at its end zeros and empty texts.
class Bytes {
 public:
  explicit Bytes(std::string_view input) : rest_(input) {}

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
  /// Up to a line "%%", or the end: the content of one of several files.
  std::string_view TakePart() {
    constexpr std::string_view kSeparator = "\n%%\n";
    const std::string_view part = Front(rest_.find(kSeparator));
    Front(kSeparator.size());
    return part;
  }
  std::string_view Rest() { return Front(rest_.size()); }

 private:
  std::string_view Front(size_t bytes) {
    const std::string_view front = rest_.substr(0, bytes);
    rest_.remove_prefix(front.size());
    return front;
  }

  std::string_view rest_;
};

using Target = void (*)(Bytes bytes);

/// Of this program, by name.
inline std::map<std::string, Target>& Targets() {
  static std::map<std::string, Target> targets;
  return targets;
}

struct Registration {
  Registration(const char* name, Target target) { Targets()[name] = target; }
};

/// Runs what may refuse its input, as a target may.
template <class Read>
void MayRefuse(const Read& read) {
  try {
    read();
  } catch (const InvalidInputError&) {
  } catch (const ProcessingError&) {
  }
}

/// A folder for the files that readers are given, of this process alone and gone at its end.
inline const std::filesystem::path& Folder() {
  static const struct Temporary {
    Temporary() {
      std::string name = (std::filesystem::temp_directory_path() / "acmp_fuzz_XXXXXX").string();
      if (!mkdtemp(name.data())) std::abort();
      path = name;
    }
    ~Temporary() {
      std::error_code ignored;
      std::filesystem::remove_all(path, ignored);
    }
    std::filesystem::path path;
  } folder;
  return folder.path;
}

/// Writes a file there. Returns its path.
inline std::filesystem::path Write(const std::string& name, std::string_view content) {
  std::filesystem::path path = Folder() / name;
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary).write(content.data(), static_cast<std::streamsize>(content.size()));
  return path;
}

}  // namespace acmp::fuzz

/// The head of a target's function of `bytes`, within a source file alone.
#define ACMP_FUZZ_TARGET(name)                                                         \
  static void FuzzTarget_##name(acmp::fuzz::Bytes bytes);                              \
  static const acmp::fuzz::Registration registration_##name(#name, FuzzTarget_##name); \
  static void FuzzTarget_##name(acmp::fuzz::Bytes bytes)
