#include "output_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr const char* kRecordName = "run.txt";
constexpr const char* kLockName = ".lock";
constexpr const char* kTemporarySuffix = ".partial";  // of AtomicFile
constexpr std::array<const char*, 10> kOwnEntries = {"depth",  "normal", "cost",      "confidence",  "pictures",
                                                     "colmap", "work",   "fused.ply", "cameras.txt", "summary.json"};

std::string Format(const RunRecord& record) {
  std::string text = "# settings of the run that made this folder\n";
  for (const auto& [key, value] : record) text += Concat(key, " = ", value, "\n");
  return text;
}

std::string ReadText(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

RunRecord Parse(const std::string& text) {
  RunRecord record;
  size_t begin = 0;
  for (size_t end = text.find('\n'); end != std::string::npos; begin = end + 1, end = text.find('\n', begin)) {
    const std::string line = text.substr(begin, end - begin);
    const size_t equals = line.find(" = ");
    if (line.rfind('#', 0) != 0 && equals != std::string::npos) {
      record.emplace_back(line.substr(0, equals), line.substr(equals + 3));
    }
  }
  return record;
}

std::string ValueOf(const RunRecord& record, const std::string& key) {
  for (const auto& [name, value] : record) {
    if (name == key) return value;
  }
  return "(none)";
}

std::string DescribeDifferences(const RunRecord& earlier, const RunRecord& now) {
  std::string text;
  for (const auto& [key, value] : now) {
    const std::string old = ValueOf(earlier, key);
    if (old != value) text += Concat(text.empty() ? "" : ", ", key, " was ", old, " and is ", value);
  }
  return text;
}

bool IsOurTrace(const std::string& name) {
  return name == kLockName || name == std::string(kRecordName) + kTemporarySuffix;
}

/// Name of an entry that a run did not make itself before it wrote its record; empty when there is none.
std::string ForeignEntry(const std::filesystem::path& folder) {
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::string name = entry.path().filename().string();
    if (!IsOurTrace(name)) return name;
  }
  return "";
}

void Remove(const std::filesystem::path& path) {
  std::error_code error;
  std::filesystem::remove_all(path, error);
  if (error) throw ProcessingError(Concat("cannot remove ", path.string(), ": ", error.message()));
}

}  // namespace

std::string SixDigits(int number) {
  char text[16];
  std::snprintf(text, sizeof(text), "%06d", number);
  return text;
}

OutputFolder::OutputFolder(const std::filesystem::path& path, const RunRecord& record, bool overwrite) : path_(path) {
  MakeFolder(path_);
  Lock();
  try {
    TakeOver(record, overwrite);
  } catch (...) {
    close(lock_);
    throw;
  }
}

OutputFolder::~OutputFolder() { close(lock_); }

void OutputFolder::Lock() {
  const auto path = path_ / kLockName;
  lock_ = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (lock_ < 0) throw ProcessingError(Concat("cannot create ", path.string(), ": ", std::strerror(errno)));
  if (flock(lock_, LOCK_EX | LOCK_NB) == 0) return;
  const int reason = errno;
  close(lock_);
  if (reason != EWOULDBLOCK) throw ProcessingError(Concat("cannot lock ", path.string(), ": ", std::strerror(reason)));
  throw InvalidInputError(Concat(path_.string(), ": another run is writing to this folder right now"));
}

void OutputFolder::TakeOver(const RunRecord& record, bool overwrite) {
  const auto record_path = path_ / kRecordName;
  const std::string text = Format(record);
  if (!std::filesystem::exists(record_path)) {
    const std::string foreign = ForeignEntry(path_);
    if (!foreign.empty()) {
      throw InvalidInputError(Concat(path_.string(), ": holds ", foreign,
                                     " and was not made by this tool: give a folder that is empty or does not exist"));
    }
    WriteFileAtomically(record_path, text, Durability::kPowerCut);
    return;
  }
  const std::string earlier = ReadText(record_path);
  if (overwrite) {
    RemoveResults();
    WriteFileAtomically(record_path, text, Durability::kPowerCut);
    return;
  }
  if (earlier != text) {
    throw InvalidInputError(Concat(path_.string(), ": holds a run with other settings (",
                                   DescribeDifferences(Parse(earlier), record),
                                   "): give --overwrite to start afresh, or another folder"));
  }
  state_ = std::filesystem::exists(SummaryFile()) ? State::kComplete : State::kStarted;
}

void OutputFolder::RemoveResults() const {
  // The summary first: a folder without it never counts as complete.
  Remove(SummaryFile());
  for (const char* name : kOwnEntries) Remove(path_ / name);
}

void OutputFolder::StartAfresh() {
  RemoveResults();
  state_ = State::kFresh;
}

std::filesystem::path OutputFolder::WorkFile(const std::string& kind, int number) const {
  return path_ / "work" / kind / (SixDigits(number) + ".bin");
}

void OutputFolder::RemoveWork() const { Remove(path_ / "work"); }

std::filesystem::path OutputFolder::MapFile(const std::string& kind, int index, const std::string& suffix) const {
  return path_ / kind / (SixDigits(index) + suffix);
}

}  // namespace acmp
