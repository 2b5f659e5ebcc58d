// Readers of files.

#include <string>
#include <vector>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "fuzz/fuzz_input.h"
#include "output_folder.h"
#include "work_files.h"

namespace acmp {
namespace {

/// Reads files of these names, the parts of the input, as a scene with two images of 8 x 6 pixels, and loads these.
void ReadSceneOf(const std::vector<std::string>& names, SceneFormat format, fuzz::Bytes* bytes) {
  std::filesystem::create_directory(fuzz::Folder() / "images");
  for (const char* name : {"00000000.png", "00000001.png"}) {
    const auto path = fuzz::Folder() / "images" / name;
    if (!std::filesystem::exists(path)) WritePng(path, ColorImage(8, 6));
  }
  for (const std::string& name : names) fuzz::Write(name, bytes->TakePart());
  const Scene scene = ReadScene(fuzz::Folder(), format);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    LandmarksOf(scene, scene.images[i]);
    fuzz::MayRefuse([&] { LoadFrame(scene, static_cast<int>(i)); });
  }
}

/// A scene's cameras.txt.
ACMP_FUZZ_TARGET(camera_list) { ReadCameraList(fuzz::Write("cameras.txt", bytes.Rest())); }

ACMP_FUZZ_TARGET(colmap_binary) {
  ReadSceneOf({"sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin"}, SceneFormat::kColmap, &bytes);
}

ACMP_FUZZ_TARGET(colmap_text) {
  ReadSceneOf({"sparse/cameras.txt", "sparse/images.txt", "sparse/points3D.txt"}, SceneFormat::kColmap, &bytes);
}

/// PFM and DMB files.
ACMP_FUZZ_TARGET(float_map) {
  const std::string_view content = bytes.Rest();
  const auto pfm = fuzz::Write("map.pfm", content), dmb = fuzz::Write("map.dmb", content);
  fuzz::MayRefuse([&] { ReadDepth(pfm); });
  fuzz::MayRefuse([&] { ReadPfmNormals(pfm); });
  ReadDepth(dmb);
}

/// A PNG or JPEG file as picture, as mask and as 16-bit depth.
ACMP_FUZZ_TARGET(image) {
  constexpr int kLargeSide = 1024;  // what announces more takes memory and time, as it may
  const std::string_view content = bytes.Rest();
  const ImageSize image = EncodedImageSize("image", content);
  const auto path = fuzz::Write("image.png", content);
  fuzz::MayRefuse([&] { ReadColorImage(path, {8, 6}); });
  if (image.width > kLargeSide || image.height > kLargeSide) return;
  fuzz::MayRefuse([&] { ReadMask(path); });
  ReadDepth(path);
}

ACMP_FUZZ_TARGET(mvsnet) {
  ReadSceneOf({"pair.txt", "cams/00000000_cam.txt", "cams/00000001_cam.txt"}, SceneFormat::kMvsnet, &bytes);
}

ACMP_FUZZ_TARGET(ply) { ReadPly(fuzz::Write("cloud.ply", bytes.Rest())); }

/// What an earlier run left in its folder: run.txt, files.txt, summary.json.
ACMP_FUZZ_TARGET(output_folder) {
  const std::string_view record = bytes.TakePart(), list = bytes.TakePart(), summary = bytes.TakePart();
  for (const bool overwrite : {false, true}) {
    fuzz::Write("run.txt", record);
    fuzz::Write("files.txt", list);
    fuzz::Write("summary.json", summary);
    fuzz::MayRefuse([&] { OutputFolder(fuzz::Folder(), {{"preset", "acmp"}}, overwrite); });
  }
}

/// Work files of an interrupted run: as a whole, and as the content of one that is whole.
ACMP_FUZZ_TARGET(work_file) {
  const std::string_view content = bytes.Rest();
  const auto path = fuzz::Write("work_file", content);
  for (const bool whole : {false, true}) {
    if (whole) WriteWorkFile(path, std::string(content));
    CheckWorkFile(path);
    ReadWorkFile(path);
    fuzz::MayRefuse([&] { ReadEstimate(path); });
    fuzz::MayRefuse([&] { ReadFinalMaps(path); });
  }
}

}  // namespace
}  // namespace acmp
