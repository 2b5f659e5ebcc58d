#include "input_hash.h"

#include <sys/stat.h>

#include <cstdio>
#include <fstream>

namespace acmp {
namespace {

uint64_t HashOfFile(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::vector<char> block(1 << 20);
  Hash hash;
  while (stream) {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    hash.AddBytes(block.data(), static_cast<size_t>(stream.gcount()));
  }
  return hash.value();
}

}  // namespace

uint64_t HashOfGeometry(const Scene& scene, const SceneImage& image) {
  Hash hash;
  hash.Add(image.name);
  const PinholeCamera& c = image.camera;
  for (double value : {c.fx, c.fy, c.cx, c.cy}) hash.Add(value);
  hash.Add(c.width);
  hash.Add(c.height);
  hash.Add(static_cast<int>(image.distortion.model));
  for (double value : image.distortion.coefficients) hash.Add(value);
  hash.AddBytes(image.readout.turn.data(), 3 * sizeof(double));
  hash.AddBytes(image.readout.move.data(), 3 * sizeof(double));
  hash.AddBytes(image.cam_from_world.matrix().data(), 16 * sizeof(double));
  hash.AddBytes(image.placed_from_world.matrix().data(), 16 * sizeof(double));
  for (int landmark : image.landmark_indices) {
    hash.AddBytes(scene.landmarks_in_world[landmark].data(), 3 * sizeof(double));
  }
  hash.Add(image.landmark_indices.size());
  hash.Add(image.depth_range ? image.depth_range->min : 0.0f);
  hash.Add(image.depth_range ? image.depth_range->max : 0.0f);
  for (int source : image.ranked_sources) hash.Add(source);
  hash.Add(image.ranked_sources.size());
  return hash.value();
}

ImageHashes HashesOf(const Scene& scene, int index) {
  const SceneImage& image = scene.images[static_cast<size_t>(index)];
  ImageHashes hashes = {index, HashOfFile(image.path), std::nullopt, std::nullopt, HashOfGeometry(scene, image)};
  if (!image.mask.empty()) hashes.mask = HashOfFile(image.mask);
  if (!image.prior_depth.empty()) hashes.prior_depth = HashOfFile(image.prior_depth);
  return hashes;
}

uint64_t StampOfFiles(const SceneImage& image) {
  Hash hash;
  for (const std::filesystem::path& path : {image.path, image.mask, image.prior_depth}) {
    struct stat file = {};
    if (path.empty() || stat(path.c_str(), &file) != 0) file = {};
    for (const timespec& time : {file.st_mtim, file.st_ctim}) {
      hash.Add(time.tv_sec);
      hash.Add(time.tv_nsec);
    }
    hash.Add(file.st_ino);
    hash.Add(file.st_size);
  }
  return hash.value();
}

std::string HexDigits(uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof(text), "%016llx", static_cast<unsigned long long>(value));
  return text;
}

std::string InputHash(const std::vector<ImageHashes>& images) {
  Hash hash;
  for (const ImageHashes& image : images) {
    hash.Add(image.index);
    hash.Add(image.file);
    if (image.mask) hash.Add(*image.mask);
    if (image.prior_depth) hash.Add(*image.prior_depth);
    hash.Add(image.geometry);
  }
  return HexDigits(hash.value());
}

}  // namespace acmp
