#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace acmp {

/// Settings that decide a run's results, in the order of run.txt: key and value.
using RunRecord = std::vector<std::pair<std::string, std::string>>;

/// Of a file that is made for it, until it is destroyed.
class FileLock {
 public:
  /// @param operation of flock. With LOCK_NB, throws InvalidInputError where another process has the lock
  FileLock(const std::filesystem::path& path, int operation);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  int descriptor_;
};

/// The folder OUTPUT: where everything lies in it, and whose it is. Only one run at a time.
class OutputFolder {
 public:
  enum class State {
    kFresh,     ///< nothing done yet
    kStarted,   ///< an interrupted run with the same settings
    kComplete,  ///< a finished run with the same settings, and all its files have the size that they had
  };

  enum class Use {
    kRun,     ///< by one process, which does everything
    kStages,  ///< by any number of processes that do stages, on any machines: files are written as AtomicFile does
  };

  /// Makes the folder or takes over the one that is there. Throws InvalidInputError when it belongs to a run with other
  /// settings (unless `overwrite`), to something else, or to a run that is going on right now.
  /// @param record these settings are compared; those that only the other run has are not
  OutputFolder(const std::filesystem::path& path, const RunRecord& record, bool overwrite, Use use = Use::kRun);
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Removes what an interrupted run has left.
  void StartAfresh();

  /// Whether a run has made the folder.
  static bool Exists(const std::filesystem::path& path);
  /// The value of a setting that the folder's run has; "(none)" without it.
  std::string Setting(const std::string& key) const;
  /// Gives the folder's run another record.
  void Rewrite(const RunRecord& record) const;

  State state() const { return state_; }
  /// Which files a finished run lacks now, or that are shorter or longer: then it counts as kStarted. Empty: none.
  const std::string& losses() const { return losses_; }
  /// Says which files the run is to write, by their names in the folder, before the first of them: nothing else is ever
  /// removed. Throws as FolderRecord.
  void Claim(const std::set<std::string>& names) const;
  /// Lists the results with their sizes. A run without the list is not complete.
  void WriteFileList() const;
  const std::filesystem::path& path() const { return path_; }

  /// OUTPUT/work/KIND/000012.bin
  static std::filesystem::path WorkFile(const std::filesystem::path& output, const std::string& kind, int number);
  std::filesystem::path WorkFile(const std::string& kind, int number) const { return WorkFile(path_, kind, number); }
  void RemoveWork() const;

  /// OUTPUT/KIND/000012SUFFIX
  std::filesystem::path MapFile(const std::string& kind, int index, const std::string& suffix) const;
  std::filesystem::path SummaryFile() const { return path_ / "summary.json"; }

 private:
  void RefuseForeign() const;
  void TakeOver(const RunRecord& record, bool overwrite, bool many);
  void RemoveResults() const;
  std::string Losses() const;

  std::filesystem::path path_;
  State state_ = State::kFresh;
  std::string losses_;
  std::optional<FileLock> lock_;
};

}  // namespace acmp
