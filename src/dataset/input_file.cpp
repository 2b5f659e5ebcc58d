#include "input_file.h"

#include "acmp_mapping/common/classic_locale.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace acmp {
namespace {

constexpr const char* kSpace = " \t\r";

using std::from_chars;
#ifndef __cpp_lib_to_chars
/// That of floating-point numbers, which libstdc++ has from GCC 11 on.
std::from_chars_result from_chars(const char* first, const char* last, double& value) {
  const ClassicLocale point;
  const std::string word(first, last);
  // What strtod takes and from_chars does not: space, a plus, hexadecimal digits.
  if (word.find_first_of(" \t\n\v\f\r+") == 0 || word.find_first_of("xX") != std::string::npos) {
    return {first, std::errc::invalid_argument};
  }
  char* end = nullptr;
  errno = 0;
  const double parsed = std::strtod(word.c_str(), &end);
  const char* const parsed_end = first + (end - word.c_str());
  if (parsed_end == first) return {first, std::errc::invalid_argument};
  if (errno == ERANGE && (std::isinf(parsed) || parsed == 0)) return {parsed_end, std::errc::result_out_of_range};
  value = parsed;
  return {parsed_end, std::errc()};
}
#endif

template <class T>
bool ParseWhole(std::string_view word, T* value) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  const auto [end, error] = from_chars(word.data(), word.data() + word.size(), *value);
  return error == std::errc() && end == word.data() + word.size();
}

}  // namespace

std::ifstream OpenInput(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (std::filesystem::is_directory(status)) {
    throw InvalidInputError(Concat("cannot read ", path.string(), ": is a folder"));
  }
  // A pipe would be waited for, and a device may have no end.
  if (std::filesystem::is_other(status)) {
    throw InvalidInputError(
        Concat("cannot read ", path.string(), ": is a device, pipe or socket; give the name of a file"));
  }
  errno = 0;
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InvalidInputError(Concat("cannot read ", path.string(), ": ", std::strerror(errno)));
  return stream;
}

std::string ReadInput(const std::filesystem::path& path, size_t max_bytes) {
  std::ifstream stream = OpenInput(path);
  std::error_code error;
  const uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw InvalidInputError(Concat("cannot read ", path.string(), ": ", error.message()));
  std::string content(std::min<uintmax_t>(size, max_bytes), '\0');
  stream.read(content.data(), static_cast<std::streamsize>(content.size()));
  if (stream.bad()) throw InvalidInputError(Concat("cannot read ", path.string(), ": read error"));
  content.resize(static_cast<size_t>(stream.gcount()));
  return content;
}

bool TextReader::NextLine() {
  if (!std::getline(stream_, line_)) return false;
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (++line_number_ == 1 && line_.compare(0, kByteOrderMark.size(), kByteOrderMark) == 0) {
    line_.erase(0, kByteOrderMark.size());
  }
  if (!line_.empty() && line_.back() == '\r') line_.pop_back();
  at_ = 0;
  SkipSpace();
  return true;
}

bool TextReader::NextContentLine() {
  while (NextLine()) {
    if (AtEnd()) continue;
    if (line_[at_] != '#') return true;
    NoteAnnouncedCount();
  }
  return false;
}

void TextReader::NoteAnnouncedCount() {
  const size_t number = line_.find("Number of ");
  const size_t colon = line_.find(':', number == std::string::npos ? 0 : number);
  if (number == std::string::npos || colon == std::string::npos) return;
  const size_t first = line_.find_first_of("0123456789", colon);
  if (first == std::string::npos) return;
  std::from_chars(line_.data() + first, line_.data() + line_.size(), announced_count_);
}

void TextReader::SkipSpace() { at_ = std::min(line_.find_first_not_of(kSpace, at_), line_.size()); }

std::string_view TextReader::NextWord(const char* name) {
  if (AtEnd()) Fail(Concat(name, " is missing: the line ends before it"));
  const std::string_view rest = std::string_view(line_).substr(at_);
  const std::string_view word = rest.substr(0, rest.find_first_of(kSpace));
  at_ += word.size();
  SkipSpace();
  return word;
}

