#include "scene_part.h"

#include <algorithm>
#include <utility>

namespace acmp {

void ScenePart::Load(int chunk) {
  if (IsLoaded(chunk)) return;
  ChunkPlan loaded = plans_.Read(chunk);
  std::map<int, ImagePlan> images;  // all, by scene index
  for (ImagePlan& image : plan_.images) images[image.index] = std::move(image);
  for (auto& [index, view] : loaded.views) {
    if (static_cast<size_t>(index) >= scene_.images.size()) scene_.images.resize(static_cast<size_t>(index) + 1);
    scene_.images[static_cast<size_t>(index)] = std::move(view.image);
    geometry_[index] = view.geometry;
    images.try_emplace(index, ImagePlan{index, {}, {}, view.no_map});
  }
  for (ImagePlan& image : loaded.images) images[image.index] = std::move(image);
  plan_.origin = loaded.origin;
  plan_.images.clear();
  for (auto& [index, image] : images) plan_.images.push_back(std::move(image));
  chunks_[chunk] = std::move(loaded.fused_before);
}

const ImagePlan* ScenePart::Find(int index) const {
  const auto found = std::lower_bound(plan_.images.begin(), plan_.images.end(), index,
                                      [](const ImagePlan& image, int wanted) { return image.index < wanted; });
  return found != plan_.images.end() && found->index == index ? &*found : nullptr;
}

std::vector<int> ScenePart::ImagesRead(int index) {
  Load(plans_.ChunkOf(index));
  return plan_.ImagesRead(*Find(index));
}

std::vector<int> ScenePart::ImagesOf(int chunk) const {
  std::vector<int> indices;
  for (const ImagePlan& image : plan_.images) {
    if (plans_.ChunkOf(image.index) == chunk) indices.push_back(image.index);
  }
  return indices;
}

}  // namespace acmp
