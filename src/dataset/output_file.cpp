#include "acmp_mapping/dataset/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "acmp_mapping/common/error.h"

namespace acmp {

AtomicFile::AtomicFile(const std::filesystem::path& path, Durability durability)
    : path_(path),
      temporary_path_(std::filesystem::path(path) += ".partial"),
      durability_(durability),
      file_(std::fopen(temporary_path_.c_str(), "wbe")) {
  if (!file_) Fail("cannot create");
}

AtomicFile::~AtomicFile() {
  std::error_code ignored;  // a leftover temporary file is overwritten by the next attempt
  if (!committed_) std::filesystem::remove(temporary_path_, ignored);
}

void AtomicFile::Write(const void* data, size_t bytes) {
  if (bytes > 0 && std::fwrite(data, 1, bytes, file_.get()) != bytes) Fail("cannot write");
}

void AtomicFile::WriteAt(size_t offset, const void* data, size_t bytes) {
  const auto* next = static_cast<const char*>(data);
  while (bytes > 0) {
    const ssize_t written = pwrite(fileno(file_.get()), next, bytes, static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) Fail("cannot write");
    next += written;
    offset += static_cast<size_t>(written);
    bytes -= static_cast<size_t>(written);
  }
}

void AtomicFile::StartWriteback(size_t offset, size_t bytes) {
  sync_file_range(fileno(file_.get()), static_cast<off64_t>(offset), static_cast<off64_t>(bytes),
                  SYNC_FILE_RANGE_WRITE);
}

void AtomicFile::Commit() {
  if (std::fflush(file_.get()) != 0) Fail("cannot write");
  if (durability_ == Durability::kPowerCut && fsync(fileno(file_.get())) != 0) Fail("cannot write");
  if (std::fclose(file_.release()) != 0) Fail("cannot write");
  std::error_code error;
  std::filesystem::rename(temporary_path_, path_, error);
  if (error) throw ProcessingError(Concat("cannot write ", path_.string(), ": ", error.message()));
  committed_ = true;
}

void AtomicFile::Fail(const char* what) const {
  throw ProcessingError(Concat(what, " ", temporary_path_.string(), ": ", std::strerror(errno)));
}

void WriteFileAtomically(const std::filesystem::path& path, const std::string& content, Durability durability) {
  AtomicFile file(path, durability);
  file.Write(content);
  file.Commit();
}

void StartWriteback(const std::filesystem::path& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return;
  sync_file_range(descriptor, 0, 0, SYNC_FILE_RANGE_WRITE);
  close(descriptor);
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
  if (error) throw ProcessingError(Concat("cannot create folder ", path.string(), ": ", error.message()));
}

}  // namespace acmp
