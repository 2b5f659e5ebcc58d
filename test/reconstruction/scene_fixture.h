#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "acmp_mapping/dataset/image_codec.h"
#include "dataset/test_folder.h"

namespace acmp {

/// A small scene in the MVSNet layout: cameras in a row look at a textured plane at z = 4, 0.25 apart.
class ReconstructFixture : public TestFolder {
 protected:
  static constexpr double kPlaneDepth = 4.0;
  static constexpr double kSpacing = 0.25;

  Eigen::Vector3d offset_ = Eigen::Vector3d::Zero();  ///< of the next scene in its world

  std::filesystem::path scene() const { return folder() / "scene"; }
  std::filesystem::path output(const std::string& name = "out") const { return folder() / name; }

  /// Every image names all others as source views.
  void WriteScene(int images, int width, int height) const {
    std::vector<std::vector<int>> sources(static_cast<size_t>(images));
    for (int i = 0; i < images; ++i) {
      WriteCamera(i, width, height);
      WriteImage(i, width, height);
      for (int j = 0; j < images; ++j) {
        if (j != i) sources[static_cast<size_t>(i)].push_back(j);
      }
    }
    WritePairs(sources);
  }
  /// @param sources of each image
  void WritePairs(const std::vector<std::vector<int>>& sources) const {
    std::string pairs = std::to_string(sources.size()) + "\n";
    for (size_t i = 0; i < sources.size(); ++i) {
      pairs += std::to_string(i) + "\n" + std::to_string(sources[i].size());
      for (int source : sources[i]) pairs += " " + std::to_string(source) + " 1";
      pairs += "\n";
    }
    WriteText("scene/pair.txt", pairs);
  }

  /// All files below a folder with their content, except times (summary.json) and the lock.
  static std::map<std::string, std::string> Contents(const std::filesystem::path& root) {
    std::map<std::string, std::string> contents;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
      const std::string name = std::filesystem::relative(entry.path(), root).string();
      if (!entry.is_regular_file() || name == "summary.json" || name == ".lock") continue;
      contents[name] = ReadText(entry.path());
    }
    return contents;
  }

  static void ExpectSameContents(const std::filesystem::path& a, const std::filesystem::path& b) {
    const auto left = Contents(a);
    const auto right = Contents(b);
    ASSERT_EQ(left.size(), right.size());
    for (const auto& [name, content] : left) {
      ASSERT_EQ(right.count(name), 1u) << name;
      EXPECT_TRUE(right.at(name) == content) << name << " differs";
    }
  }

 private:
  static std::string Number(const char* format, int index) {
    char text[32];
    std::snprintf(text, sizeof(text), format, index);
    return text;
  }

  static std::string Shift(double offset) { return offset == 0 ? "0" : std::to_string(-offset); }

  void WriteCamera(int index, int width, int height) const {
    const std::string focal = std::to_string(width);
    WriteText("scene/cams/" + Number("%08d", index) + "_cam.txt",
              "extrinsic\n1 0 0 " + std::to_string(-kSpacing * index - offset_.x()) + "\n0 1 0 " + Shift(offset_.y()) +
                  "\n0 0 1 " + Shift(offset_.z()) + "\n0 0 0 1\n\nintrinsic\n" + focal + " 0 " +
                  std::to_string((width - 1) / 2.0) + "\n0 " + focal + " " + std::to_string((height - 1) / 2.0) +
                  "\n0 0 1\n\n3 0.05 41 5\n");
  }

  void WriteImage(int index, int width, int height) const {
    ColorImage image(width, height);
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        const double x = kPlaneDepth * (col - (width - 1) / 2.0) / width + kSpacing * index;
        const double y = kPlaneDepth * (row - (height - 1) / 2.0) / width;
        const double value = 128 + 50 * std::sin(9 * x + 3 * y) + 40 * std::sin(5 * y - 7 * x + std::sin(4 * x * y));
        const auto gray = static_cast<unsigned char>(value);
        image(col, row) = {gray, static_cast<unsigned char>(255 - gray), 77};
      }
    }
    std::filesystem::create_directories(scene() / "images");
    WritePng(scene() / "images" / (Number("%08d", index) + ".png"), image);
  }
};

}  // namespace acmp
