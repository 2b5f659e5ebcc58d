#include "output_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

constexpr const char* kRecordName = "run.txt";
constexpr const char* kRecordTitle = "# settings of the run that made this folder\n";
constexpr const char* kLockName = ".lock";
constexpr const char* kListName = "files.txt";
constexpr const char* kTemporarySuffix = ".partial";  // of AtomicFile
constexpr const char* kWorkName = "work";
constexpr std::array<const char*, 10> kResults = {"depth",  "normal",    "cost",  "confidence",  "pictures",
                                                  "colmap", "fused.ply", "tiles", "cameras.txt", "camera.yaml"};

std::string Format(const RunRecord& record) {
  std::string text = kRecordTitle;
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

/// Whether a run writes files of that name into a folder of its results: 000012.pfm, 000012_depth.png, 3_-4_0.ply.
bool IsOurResult(const std::filesystem::path& folder, std::string name) {
  if (name == "index.json") return folder.filename() == "tiles";
  const std::string suffix = kTemporarySuffix;
  if (name.size() > suffix.size() && name.compare(name.size() - suffix.size(), suffix.size(), suffix) == 0) {
    name.resize(name.size() - suffix.size());
    if (name == "index.json") return folder.filename() == "tiles";
  }
  static const std::regex image("[0-9]{6}(_[a-z]+)?\\.(pfm|png|dmb)"), tile("-?[0-9]+_-?[0-9]+_-?[0-9]+\\.ply");
  return std::regex_match(name, folder.filename() == "tiles" ? tile : image);
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

/// A file, or of a folder what a run writes there: what others have put beside it stays.
void RemoveResult(const std::filesystem::path& path) {
  if (!std::filesystem::is_directory(std::filesystem::symlink_status(path)) || path.filename() == "colmap") {
    return Remove(path);
  }
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    if (IsOurResult(path, entry.path().filename().string())) Remove(entry.path());
  }
  std::error_code not_empty;
  std::filesystem::remove(path, not_empty);
}

}  // namespace

OutputFolder::OutputFolder(const std::filesystem::path& path, const RunRecord& record, bool overwrite, Use use)
    : path_(path) {
  MakeFolder(path_);
  Lock(use == Use::kStages && !overwrite);
  try {
    TakeOver(record, overwrite);
  } catch (...) {
    close(lock_);
    throw;
  }
}

OutputFolder::~OutputFolder() { close(lock_); }

bool OutputFolder::Exists(const std::filesystem::path& path) {
  return ReadText(path / kRecordName).rfind(kRecordTitle, 0) == 0;
}

std::string OutputFolder::Setting(const std::string& key) const {
  return ValueOf(Parse(ReadText(path_ / kRecordName)), key);
}

void OutputFolder::Rewrite(const RunRecord& record) const {
  WriteFileAtomically(path_ / kRecordName, Format(record), Durability::kPowerCut);
}

void OutputFolder::Lock(bool shared) {
  const auto path = path_ / kLockName;
  lock_ = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (lock_ < 0) throw ProcessingError(Concat("cannot create ", path.string(), ": ", std::strerror(errno)));
  if (flock(lock_, (shared ? LOCK_SH : LOCK_EX) | LOCK_NB) == 0) return;
  const int reason = errno;
  close(lock_);
  if (reason != EWOULDBLOCK) throw ProcessingError(Concat("cannot lock ", path.string(), ": ", std::strerror(reason)));
  throw InvalidInputError(Concat(path_.string(), ": another run is writing to this folder right now"));
}

