#include "reconstruct_image_files.h"

#include <oneapi/tbb/parallel_invoke.h>

#include <algorithm>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {

ImageFiles::ImageFiles(const ReconstructRun* run) : run_(*run) {
  for (const std::string& kind : run_.options.maps) MakeFolder(run_.folder.path() / kind);
  if (!run_.options.no_pictures && !run_.options.maps.empty()) MakeFolder(run_.folder.path() / "pictures");
  if (run_.options.colmap) colmap_.emplace(run);
}

bool ImageFiles::Writes(const std::string& kind) const {
  const std::vector<std::string>& maps = run_.options.maps;
  return std::find(maps.begin(), maps.end(), kind) != maps.end();
}

std::filesystem::path ImageFiles::Picture(const std::string& kind, int index) const {
  return run_.folder.MapFile("pictures", index, "_" + kind + ".png");
}

std::vector<std::filesystem::path> ImageFiles::FilesOf(int index) const {
  std::vector<std::filesystem::path> files;
  for (const std::string& kind : run_.options.maps) {
    files.push_back(run_.folder.MapFile(kind, index, ".pfm"));
    if (WritesPicture(kind)) files.push_back(Picture(kind, index));
  }
  if (Writes("depth")) files.push_back(run_.folder.MapFile("depth", index, ".png"));
  if (run_.options.dmb) files.push_back(run_.folder.MapFile("depth", index, ".dmb"));
  if (colmap_) {
    for (auto& file : colmap_->FilesOf(index)) files.push_back(std::move(file));
  }
  return files;
}

bool ImageFiles::AllExist(int index) const {
  const auto files = FilesOf(index);
  return std::all_of(files.begin(), files.end(), [](const auto& file) { return std::filesystem::exists(file); });
}

size_t ImageFiles::WriteDepth(int index, const ImageView<const float>& depth) const {
  WritePfm(run_.folder.MapFile("depth", index, ".pfm"), depth);
  if (run_.options.dmb) WriteDmb(run_.folder.MapFile("depth", index, ".dmb"), depth);
  return WriteDepthPng(run_.folder.MapFile("depth", index, ".png"), depth);
}

size_t ImageFiles::Write(int index, const StoredFinalMaps& maps, const ImageView<const float>& confidence) const {
  const ReconstructFolder& folder = run_.folder;
  size_t too_far = 0;
  // One task per quantity: compressing pictures takes longer than writing them.
  tbb::parallel_invoke(
      [&] {
        if (Writes("depth")) too_far = WriteDepth(index, maps.depth());
      },
      [&] {
        if (WritesPicture("depth")) WritePng(Picture("depth", index), DepthPicture(maps.depth()));
      },
      [&] {
        if (Writes("normal")) WritePfm(folder.MapFile("normal", index, ".pfm"), maps.normal());
        if (WritesPicture("normal")) WritePng(Picture("normal", index), NormalPicture(maps.normal()));
      },
      [&] {
        if (Writes("cost")) WritePfm(folder.MapFile("cost", index, ".pfm"), maps.cost());
        if (WritesPicture("cost")) WritePng(Picture("cost", index), CostPicture(maps.cost()));
      },
      [&] {
        if (Writes("confidence")) WritePfm(folder.MapFile("confidence", index, ".pfm"), confidence);
        if (WritesPicture("confidence")) WritePng(Picture("confidence", index), ConfidencePicture(confidence));
      },
      [&] {
        if (colmap_) colmap_->WriteMaps(index, maps);
      });
  for (const auto& file : FilesOf(index)) StartWriteback(file);
  return too_far;
}

}  // namespace acmp
