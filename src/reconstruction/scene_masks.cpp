#include "scene_masks.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/masks.h"
#include "acmp_mapping/dataset/prior_depths.h"

namespace acmp {

std::vector<int> TakeMasks(const ReconstructOptions& options, const std::vector<int>& indices, Scene* scene,
                           Progress* progress) {
  if (options.masks.empty()) return indices;
  AddMasks(options.masks, scene);
  const auto image = [&](size_t i) -> const SceneImage& { return scene->images[static_cast<size_t>(indices[i])]; };
  std::vector<char> is_of_use(indices.size(), 1);
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    if (!image(i).mask.empty() && IgnoresAll(LoadMask(image(i)))) is_of_use[i] = 0;
  });
  std::vector<int> of_use;
  size_t with_mask = 0;
  for (size_t i = 0; i < indices.size(); ++i) {
    if (!image(i).mask.empty()) ++with_mask;
    if (is_of_use[i] != 0) {
      of_use.push_back(indices[i]);
    } else {
      progress->Warn(Concat("image ", image(i).name, " takes no part: its mask ", image(i).mask.string(),
                            " ignores every pixel (black)"));
    }
  }
  progress->Note(Concat(with_mask, " of ", indices.size(), " images have a mask in ", options.masks.string()));
  if (of_use.empty()) {
    throw InvalidInputError(Concat("--masks ", options.masks.string(), ": all masks ignore every pixel (black)"));
  }
  return of_use;
}

void TakePriorDepths(const ReconstructOptions& options, const std::vector<int>& indices, Scene* scene,
                     Progress* progress) {
  if (options.prior_depth.empty()) return;
  AddPriorDepths(options.prior_depth, scene);
  const auto image = [&](size_t i) -> SceneImage& { return scene->images[static_cast<size_t>(indices[i])]; };
  std::vector<char> is_empty(indices.size(), 0);
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    if (image(i).prior_depth.empty()) return;
    const DepthMap depth = ReadPriorDepthOf(image(i));
    is_empty[i] = std::none_of(depth.begin(), depth.end(), [](float z) { return z > 0; }) ? 1 : 0;
  });
  size_t with_depth = 0;
  for (size_t i = 0; i < indices.size(); ++i) {
    if (is_empty[i] != 0) {
      progress->Warn(Concat("image ", image(i).name, ": its prior depth ", image(i).prior_depth.string(),
                            " has no pixel with a positive, finite depth"));
    } else if (!image(i).prior_depth.empty()) {
      ++with_depth;
    }
  }
  progress->Note(
      Concat(with_depth, " of ", indices.size(), " images have prior depth in ", options.prior_depth.string()));
}

}  // namespace acmp
