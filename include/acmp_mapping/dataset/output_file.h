#pragma once

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

namespace acmp {

/// A file being written. Every failure (no space, not writable, too large) throws ProcessingError with the system's
/// reason.
class OutputFile {
 public:
  /// Creates or empties the file.
  explicit OutputFile(const std::filesystem::path& path);

  void Write(const void* data, size_t bytes);
  void Write(const std::string& text) { Write(text.data(), text.size()); }

  /// Forces everything to the disk and closes; nothing may be written afterwards. Without this call the file's content
  /// is unspecified.
  void Close();

 private:
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  [[noreturn]] void Fail(const char* what) const;

  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Closer> file_;
};

/// A file that is either whole or absent: written under a temporary name beside the final one, renamed by Commit.
/// Without a Commit the temporary file is removed and an earlier file of the final name stays as it was.
class AtomicFile {
 public:
  explicit AtomicFile(const std::filesystem::path& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void Write(const void* data, size_t bytes) { file_.Write(data, bytes); }
  void Write(const std::string& text) { file_.Write(text); }
  void Commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_path_;
  OutputFile file_;
  bool committed_ = false;
};

/// Writes a whole file through AtomicFile.
void WriteFileAtomically(const std::filesystem::path& path, const std::string& content);

/// Makes a folder and its parents; ProcessingError with the system's reason when that is not possible.
void MakeFolder(const std::filesystem::path& path);

}  // namespace acmp
