#include "acmp_mapping/dataset/folder_record.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <sstream>
#include <system_error>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

namespace fs = std::filesystem;

constexpr char kRecordTitle[] = "# bytes and name of each file here that acmp_mapping has written or is to write\n";
constexpr char kUnfinished[] = "-";

/// Whether it is as we write it: a regular file, or a link of COLMAP models to the file of its name in "0".
bool IsAsWritten(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(path, error);
  if (fs::is_symlink(status)) return fs::read_symlink(path, error) == fs::path("0") / path.filename();
  return fs::is_regular_file(status);
}

/// Whether what lies there does so in folders, none of which is a link.
bool LiesInFolders(const fs::path& folder, const fs::path& name) {
  fs::path at = folder;
  for (const fs::path& part : name.parent_path()) {
    at /= part;
    std::error_code error;
    const fs::file_status status = fs::symlink_status(at, error);
    if (fs::exists(status) && !fs::is_directory(status)) return false;
  }
  return true;
}

/// The name of a file that AtomicFile is writing or has left.
std::string NameOfTemporary(std::string name) {
  const size_t suffix = name.rfind(kTemporarySuffix);
  if (suffix == std::string::npos || suffix + std::strlen(kTemporarySuffix) != name.size()) return name;
  name.resize(suffix);
  const size_t dot = name.find_last_not_of("0123456789");
  if (dot != std::string::npos && name[dot] == '.' && dot + 1 < name.size()) return name.substr(0, dot);
  return name;
}

[[noreturn]] void RefuseForeign(const fs::path& folder, const std::string& what) {
  throw InvalidInputError(Concat(folder.string(), ": ", what,
                                 " was not written by this program, or has been changed since, and stays: move it, or "
                                 "choose another name"));
}

void CheckAsWritten(const fs::path& folder, const std::string& name) {
  std::error_code error;
  const bool exists = fs::exists(fs::symlink_status(folder / name, error));
  if (!LiesInFolders(folder, name) || (exists && !IsAsWritten(folder / name))) RefuseForeign(folder, name);
}

}  // namespace

std::string ReadOwnFile(const fs::path& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0 && errno == ENOENT) return "";
  struct stat status = {};
  if (descriptor < 0 || fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode)) {
    const std::string reason = descriptor >= 0 || errno == ELOOP || errno == ENXIO
                                   ? "is a link, folder, pipe or device; must be a file"
                                   : std::strerror(errno);
    if (descriptor >= 0) close(descriptor);
    throw InvalidInputError(Concat(path.string(), ": ", reason));
  }
  constexpr off_t kMaxBytes = off_t{1} << 28;  // the names of ten million files
  if (status.st_size > kMaxBytes) {
    close(descriptor);
    throw InvalidInputError(Concat(path.string(), ": has ", status.st_size, " bytes: at most ", kMaxBytes));
  }
  std::string content(static_cast<size_t>(status.st_size), '\0');
  size_t done = 0;
  while (done < content.size()) {
    const ssize_t bytes = read(descriptor, content.data() + done, content.size() - done);
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) break;
    done += static_cast<size_t>(bytes);
  }
  close(descriptor);
  content.resize(done);
  return content;
}

FolderRecord::FolderRecord(const fs::path& folder, const std::string& name) : folder_(folder), name_(name) {
  std::istringstream lines(ReadOwnFile(folder / name_));
  std::string line;
  while (std::getline(lines, line)) {
    if (line.empty() || line[0] == '#') continue;
    const size_t space = line.find(' ');
    const std::string bytes = line.substr(0, space);
    const std::string name = space == std::string::npos ? "" : line.substr(space + 1);
    const fs::path path(name);
    const bool is_number =
        !bytes.empty() && bytes.size() < 19 && bytes.find_first_not_of("0123456789") == std::string::npos;
    if ((!is_number && bytes != kUnfinished) || name.empty() || path.is_absolute() || *path.begin() == ".." ||
        path.lexically_normal() != path) {
      throw InvalidInputError(
          Concat((folder_ / name_).string(), ", which lists the files, is damaged: \"", line, "\""));
    }
    files_[name] = is_number ? std::optional<uintmax_t>(std::stoull(bytes)) : std::nullopt;
  }
}

void FolderRecord::Write() const {
  std::string text = kRecordTitle;
  for (const auto& [name, bytes] : files_)
    text += Concat(bytes ? std::to_string(*bytes) : kUnfinished, " ", name, "\n");
  WriteFileAtomically(folder_ / name_, text, Durability::kPowerCut);
}

void FolderRecord::CheckUnchanged() const {
  for (const auto& [name, bytes] : files_) CheckAsWritten(folder_, name);
}