double TextReader::Real(const char* name) {
  const std::string_view word = NextWord(name);
  double value = 0;
  if (!ParseWhole(word, &value)) Fail(Concat(name, " = \"", word, "\": must be a number"));
  if (!std::isfinite(value)) Fail(Concat(name, " = ", word, ": must be finite"));
  return value;
}

double TextReader::RealOrNan(const char* name) {
  double value = 0;
  return ParseWhole(NextWord(name), &value) ? value : NAN;
}

bool TextReader::HasText(int place) const {
  std::string_view rest = line_;
  for (int i = 0;; ++i) {
    rest.remove_prefix(std::min(rest.find_first_not_of(kSpace), rest.size()));
    const std::string_view word = rest.substr(0, rest.find_first_of(kSpace));
    double value = 0;
    if (word.empty() || i == place) return !word.empty() && !ParseWhole(word, &value);
    rest.remove_prefix(word.size());
  }
}

int64_t TextReader::Integer(const char* name) {
  const std::string_view word = NextWord(name);
  int64_t value = 0;
  if (ParseWhole(word, &value)) return value;
  double real = 0;
  constexpr double kExact = 9007199254740992;  // 2^53
  if (ParseWhole(word, &real) && std::abs(real) < kExact && real == std::floor(real)) return static_cast<int64_t>(real);
  Fail(Concat(name, " = \"", word, "\": must be a whole number"));
}

std::string TextReader::Rest(const char* name) {
  if (AtEnd()) Fail(Concat(name, " is missing: the line ends before it"));
  std::string rest = line_.substr(at_, line_.find_last_not_of(kSpace) + 1 - at_);
  at_ = line_.size();
  return rest;
}

void TextReader::ExpectEnd() const {
  if (!AtEnd()) Fail(Concat("unexpected \"", line_.substr(at_, 40), "\" at the end of the line"));
}

BinaryReader::BinaryReader(const std::filesystem::path& path) : path_(path), stream_(OpenInput(path)) {
  std::error_code error;
  size_ = std::filesystem::file_size(path, error);
  if (error) throw InvalidInputError(Concat("cannot read ", path.string(), ": ", error.message()));
}

void BinaryReader::ReadBytes(void* target, uint64_t bytes, const char* what) {
  ExpectRemaining(bytes, 1, what);
  if (!stream_.read(static_cast<char*>(target), static_cast<std::streamsize>(bytes))) {
    Fail(Concat("read error in ", what));
  }
  position_ += bytes;
}

void BinaryReader::Skip(uint64_t bytes, const char* what) {
  ExpectRemaining(bytes, 1, what);
  stream_.seekg(static_cast<std::streamoff>(bytes), std::ios::cur);
  position_ += bytes;
}

std::string BinaryReader::ReadUntil(char end, size_t max_length, const char* what) {
  std::string text;
  for (char c = Read<char>(what); c != end; c = Read<char>(what)) {
    if (text.size() == max_length) Fail(Concat(what, " is longer than ", max_length, " characters"));
    text.push_back(c);
  }
  return text;
}

std::string BinaryReader::ReadLine(size_t max_length, const char* what) {
  std::string text = ReadUntil('\n', max_length, what);
  if (!text.empty() && text.back() == '\r') text.pop_back();
  return text;
}

uint64_t BinaryReader::ReadCount(uint64_t bytes_each, const char* what) {
  const auto count = Read<uint64_t>(what);
  ExpectRemaining(count, bytes_each, what);
  return count;
}

void BinaryReader::ExpectRemaining(uint64_t count, uint64_t bytes_each, const char* what) const {
  if (count > remaining() / bytes_each) {
    Fail(Concat(what, ": ", count, " x ", bytes_each, " bytes do not fit into the ", remaining(),
                " bytes that are left; the file is truncated or corrupt"));
  }
}

void BinaryReader::ExpectEnd() const {
  if (remaining() > 0) Fail(Concat(remaining(), " bytes too many; the file is corrupt"));
}

}  // namespace acmp
