#pragma once

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>

namespace acmp {

/// What a finished file survives. Waiting for the disk takes milliseconds per file: where many are written, leave it to
/// one SyncFolder for all of them.
enum class Durability {
  kProcess,   ///< the end of this process, however it comes
  kPowerCut,  ///< that, and a power cut right afterwards
};

/// Throws InvalidInputError that names the folder in which the file would lie unless there is one.
void CheckFolderOf(const std::filesystem::path& path);

/// Of the temporary names of AtomicFile and AtomicFolder, which nobody else gives to his own.
constexpr char kTemporarySuffix[] = ".acmp.partial";

/// A file that is either whole or absent: written under a temporary name beside the final one, renamed by Commit.
/// Without a Commit the temporary file is removed and an earlier file of the final name stays as it was. Every failure
/// (no space, not writable, too large) throws ProcessingError with the system's reason; a name that is not that of a
/// regular file, or whose folder does not exist, InvalidInputError. Several processes may write the same file: each has
/// a temporary file of its own, which it locks, and the last Commit wins. What a killed process left is used again. On
/// a file system without locks only one may write.
class AtomicFile {
 public:
  explicit AtomicFile(const std::filesystem::path& path, Durability durability = Durability::kProcess);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void Write(const void* data, size_t bytes);
  void Write(const std::string& text) { Write(text.data(), text.size()); }
  /// Numbers as they are in memory.
  template <class... Values>
  void Put(const Values&... values) {
    (Write(&values, sizeof(values)), ...);
  }
  /// What is written from now on takes the place of what is there from the beginning on.
  void Rewind();
  /// What printf makes of it; numbers have a decimal point in any locale.
  void Print(const char* format, ...) __attribute__((format(printf, 2, 3)));
  /// Makes sure of the disk's space for a file of so many bytes, where the file system can do that. Throws as Write.
  void Reserve(uint64_t bytes);
  /// Nothing may be written afterwards.
  void Commit();

  /// For libraries that write to a name: they may do so in place of Write, and must have closed it before Commit.
  const std::filesystem::path& temporary_path() const { return temporary_path_; }

 private:
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  bool LockTemporary() const;
  [[noreturn]] void Fail(const char* what) const;

  std::filesystem::path path_;
  std::filesystem::path temporary_path_;
  Durability durability_;
  std::unique_ptr<std::FILE, Closer> file_;  ///< the temporary one, locked until it has its final name or is gone
  bool committed_ = false;
};

/// Writes a whole file through AtomicFile.
void WriteFileAtomically(const std::filesystem::path& path, const std::string& content,
                         Durability durability = Durability::kProcess);

/// An empty text whose numbers get so many significant digits.
std::ostringstream MakeTextFile(int digits);

/// Waits until the folder of a file has its name on the disk. A file system that cannot do that has done what it can.
void SyncEntries(const std::filesystem::path& path);

/// Waits until everything written so far to the file system that holds the folder is on the disk.
void SyncFolder(const std::filesystem::path& folder);

/// Makes a folder and its parents; ProcessingError with the system's reason when that is not possible,
/// InvalidInputError when one of them is a file.
void MakeFolder(const std::filesystem::path& path);

}  // namespace acmp
