#include "output_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <regex>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/folder_record.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr const char* kRecordName = "run.txt";
constexpr const char* kRecordTitle = "# settings of the run that made this folder\n";
constexpr const char* kLockName = ".lock";
constexpr const char* kWorkName = "work";

std::string Format(const RunRecord& record) {
  std::string text = kRecordTitle;
  for (const auto& [key, value] : record) text += Concat(key, " = ", value, "\n");
  return text;
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

/// Whether a run writes a work file of that name: step_0/000012.bin.
bool IsWorkFile(const std::string& name) {
  static const std::regex pattern("[a-z_0-9]+/[0-9]{6}\\.bin((\\.[0-9]+)?\\.acmp\\.partial|\\.lock)?");
  return std::regex_match(name, pattern);
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
  std::filesystem::remove(path, error);
  if (error) throw ProcessingError(Concat("cannot remove ", path.string(), ": ", error.message()));
}

/// Links and pipes in place of what a run reads or writes would lead elsewhere, or wait for ever.
void CheckIsFolderOrFile(const std::filesystem::path& path, std::filesystem::file_type wanted) {
  std::error_code ignored;
  const std::filesystem::file_status status = std::filesystem::symlink_status(path, ignored);
  if (!std::filesystem::exists(status) || status.type() == wanted) return;
  throw InvalidInputError(Concat(path.string(), ": is no ",
                                 wanted == std::filesystem::file_type::directory ? "folder" : "regular file",
                                 " of a run: remove it"));
}

}  // namespace

FileLock::FileLock(const std::filesystem::path& path, int operation) {
  MakeFolder(path.parent_path());
  CheckIsFolderOrFile(path, std::filesystem::file_type::regular);
  descriptor_ = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
  if (descriptor_ >= 0 && flock(descriptor_, operation) == 0) return;
  const int reason = errno;
  if (descriptor_ >= 0) close(descriptor_);
  if (reason != EWOULDBLOCK) throw ProcessingError(Concat("cannot lock ", path.string(), ": ", std::strerror(reason)));
  throw InvalidInputError(Concat(path.parent_path().string(), ": another run is writing to this folder right now"));
}

FileLock::~FileLock() { close(descriptor_); }

OutputFolder::OutputFolder(const std::filesystem::path& path, const RunRecord& record, bool overwrite, Use use)
    : path_(path) {
  MakeFolder(path_);
  RefuseForeign();  // before the lock, which would be left there
  lock_.emplace(path_ / kLockName, (use == Use::kStages && !overwrite ? LOCK_SH : LOCK_EX) | LOCK_NB);
  TakeOver(record, overwrite, use == Use::kStages);
}

bool OutputFolder::Exists(const std::filesystem::path& path) {
  return ReadOwnFile(path / kRecordName).rfind(kRecordTitle, 0) == 0;
}

std::string OutputFolder::Setting(const std::string& key) const {
  return ValueOf(Parse(ReadOwnFile(path_ / kRecordName)), key);
}

void OutputFolder::Rewrite(const RunRecord& record) const {
  WriteFileAtomically(path_ / kRecordName, Format(record), Durability::kPowerCut);
}

void OutputFolder::RefuseForeign() const {
  const std::string foreign = ForeignEntry(path_);
  if (foreign.empty() || Exists(path_)) return;  // in this order: another run may begin meanwhile, with its record
  throw InvalidInputError(Concat(path_.string(), ": holds ", foreign,
                                 " and was not made by this tool: give a folder that is empty or does not exist"));
}

void OutputFolder::TakeOver(const RunRecord& record, bool overwrite, bool many) {
  const auto record_path = path_ / kRecordName;
  const std::string text = Format(record);
  const bool is_ours = Exists(path_);
  if (!is_ours) {
    RefuseForeign();
    WriteFileAtomically(record_path, text, Durability::kPowerCut);
    return;
  }
  CheckIsFolderOrFile(path_ / kWorkName, std::filesystem::file_type::directory);
  CheckIsFolderOrFile(SummaryFile(), std::filesystem::file_type::regular);
  if (!many || overwrite) FolderRecord(path_).CheckUnchanged();  // not with each of a thousand stages
  if (overwrite) {
    RemoveResults();
    WriteFileAtomically(record_path, text, Durability::kPowerCut);
    return;
  }
  const std::string differences = DescribeDifferences(Parse(ReadOwnFile(record_path)), record);
  if (!differences.empty()) {
    throw InvalidInputError(Concat(path_.string(), ": holds a run with other settings (", differences,
                                   "): give --overwrite to start afresh, or another folder"));
  }
  const bool finished = std::filesystem::exists(SummaryFile());
  if (finished) losses_ = Losses();
  state_ = finished && losses_.empty() ? State::kComplete : State::kStarted;
  if (!losses_.empty()) Remove(SummaryFile());
}

void OutputFolder::Claim(const std::set<std::string>& names) const { FolderRecord(path_).Claim(names); }

void OutputFolder::WriteFileList() const { FolderRecord(path_).NoteBytes(); }

std::string OutputFolder::Losses() const {
  const FolderRecord record(path_);
  if (record.files().empty()) return Concat(FolderRecord::kName, ", which lists the files, is missing or empty");
  size_t lost = 0;
  std::string first;
  for (const auto& [name, listed] : record.files()) {
    std::error_code error;
    const uintmax_t bytes = std::filesystem::file_size(path_ / name, error);
    if (!error && listed && bytes == *listed) continue;
    if (lost++ > 0) continue;
    first = error ? Concat(name, " is missing") : Concat(name, " has ", bytes, " of ", listed.value_or(0), " bytes");
  }
  return lost == 0 ? ""
                   : Concat(lost, " of ", record.files().size(), " files are missing or have another size: ", first,
                            lost > 1 ? " and so on" : "");
}

void OutputFolder::RemoveResults() const {
  // The summary first: a folder without it never counts as complete.
  Remove(SummaryFile());
  FolderRecord(path_).RemoveFiles();
  Remove(path_ / FolderRecord::kName);
  RemoveWork();
}

void OutputFolder::StartAfresh() {
  RemoveResults();
  state_ = State::kFresh;
}

std::filesystem::path OutputFolder::WorkFile(const std::filesystem::path& output, const std::string& kind, int number) {
  return output / kWorkName / kind / StringPrintf("%06d.bin", number);
}

void OutputFolder::RemoveWork() const {
  const std::filesystem::path work = path_ / kWorkName;
  std::error_code ignored;
  if (!std::filesystem::is_directory(std::filesystem::symlink_status(work, ignored))) return;
  for (const auto& folder : std::filesystem::directory_iterator(work)) {
    if (!std::filesystem::is_directory(folder.symlink_status())) continue;
    for (const auto& file : std::filesystem::directory_iterator(folder)) {
      const bool is_file = std::filesystem::is_regular_file(file.symlink_status());
      if (is_file && IsWorkFile(file.path().lexically_relative(work).string())) Remove(file.path());
    }
    std::filesystem::remove(folder, ignored);  // where nothing of others is in it
  }
  std::filesystem::remove(work, ignored);
}

std::filesystem::path OutputFolder::MapFile(const std::string& kind, int index, const std::string& suffix) const {
  return path_ / kind / (StringPrintf("%06d", index) + suffix);
}

}  // namespace acmp
