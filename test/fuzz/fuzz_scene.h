#pragma once

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/scene.h"
#include "fuzz/fuzz_input.h"

namespace acmp::fuzz {

/// A scene's folder with two images of 8 x 6 pixels, images/00000000.png and 00000001.png.
class SceneFolder : public Folder {
 public:
  SceneFolder() {
    std::filesystem::create_directory(path() / "images");
    for (const char* name : {"00000000.png", "00000001.png"}) WritePng(path() / "images" / name, ColorImage(8, 6));
  }

  /// Reads what was written as a scene and loads its images.
  void Read(SceneFormat format) const {
    MayRefuse([&] {
      const Scene scene = ReadScene(path(), format);
      for (size_t i = 0; i < scene.images.size(); ++i) {
        LandmarksOf(scene, scene.images[i]);
        MayRefuse([&] { LoadFrame(scene, static_cast<int>(i)); });
      }
    });
  }
};

}  // namespace acmp::fuzz
