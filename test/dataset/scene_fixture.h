#pragma once

#include <string>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/test_folder.h"

namespace acmp {

/// Writes small scenes as files. Two images of 32 x 24 px; `cameras`, `images`, `points` are the text files' content.
class SceneFixture : public TestFolder {
 protected:
  static constexpr int kWidth = 32;
  static constexpr int kHeight = 24;

  SceneFixture() {
    WriteImage("images/000000.png", kWidth, kHeight);
    WriteImage("images/000001.png", kWidth, kHeight);
  }

  void WriteImage(const std::string& name, int width, int height) const {
    std::filesystem::create_directories((folder() / name).parent_path());
    ColorImage image(width, height);
    // Smooth, at most 4 grey levels from pixel to pixel.
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        image(col, row) = {static_cast<unsigned char>(40 + 4 * col), static_cast<unsigned char>(60 + 3 * row),
                           static_cast<unsigned char>(80 + 2 * col + 2 * row)};
      }
    }
    WritePng(folder() / name, image);
  }

  void WriteColmapText() const {
    WriteText("sparse/cameras.txt", cameras);
    WriteText("sparse/images.txt", images);
    WriteText("sparse/points3D.txt", points);
  }

  Scene ReadColmap() const {
    WriteColmapText();
    return ReadScene(folder());
  }

  void WriteMvsnet() const {
    WriteText("pair.txt", pairs);
    WriteText("cams/00000000_cam.txt", cam0);
    WriteText("cams/00000001_cam.txt", cam1);
  }

  std::string cameras =
      "# Camera list\n# Number of cameras: 1\n"
      "1 PINHOLE 32 24 30 31 16.25 12.75\n";
  std::string images =
      "# Image list\n# Number of images: 2, mean observations per image: 2\n"
      "7 0.5 0.5 0.5 0.5 0.1 0.2 0.3 1 000001.png\n"
      "1 2 12 3.5 4.5 -1 5 6 11 1.5 2 12\n"
      "3 1 0 0 0 0 0 0 1 000000.png\n"
      "\n";
  std::string points =
      "# Number of points: 2\n"
      "11 1 2 3 10 20 30 0.5 7 1\n"
      "12 -1.5 0 4e0 10 20 30 0.5 7 0\n";

  std::string pairs = "2\n0\n1 1 10.5\n1\n1 0 10.5\n";
  std::string cam0 =
      "extrinsic\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n30 0 15.75\n0 31 12.25\n0 0 1\n\n0.5 0.01 192 8.5\n";
  // Rotation of the quaternion (0.5 0.5 0.5 0.5): x -> y -> z -> x.
  std::string cam1 =
      "extrinsic\n0 0 1 0.1\n1 0 0 0.2\n0 1 0 0.3\n0 0 0 1\n\nintrinsic\n30 0 15.75\n0 31 12.25\n0 0 1\n\n1 0.5 11\n";
};

/// `text` with its only occurrence of `from` replaced.
inline std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

}  // namespace acmp
