#include "input_hash.h"

#include <sys/stat.h>
#include <tbb/parallel_for.h>

#include <cstdio>
#include <fstream>
#include <type_traits>

namespace acmp {
namespace {

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

void AddFile(const std::filesystem::path& path, Hash* hash) {
  hash->Add(!path.empty());
  if (path.empty()) return;
  std::ifstream stream(path, std::ios::binary);
  std::vector<char> block(1 << 20);
  size_t bytes = 0;
  while (stream) {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    hash->AddBytes(block.data(), static_cast<size_t>(stream.gcount()));
    bytes += static_cast<size_t>(stream.gcount());
  }
  hash->Add(bytes);
}

/// Camera, pose, landmarks, range and source views.
void AddGeometry(const Scene& scene, const SceneImage& image, Hash* hash) {
  hash->Add(image.name);
  const PinholeCamera& c = image.camera;
  for (double value : {c.fx, c.fy, c.cx, c.cy}) hash->Add(value);
  hash->Add(c.width);
  hash->Add(c.height);
  hash->Add(static_cast<int>(image.distortion.model));
  for (double value : image.distortion.coefficients) hash->Add(value);
  hash->AddBytes(image.cam_from_world.matrix().data(), 16 * sizeof(double));
  for (int landmark : image.landmark_indices) {
    hash->AddBytes(scene.landmarks_in_world[static_cast<size_t>(landmark)].data(), 3 * sizeof(double));
  }
  hash->Add(image.landmark_indices.size());
  hash->Add(image.depth_range ? image.depth_range->min : 0.0f);
  hash->Add(image.depth_range ? image.depth_range->max : 0.0f);
  for (int source : image.ranked_sources) hash->Add(source);
  hash->Add(image.ranked_sources.size());
}

}  // namespace

uint64_t HashOfFiles(const SceneImage& image) {
  Hash hash;
  for (const auto& path : {image.path, image.mask, image.prior_depth}) AddFile(path, &hash);
  return hash.value();
}

std::vector<uint64_t> HashFiles(const Scene& scene, const std::vector<int>& indices, const StopRequest& interrupt,
                                const std::function<void(int index)>& also) {
  std::vector<uint64_t> hashes(indices.size());
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    interrupt.Check();
    also(indices[i]);
    hashes[i] = HashOfFiles(scene.images[static_cast<size_t>(indices[i])]);
  });
  interrupt.Check();
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

std::string InputHash(const Scene& scene, const std::vector<int>& indices, const std::vector<uint64_t>& files) {
  Hash hash;
  for (size_t i = 0; i < indices.size(); ++i) {
    hash.Add(indices[i]);
    hash.Add(files.at(i));
    AddGeometry(scene, scene.images[static_cast<size_t>(indices[i])], &hash);
  }
  char text[17];
  std::snprintf(text, sizeof(text), "%016llx", static_cast<unsigned long long>(hash.value()));
  return text;
}

}  // namespace acmp