void OutputFolder::TakeOver(const RunRecord& record, bool overwrite) {
  const auto record_path = path_ / kRecordName;
  const std::string text = Format(record);
  const bool is_ours = Exists(path_);
  if (!is_ours) {
    const std::string foreign = ForeignEntry(path_);
    if (!foreign.empty()) {
      throw InvalidInputError(Concat(path_.string(), ": holds ", foreign,
                                     " and was not made by this tool: give a folder that is empty or does not exist"));
    }
    WriteFileAtomically(record_path, text, Durability::kPowerCut);
    return;
  }
  if (overwrite) {
    RemoveResults();
    WriteFileAtomically(record_path, text, Durability::kPowerCut);
    return;
  }
  const std::string differences = DescribeDifferences(Parse(ReadText(record_path)), record);
  if (!differences.empty()) {
    throw InvalidInputError(Concat(path_.string(), ": holds a run with other settings (", differences,
                                   "): give --overwrite to start afresh, or another folder"));
  }
  const bool finished = std::filesystem::exists(SummaryFile());
  if (finished) losses_ = Losses();
  state_ = finished && losses_.empty() ? State::kComplete : State::kStarted;
  if (!losses_.empty()) Remove(SummaryFile());
}

void OutputFolder::WriteFileList() const {
  std::map<std::string, uintmax_t> bytes;  // of each file
  const auto add = [&](const std::filesystem::path& path) {
    const std::string name = std::filesystem::relative(path, path_).string();
    if (std::filesystem::is_regular_file(path) && path.extension() != kTemporarySuffix) {
      bytes[name] = std::filesystem::file_size(path);
    }
  };
  for (const char* name : kResults) {
    const std::filesystem::path result = path_ / name;
    add(result);
    if (!std::filesystem::is_directory(result)) continue;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(result)) add(entry.path());
  }
  std::string text = "# bytes and name of each file of the finished run\n";
  for (const auto& [name, size] : bytes) text += Concat(size, " ", name, "\n");
  WriteFileAtomically(path_ / kListName, text, Durability::kPowerCut);
}

std::string OutputFolder::Losses() const {
  std::ifstream list(path_ / kListName, std::ios::binary);
  if (!list) return Concat(kListName, ", which lists the files, is missing");
  size_t files = 0, lost = 0;
  std::string first, line;
  std::getline(list, line);  // the comment
  while (std::getline(list, line)) {
    std::istringstream words(line);
    words.imbue(std::locale::classic());
    uintmax_t listed = 0;
    std::string name;
    if (!(words >> listed) || words.get() != ' ' || !std::getline(words, name)) {
      return Concat(kListName, ", which lists the files, is damaged: \"", line, "\"");
    }
    ++files;
    std::error_code error;
    const uintmax_t bytes = std::filesystem::file_size(path_ / name, error);
    if (!error && bytes == listed) continue;
    if (lost++ == 0)
      first = error ? Concat(name, " is missing") : Concat(name, " has ", bytes, " of ", listed, " bytes");
  }
  if (files == 0) return Concat(kListName, ", which lists the files, is empty");
  return lost == 0 ? ""
                   : Concat(lost, " of ", files, " files are missing or have another size: ", first,
                            lost > 1 ? " and so on" : "");
}

void OutputFolder::RemoveResults() const {
  // The summary first: a folder without it never counts as complete.
  Remove(SummaryFile());
  for (const char* name : kResults) RemoveResult(path_ / name);
  for (const char* name : {kListName, kWorkName}) Remove(path_ / name);
}

void OutputFolder::StartAfresh() {
  RemoveResults();
  state_ = State::kFresh;
}

std::filesystem::path OutputFolder::WorkFile(const std::filesystem::path& output, const std::string& kind, int number) {
  return output / kWorkName / kind / StringPrintf("%06d.bin", number);
}

std::filesystem::path OutputFolder::MakeWorkFolder(const std::string& kind) const {
  MakeFolder(path_ / kWorkName);
  std::string name = (path_ / kWorkName / (kind + "_XXXXXX")).string();
  if (!mkdtemp(name.data())) throw ProcessingError(Concat("cannot make ", name, ": ", std::strerror(errno)));
  return name;
}

void OutputFolder::RemoveWork() const { Remove(path_ / kWorkName); }

std::filesystem::path OutputFolder::MapFile(const std::string& kind, int index, const std::string& suffix) const {
  return path_ / kind / (StringPrintf("%06d", index) + suffix);
}

}  // namespace acmp
