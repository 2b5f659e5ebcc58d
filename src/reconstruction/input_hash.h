#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "acmp_mapping/dataset/scene.h"

namespace acmp {

/// FNV-1a, 64 bit: tells inputs apart, guards against no attacker.
class Hash {
 public:
  void AddBytes(const void* data, size_t bytes) {
    for (const auto* p = static_cast<const unsigned char*>(data); bytes > 0; ++p, --bytes) {
      value_ = (value_ ^ *p) * 1099511628211u;
    }
  }
  template <class T>
  void Add(const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    AddBytes(&value, sizeof(value));
  }
  void Add(const std::string& text) {
    Add(text.size());
    AddBytes(text.data(), text.size());
  }
  uint64_t value() const { return value_; }

 private:
  uint64_t value_ = 14695981039346656037u;
};

/// Of what a run reads of one image.
struct ImageHashes {
  int index = 0;                        ///< in the scene
  uint64_t file = 0;                    ///< its content
  std::optional<uint64_t> mask;         ///< of its mask's file, where it has one
  std::optional<uint64_t> prior_depth;  ///< of its file, where it has one
  uint64_t geometry = 0;                ///< camera, pose, landmarks, range and source views that the dataset names
};

/// Reads the files once, without decoding them.
ImageHashes HashesOf(const Scene& scene, int index);
/// Only ImageHashes::geometry.
uint64_t HashOfGeometry(const Scene& scene, const SceneImage& image);

/// Another number once one of the image's files has been written or replaced. Does not read them.
uint64_t StampOfFiles(const SceneImage& image);

/// 16 digits; images in the order of their index.
std::string InputHash(const std::vector<ImageHashes>& images);
std::string HexDigits(uint64_t value);

}  // namespace acmp
