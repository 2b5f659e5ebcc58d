#include "image_files.h"

#include <tbb/parallel_for_each.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {
namespace {

bool Writes(const ReconstructOptions& options, const std::string& kind) {
  return std::find(options.maps.begin(), options.maps.end(), kind) != options.maps.end();
}

}  // namespace

std::vector<std::filesystem::path> FilesOfImage(const ReconstructOptions& options, const OutputFolder& folder,
                                                int index) {
  std::vector<std::filesystem::path> files;
  for (const std::string& kind : options.maps) {
    files.push_back(folder.MapFile(kind, index, ".pfm"));
    if (!options.no_pictures) files.push_back(folder.MapFile("pictures", index, "_" + kind + ".png"));
  }
  if (Writes(options, "depth")) files.push_back(folder.MapFile("depth", index, ".png"));
  if (options.dmb) files.push_back(folder.MapFile("depth", index, ".dmb"));
  return files;
}

ImageFiles::ImageFiles(ReconstructRun* run)
    : run_(*run),
      measures_confidence_(Writes(run->options, "confidence") &&
                           !run->options.online()) {  // online maps come with theirs
  for (const std::string& kind : run_.options.maps) MakeFolder(run_.folder->path() / kind);
  if (!run_.options.no_pictures && !run_.options.maps.empty()) MakeFolder(run_.folder->path() / "pictures");
  if (run_.options.colmap) colmap_.emplace(run);
}

int ImageFiles::AddTasks(const ImagePlan& image, RunTasks* tasks) {
  const auto confidence = std::make_shared<ConfidenceMap>();
  std::vector<int> after = tasks->FinalStepsRead(image);
  if (measures_confidence_) {
    after = {tasks->AddConfidence(image, [confidence](ConfidenceMap measured) { *confidence = std::move(measured); })};
  }
  return tasks->AddFileTask(after, [this, index = image.index, confidence] { WriteFiles(index, *confidence); });
}

void ImageFiles::WriteFiles(int index, const ConfidenceMap& measured) {
  if (colmap_ || !run_.options.maps.empty()) {
    const std::shared_ptr<const FinalMaps> maps = run_.store.Final(index);
    Timer timer;
    const size_t too_far = Write(index, *maps, measures_confidence_ ? measured : maps->confidence);
    run_.Count(&RunTimes::writing_ms, timer.Lap());
    const std::lock_guard<std::mutex> lock(run_.mutex);
    too_far_ += too_far;
  }
  run_.store.ReleaseFinal(index);
  run_.progress.Step();
}

void ImageFiles::WarnOfDepthsTooFar() const {
  if (too_far_ == 0) return;
  run_.progress.Warn(
      Concat(too_far_, " pixels deeper than 65.535 units are missing in depth/*.png; the .pfm have them"));
}

size_t ImageFiles::Write(int index, const FinalMaps& maps, const ConfidenceMap& confidence) const {
  size_t too_far = 0;
  std::vector<std::function<void()>> files;
  const auto add = [&](const std::string& kind, const std::string& suffix, const auto& write) {
    files.emplace_back([path = run_.folder->MapFile(kind, index, suffix), write] {
      write(path);
      StartWriteback(path);
    });
  };
  const auto add_map = [&](const std::string& kind, const auto& map, const auto& make_picture) {
    if (!Writes(run_.options, kind)) return;
    add(kind, ".pfm", [&map](const auto& path) { WritePfm(path, map.View()); });
    if (run_.options.no_pictures) return;
    add("pictures", "_" + kind + ".png",
        [&map, make_picture](const auto& path) { WritePng(path, make_picture(map.View())); });
  };
  add_map("depth", maps.depth, DepthPicture);
  add_map("normal", maps.normal, NormalPicture);
  add_map("cost", maps.cost, CostPicture);
  add_map("confidence", confidence, ConfidencePicture);
  if (Writes(run_.options, "depth")) {
    add("depth", ".png", [&](const auto& path) { too_far = WriteDepthPng(path, maps.depth.View()); });
  }
  if (run_.options.dmb) add("depth", ".dmb", [&](const auto& path) { WriteDmb(path, maps.depth.View()); });
  if (colmap_) files.emplace_back([&] { colmap_->WriteMaps(index, maps); });
  // Side by side: compressing pictures takes longer than writing them.
  tbb::parallel_for_each(files, [](const std::function<void()>& write) { write(); });
  return too_far;
}

}  // namespace acmp
