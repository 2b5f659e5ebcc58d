#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <type_traits>

#include "acmp_mapping/common/error.h"

namespace acmp {

/// Opens a regular file for reading; InvalidInputError with the system's reason when it is missing or unreadable.
std::ifstream OpenInput(const std::filesystem::path& path);

/// The first `max_bytes` of a file, or all of a shorter one.
std::string ReadInput(const std::filesystem::path& path, size_t max_bytes = std::string::npos);

/// Reads a text file line by line, takes lines apart at white space, and knows where it is, for messages "FILE:LINE:
/// ...". Every getter names the field in its message.
class TextReader {
 public:
  explicit TextReader(const std::filesystem::path& path) : path_(path), stream_(OpenInput(path)) {}

  /// False at the end of the file. A carriage return at the end of a line, and a byte order mark before the first, are
  /// dropped.
  bool NextLine();
  /// The next line that is neither blank nor a comment (#).
  bool NextContentLine();

  bool AtEnd() const { return at_ == line_.size(); }  ///< of the line
  std::string Word(const char* name) { return std::string(NextWord(name)); }
  double Real(const char* name);       ///< finite
  double RealOrNan(const char* name);  ///< nan for any word that is no number
  int64_t Integer(const char* name);   ///< also as "160.0"
  /// Everything that is left of the line, without white space at its end.
  std::string Rest(const char* name);
  void ExpectEnd() const;
  /// Whether the line has a word of this place, from 0, that is no number.
  bool HasText(int place) const;

  std::string Where() const { return Concat(path_.string(), ":", line_number_); }
  [[noreturn]] void Fail(const std::string& message) const { throw InvalidInputError(Concat(Where(), ": ", message)); }

  /// The count that COLMAP's comment "# Number of WHAT: N" announced so far; -1 when there was none.
  int64_t announced_count() const { return announced_count_; }

 private:
  void NoteAnnouncedCount();
  void SkipSpace();
  std::string_view NextWord(const char* name);

  std::filesystem::path path_;
  std::ifstream stream_;
  std::string line_;
  size_t at_ = 0;  ///< of the next word in the line, or its end
  int64_t line_number_ = 0;
  int64_t announced_count_ = -1;
};

/// Reads a little-endian binary file and never past its end.
class BinaryReader {
 public:
  explicit BinaryReader(const std::filesystem::path& path);

  template <class T>
  T Read(const char* what) {
    static_assert(std::is_arithmetic_v<T>);
    T value;
    ReadBytes(&value, sizeof(T), what);
    return value;
  }
  void ReadBytes(void* target, uint64_t bytes, const char* what);
  void Skip(uint64_t bytes, const char* what);
  /// Up to this character, at most `max_length` before it, which is left out.
  std::string ReadUntil(char end, size_t max_length, const char* what);
  /// Up to the line's end, and without a carriage return there.
  std::string ReadLine(size_t max_length, const char* what);
  /// Reads a 64-bit count of records that take at least `bytes_each`, so that a corrupt count is found before memory is
  /// asked for.
  uint64_t ReadCount(uint64_t bytes_each, const char* what);
  void ExpectRemaining(uint64_t count, uint64_t bytes_each, const char* what) const;
  void ExpectEnd() const;

  uint64_t remaining() const { return size_ - position_; }
  std::string Where() const { return Concat(path_.string(), " at byte ", position_); }
  [[noreturn]] void Fail(const std::string& message) const { throw InvalidInputError(Concat(Where(), ": ", message)); }

 private:
  std::filesystem::path path_;
  std::ifstream stream_;
  uint64_t size_ = 0;
  uint64_t position_ = 0;
};

}  // namespace acmp
