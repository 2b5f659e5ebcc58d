#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace acmp {

/// Settings that decide a run's results, in the order of run.txt: key and value.
using RunRecord = std::vector<std::pair<std::string, std::string>>;

/// The folder OUTPUT: where everything lies in it, and whose it is. Only one run at a time.
class OutputFolder {
 public:
  enum class State {
    kFresh,     ///< nothing done yet
    kStarted,   ///< an interrupted run with the same settings
    kComplete,  ///< a finished run with the same settings, and all its files have the size that they had
  };

  /// Makes the folder or takes over the one that is there. Throws InvalidInputError when it belongs to a run with other
  /// settings (unless `overwrite`), to something else, or to a run that is going on right now.
  OutputFolder(const std::filesystem::path& path, const RunRecord& record, bool overwrite);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  /// Removes what an interrupted run has left.
  void StartAfresh();

  State state() const { return state_; }
  /// Which files a finished run lacks now, or that are shorter or longer: then it counts as kStarted. Empty: none.
  const std::string& losses() const { return losses_; }
  /// Lists the results with their sizes. A run without the list is not complete.
  void WriteFileList() const;
  const std::filesystem::path& path() const { return path_; }

  /// OUTPUT/work/KIND/000012.bin
  std::filesystem::path WorkFile(const std::string& kind, int number) const;
  void RemoveWork() const;

  /// OUTPUT/KIND/000012SUFFIX
  std::filesystem::path MapFile(const std::string& kind, int index, const std::string& suffix) const;
  std::filesystem::path SummaryFile() const { return path_ / "summary.json"; }

 private:
  void Lock();
  void TakeOver(const RunRecord& record, bool overwrite);
  void RemoveResults() const;
  std::string Losses() const;

  std::filesystem::path path_;
  State state_ = State::kFresh;
  std::string losses_;
  int lock_ = -1;
};

/// "000012"
std::string SixDigits(int number);

}  // namespace acmp