void FolderRecord::Claim(const std::set<std::string>& names) {
  bool is_new = false;
  for (const std::string& name : names) {
    CheckAsWritten(folder_, name);
    if (files_.count(name) > 0) continue;
    std::error_code error;
    if (fs::exists(fs::symlink_status(folder_ / name, error))) {
      files_.merge(
          FolderRecord(folder_, name_).files_);  // another process of the same run may have listed and written it since
      if (files_.count(name) == 0) RefuseForeign(folder_, name);
      continue;
    }
    files_.emplace(name, std::nullopt);
    is_new = true;
  }
  if (is_new) Write();
}

void FolderRecord::NoteBytes() {
  for (auto file = files_.begin(); file != files_.end();) {
    const fs::path path = folder_ / file->first;
    std::error_code error;
    file->second = fs::file_size(path, error);
    file = error || !IsAsWritten(path) ? files_.erase(file) : std::next(file);
  }
  Write();
}

std::string FolderRecord::Foreign() const {
  for (auto entry = fs::recursive_directory_iterator(folder_); entry != fs::recursive_directory_iterator(); ++entry) {
    if (fs::is_directory(entry->symlink_status())) continue;
    const std::string name = entry->path().lexically_relative(folder_).string();
    if (name == name_ || NameOfTemporary(name) == name_) continue;
    if (files_.count(NameOfTemporary(name)) == 0 || !IsAsWritten(entry->path())) return name;
  }
  return "";
}

void FolderRecord::RemoveFiles() const {
  std::set<fs::path> folders;
  std::set<std::string> temporary;
  const auto remove = [&](const fs::path& path) {
    std::error_code error;
    fs::remove(path, error);
    if (error) throw ProcessingError(Concat("cannot remove ", path.string(), ": ", error.message()));
  };
  for (const auto& [name, bytes] : files_) {
    if (!LiesInFolders(folder_, name)) continue;
    if (IsAsWritten(folder_ / name)) remove(folder_ / name);
    for (fs::path parent = fs::path(name).parent_path(); !parent.empty(); parent = parent.parent_path()) {
      folders.insert(parent);
    }
  }
  folders.insert("");
  for (auto folder = folders.rbegin(); folder != folders.rend(); ++folder) {  // the deepest first
    std::error_code ignored;
    if (!fs::is_directory(fs::symlink_status(folder_ / *folder, ignored))) continue;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / *folder)) {
      const std::string name = entry.path().lexically_relative(folder_).string();
      if (NameOfTemporary(name) != name && files_.count(NameOfTemporary(name)) > 0 && IsAsWritten(entry.path())) {
        remove(entry.path());
      }
    }
    if (!folder->empty()) fs::remove(folder_ / *folder, ignored);  // where nothing is left in it
  }
}

void CheckFolderIsOurs(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(path, error);
  if (!fs::exists(status)) return;
  if (!fs::is_directory(status)) RefuseForeign(path.parent_path(), path.filename().string());
  const std::string foreign = FolderRecord(path).Foreign();
  if (!foreign.empty()) RefuseForeign(path, foreign);
}

namespace {

void RemoveOurFolder(const fs::path& path) {
  FolderRecord(path).RemoveFiles();
  std::error_code ignored;  // what others have put into it stays
  fs::remove(path / FolderRecord::kName, ignored);
  fs::remove(path, ignored);
}

}  // namespace

AtomicFolder::AtomicFolder(const fs::path& path, const std::set<std::string>& names)
    : path_(path), temporary_path_(path) {
  CheckFolderOf(path);
  temporary_path_ += kTemporarySuffix;
  CheckFolderIsOurs(path_);
  CheckFolderIsOurs(temporary_path_);
  if (fs::exists(temporary_path_)) RemoveOurFolder(temporary_path_);
  MakeFolder(temporary_path_);
  FolderRecord(temporary_path_).Claim(names);
}

AtomicFolder::~AtomicFolder() {
  try {
    if (fs::exists(temporary_path_)) RemoveOurFolder(temporary_path_);
  } catch (const std::exception&) {  // stays, for the next attempt
  }
}

void AtomicFolder::Commit() {
  FolderRecord(temporary_path_).NoteBytes();
  SyncFolder(temporary_path_);
  CheckFolderIsOurs(path_);
  // Where there is a folder of that name, it gets the temporary one, which the destructor removes.
  if (renameat2(AT_FDCWD, temporary_path_.c_str(), AT_FDCWD, path_.c_str(), RENAME_EXCHANGE) != 0) {
    std::error_code error(errno, std::system_category());
    const bool cannot_exchange = error == std::errc::invalid_argument || error == std::errc::function_not_supported;
    if (cannot_exchange && fs::exists(path_)) RemoveOurFolder(path_);
    if (cannot_exchange || error == std::errc::no_such_file_or_directory) {
      error.clear();
      fs::rename(temporary_path_, path_, error);
    }
    if (error) throw ProcessingError(Concat("cannot write ", path_.string(), ": ", error.message()));
  }
  SyncEntries(path_);
}

}  // namespace acmp
