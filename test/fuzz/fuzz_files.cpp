// Readers of files.

#include <array>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/evaluation/evaluate.h"
#include "fuzz/fuzz_input.h"
#include "output_folder.h"
#include "work_files.h"

namespace acmp {
namespace {

/// A scene's folder with two images of 8 x 6 pixels, images/00000000.png and 00000001.png.
class SceneFolder : public fuzz::Folder {
 public:
  SceneFolder() {
    std::filesystem::create_directory(path() / "images");
    for (const char* name : {"00000000.png", "00000001.png"}) WritePng(path() / "images" / name, ColorImage(8, 6));
  }

  /// Writes the parts of the input as files of these names, reads them as a scene and loads its images.
  int Read(const uint8_t* data, size_t size, const std::array<const char*, 3>& names, SceneFormat format) const {
    const auto parts = fuzz::Parts(data, size, names.size());
    for (size_t i = 0; i < names.size(); ++i) Write(names[i], parts[i]);
    fuzz::MayRefuse([&] {
      const Scene scene = ReadScene(path(), format);
      for (size_t i = 0; i < scene.images.size(); ++i) {
        LandmarksOf(scene, scene.images[i]);
        fuzz::MayRefuse([&] { LoadFrame(scene, static_cast<int>(i)); });
      }
    });
    return 0;
  }
};

/// A scene's cameras.txt.
ACMP_FUZZ_TARGET(camera_list) {
  static const fuzz::Folder folder;
  const auto path = folder.Write("cameras.txt", fuzz::Bytes(data, size).Rest());
  fuzz::MayRefuse([&] { ReadCameraList(path); });
  return 0;
}

/// The index of a cloud in tiles, beside one tile.
ACMP_FUZZ_TARGET(cloud_tiles) {
  static const fuzz::Folder folder;
  WritePly(folder.path() / "0_0_0.ply", PointCloud(2));
  folder.Write("index.json", fuzz::Bytes(data, size).Rest());
  fuzz::MayRefuse([&] { ReadCloud(folder.path(), 1); });
  return 0;
}

/// A COLMAP model, binary: cameras.bin, images.bin, points3D.bin.
ACMP_FUZZ_TARGET(colmap_binary) {
  static const SceneFolder folder;
  return folder.Read(data, size, {"sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin"},
                     SceneFormat::kColmap);
}

/// A COLMAP model, text: cameras.txt, images.txt, points3D.txt.
ACMP_FUZZ_TARGET(colmap_text) {
  static const SceneFolder folder;
  return folder.Read(data, size, {"sparse/cameras.txt", "sparse/images.txt", "sparse/points3D.txt"},
                     SceneFormat::kColmap);
}

/// PFM and DMB files.
ACMP_FUZZ_TARGET(float_map) {
  static const fuzz::Folder folder;
  const std::string_view content = fuzz::Bytes(data, size).Rest();
  const auto pfm = folder.Write("map.pfm", content);
  const auto dmb = folder.Write("map.dmb", content);
  fuzz::MayRefuse([&] { ReadDepth(pfm); });
  fuzz::MayRefuse([&] { ReadPfmNormals(pfm); });
  fuzz::MayRefuse([&] { ReadDepth(dmb); });
  return 0;
}

/// A PNG or JPEG file as picture, as mask and as 16-bit depth.
ACMP_FUZZ_TARGET(image) {
  constexpr int kLargeSide = 1024;  // what announces more takes memory and time, as it may
  static const fuzz::Folder folder;
  const std::string_view content = fuzz::Bytes(data, size).Rest();
  fuzz::MayRefuse([&] {
    const ImageSize image = EncodedImageSize("image", content);
    const auto path = folder.Write("image.png", content);
    fuzz::MayRefuse([&] { ReadColorImage(path, {8, 6}); });
    if (image.width > kLargeSide || image.height > kLargeSide) return;
    fuzz::MayRefuse([&] { ReadMask(path); });
    ReadDepth(path);
  });
  return 0;
}

/// The MVSNet layout: pair.txt, cams/00000000_cam.txt, cams/00000001_cam.txt.
ACMP_FUZZ_TARGET(mvsnet) {
  static const SceneFolder folder;
  return folder.Read(data, size, {"pair.txt", "cams/00000000_cam.txt", "cams/00000001_cam.txt"}, SceneFormat::kMvsnet);
}

/// A PLY cloud.
ACMP_FUZZ_TARGET(ply) {
  static const fuzz::Folder folder;
  const auto path = folder.Write("cloud.ply", fuzz::Bytes(data, size).Rest());
  fuzz::MayRefuse([&] { ReadPly(path); });
  return 0;
}

/// What an earlier run left in its folder: run.txt, files.txt, summary.json.
ACMP_FUZZ_TARGET(output_folder) {
  static const fuzz::Folder folder;
  const auto parts = fuzz::Parts(data, size, 3);
  for (const bool overwrite : {false, true}) {
    folder.Write("run.txt", parts[0]);
    folder.Write("files.txt", parts[1]);
    folder.Write("summary.json", parts[2]);
    fuzz::MayRefuse([&] { OutputFolder(folder.path(), {{"preset", "acmp"}}, overwrite); });
  }
  return 0;
}

/// Work files of an interrupted run: as a whole, and as the content of one that is whole.
ACMP_FUZZ_TARGET(work_file) {
  static const fuzz::Folder folder;
  const std::string_view content = fuzz::Bytes(data, size).Rest();
  const auto path = folder.Write("work_file", content);
  const auto read = [&path] {
    CheckWorkFile(path);
    ReadPoints(path);
    fuzz::MayRefuse([&] { ReadEstimate(path); });
    fuzz::MayRefuse([&] { ReadFinalMaps(path); });
  };
  read();
  WriteWorkFile(path, std::string(content));
  read();
  return 0;
}

}  // namespace
}  // namespace acmp
