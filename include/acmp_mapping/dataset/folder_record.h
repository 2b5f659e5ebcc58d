#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>

namespace acmp {

/// Which files in a folder are ours: files.txt in it, written before the first of them, with their bytes once they are
/// whole. What is not listed is somebody else's: nothing here removes or replaces it, follows a link, or opens a pipe.
class FolderRecord {
 public:
  static constexpr char kName[] = "files.txt";

  /// Of a folder; empty where it has none. Throws InvalidInputError for one that is damaged or no regular file.
  /// @param name of the record: another one in a folder that is not filled as a whole
  explicit FolderRecord(const std::filesystem::path& folder, const std::string& name = kName);

  const std::map<std::string, std::optional<uintmax_t>>& files() const { return files_; }  ///< "depth/000001.pfm"

  /// Throws InvalidInputError that names a listed file that is no longer what we wrote: a link, pipe or folder, or
  /// below a link.
  void CheckUnchanged() const;
  /// Lists files before they are written. Throws InvalidInputError that names the first one whose name is taken: by
  /// what is not listed, or has changed.
  void Claim(const std::set<std::string>& names);
  /// Of the files that are there, in place of all others: at the end.
  void NoteBytes();

  /// Something in the folder that is not listed, or is no longer what we wrote: "depth/notes.txt". Empty: nothing.
  std::string Foreign() const;
  /// The listed files, and folders that are empty then, but for the record.
  void RemoveFiles() const;

 private:
  void Write() const;

  std::filesystem::path folder_;
  std::string name_;
  std::map<std::string, std::optional<uintmax_t>> files_;
};

/// The content of a regular file, "" where there is none. Throws InvalidInputError for a link, a pipe or a folder.
std::string ReadOwnFile(const std::filesystem::path& path);

/// Throws InvalidInputError unless there is nothing of the name, or a folder all of whose files its record lists.
void CheckFolderIsOurs(const std::filesystem::path& path);

/// A folder that is either whole or absent: filled under a temporary name beside the final one, renamed by Commit.
/// Without a Commit it is removed, and an earlier folder of the final name stays as it was. By one process at a time.
/// Throws as AtomicFile, and as CheckFolderIsOurs of both names.
class AtomicFolder {
 public:
  /// Makes the temporary folder with its record; what a killed process has left there goes.
  /// @param names of all files that will be in it
  AtomicFolder(const std::filesystem::path& path, const std::set<std::string>& names);
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  const std::filesystem::path& temporary_path() const { return temporary_path_; }
  /// Waits until all is on the disk. A folder that has the name goes, at once but where the file system cannot exchange
  /// two names.
  void Commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_path_;
};

}  // namespace acmp
