#include "acmp_mapping/dataset/output_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstring>
#include <iomanip>
#include <system_error>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"

namespace acmp {

void SyncEntries(const std::filesystem::path& path) {
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && fsync(descriptor) == 0;
  const int reason = errno;
  if (descriptor >= 0) close(descriptor);
  // A folder that one may write to but not read cannot be opened; EINVAL: this file system has no fsync of folders.
  if (synced || reason == EACCES || reason == EINVAL) return;
  throw ProcessingError(Concat("cannot write to ", folder.string(), ": ", std::strerror(reason)));
}

void CheckFolderOf(const std::filesystem::path& path) {
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
  std::error_code ignored;  // where it cannot be told, open says why
  const std::filesystem::file_type type = std::filesystem::status(folder, ignored).type();
  if (type != std::filesystem::file_type::directory && type != std::filesystem::file_type::none) {
    throw InvalidInputError(Concat("file ", path, ": there is no folder ", std::filesystem::absolute(folder)));
  }
}

AtomicFile::AtomicFile(const std::filesystem::path& path, Durability durability)
    : path_(path), durability_(durability) {
  if (path.native().find('\0') != std::string::npos) {
    throw InvalidInputError(Concat("a file name must not contain a zero character: ", path));
  }
  CheckFolderOf(path);
  struct stat target = {};
  if (stat(path.c_str(), &target) == 0 && !S_ISREG(target.st_mode) && !S_ISDIR(target.st_mode)) {
    throw InvalidInputError(Concat("file ", path, ": is a device, pipe or socket; give the name of a file"));
  }
  for (int others = 0; !file_ || !LockTemporary(); ++others) {
    temporary_path_ = path;
    if (others > 0) temporary_path_ += "." + std::to_string(others);
    temporary_path_ += kTemporarySuffix;
    // Not blocking: a pipe in its place would be waited for, until somebody reads it.
    const int descriptor =
        open(temporary_path_.c_str(), O_WRONLY | O_CREAT | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK, 0666);
    if (descriptor < 0) Fail("cannot create");
    file_.reset(fdopen(descriptor, "wb"));
    if (!file_) {
      const int reason = errno;
      close(descriptor);
      errno = reason;
      Fail("cannot create");
    }
  }
  if (ftruncate(fileno(file_.get()), 0) != 0) Fail("cannot write");
}

/// False if another writes to the temporary file, or did so and gave it its final name before it was locked, and for
/// what is no file with this name alone.
bool AtomicFile::LockTemporary() const {
  if (flock(fileno(file_.get()), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) return false;
  struct stat opened = {}, named = {};
  return fstat(fileno(file_.get()), &opened) == 0 && lstat(temporary_path_.c_str(), &named) == 0 &&
         opened.st_ino == named.st_ino && opened.st_dev == named.st_dev && S_ISREG(opened.st_mode) &&
         opened.st_nlink == 1;
}

AtomicFile::~AtomicFile() {
  std::error_code ignored;  // a leftover temporary file is overwritten by the next attempt
  if (!committed_) std::filesystem::remove(temporary_path_, ignored);
}

void AtomicFile::Write(const void* data, size_t bytes) {
  if (bytes > 0 && std::fwrite(data, 1, bytes, file_.get()) != bytes) Fail("cannot write");
}

void AtomicFile::Print(const char* format, ...) {
  const ClassicLocale point;
  std::va_list values;
  va_start(values, format);
  const int length = std::vfprintf(file_.get(), format, values);
  va_end(values);
  if (length < 0) Fail("cannot write");
}

void AtomicFile::Rewind() {
  if (std::fseek(file_.get(), 0, SEEK_SET) != 0) Fail("cannot write");
}

void AtomicFile::Reserve(uint64_t bytes) {
  const int descriptor = fileno(file_.get());
  if (fallocate(descriptor, FALLOC_FL_KEEP_SIZE, 0, static_cast<off_t>(bytes)) != 0 && errno != EOPNOTSUPP) {
    Fail("cannot write");
  }
}

void AtomicFile::Commit() {
  if (std::fflush(file_.get()) != 0) Fail("cannot write");
  struct stat written = {};
  const bool has_size = fstat(fileno(file_.get()), &written) == 0;
  // Gives back what was reserved and not used.
  if (!has_size || ftruncate(fileno(file_.get()), written.st_size) != 0) Fail("cannot write");
  if (durability_ == Durability::kPowerCut && fsync(fileno(file_.get())) != 0) Fail("cannot write");
  // Some file systems report errors only when a file is closed: close a second descriptor, as the first has the lock.
  const int second = dup(fileno(file_.get()));
  if (second < 0 || close(second) != 0) Fail("cannot write");
  std::error_code error;
  std::filesystem::rename(temporary_path_, path_, error);
  if (error) throw ProcessingError(Concat("cannot write ", path_.string(), ": ", error.message()));
  committed_ = true;
  file_.reset();
  if (durability_ == Durability::kPowerCut) SyncEntries(path_);  // else the new name may be gone after a power cut
}

void AtomicFile::Fail(const char* what) const {
  throw ProcessingError(Concat(what, " ", temporary_path_.string(), ": ", std::strerror(errno)));
}

void WriteFileAtomically(const std::filesystem::path& path, const std::string& content, Durability durability) {
  AtomicFile file(path, durability);
  file.Write(content);
  file.Commit();
}

std::ostringstream MakeTextFile(int digits) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << std::setprecision(digits);
  return text;
}

void SyncFolder(const std::filesystem::path& folder) {
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && syncfs(descriptor) == 0;
  const int reason = errno;
  if (descriptor >= 0) close(descriptor);
  if (!synced) throw ProcessingError(Concat("cannot write to ", folder.string(), ": ", std::strerror(reason)));
}

void MakeFolder(const std::filesystem::path& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (!error && !std::filesystem::is_directory(path, error) && !error) {
    error = std::make_error_code(std::errc::not_a_directory);
  }
  const std::string message = Concat("cannot create folder ", path.string(), ": ", error.message());
  if (error == std::errc::not_a_directory || error == std::errc::file_exists) throw InvalidInputError(message);
  if (error) throw ProcessingError(message);
}

}  // namespace acmp
