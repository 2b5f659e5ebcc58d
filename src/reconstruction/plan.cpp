#include "plan.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/geometry/local_origin.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"
#include "acmp_mapping/keyframe/source_view_selection.h"

namespace acmp {
namespace {

/// Source views of the dataset's ranking that do not take part.
size_t CountLeftOut(const SceneImage& image, const std::set<int>& taking_part) {
  return static_cast<size_t>(std::count_if(image.ranked_sources.begin(), image.ranked_sources.end(),
                                           [&](int source) { return taking_part.count(source) == 0; }));
}

Eigen::Vector3d CentreOf(const SceneImage& image) { return image.cam_from_world.inverse().translation(); }

/// The middle of the cameras, where that is farther from the world's origin than some of their extents.
Eigen::Vector3d OriginOf(const Scene& scene, const std::vector<int>& indices) {
  constexpr double kNear = 16;  // extents: float32 loses 4 bits of 24 there
  Eigen::AlignedBox3d box;
  for (int index : indices) box.extend(CentreOf(scene.images[static_cast<size_t>(index)]));
  const double extent = box.isEmpty() ? 0 : box.diagonal().norm();
  if (!(extent > 0)) return Eigen::Vector3d::Zero();
  return LocalOrigin(box.center(), kNear * extent, std::exp2(std::ceil(std::log2(extent))));
}

/// The dataset's own ranking without images that do not take part or stand at the same place.
std::vector<int> SourcesOfDataset(const Scene& scene, const ImagePlan& plan, const std::set<int>& taking_part,
                                  int max_sources, std::vector<std::string>* warnings) {
  const SceneImage& image = scene.images[plan.index];
  std::vector<int> sources;
  for (int source : image.ranked_sources) {
    if (static_cast<int>(sources.size()) == max_sources) break;
    if (taking_part.count(source) == 0) continue;
    const double baseline = (CentreOf(image) - CentreOf(scene.images[source])).norm();
    if (baseline <= 1e-6 * plan.range.min) {  // what the matcher takes for no baseline
      warnings->push_back(Concat("image ", image.name, ": source view ", scene.images[source].name,
                                 " is left out: both were taken from the same place (baseline ", baseline, ")"));
      continue;
    }
    sources.push_back(source);
  }
  return sources;
}

/// Source views of the images for which the dataset names none, among all of these.
void ChooseSourceViews(const Scene& scene, int max_sources, std::vector<ImagePlan>* images) {
  std::vector<SourceViewCandidate> all;
  std::vector<std::vector<size_t>> observers(scene.landmarks_in_world.size());
  for (size_t i = 0; i < images->size(); ++i) {
    const SceneImage& image = scene.images[static_cast<size_t>((*images)[i].index)];
    all.push_back({{image.camera, image.cam_from_world}});
    for (int landmark : image.landmark_indices) observers[static_cast<size_t>(landmark)].push_back(i);
  }
  tbb::enumerable_thread_specific<std::vector<SourceViewCandidate>> candidates_of_threads(all);  // not a copy per image
  tbb::parallel_for(size_t{0}, images->size(), [&](size_t i) {
    ImagePlan& plan = (*images)[i];
    const SceneImage& image = scene.images[static_cast<size_t>(plan.index)];
    if (!image.ranked_sources.empty() || !(plan.range.max > 0)) return;  // 0: no image has a range
    std::vector<SourceViewCandidate>& candidates = candidates_of_threads.local();
    std::vector<int> shared(candidates.size());
    int count = 0;
    for (int landmark : image.landmark_indices) {
      const Eigen::Vector3d& point = scene.landmarks_in_world[static_cast<size_t>(landmark)];
      if (!(DepthInView(point, image.camera, image.cam_from_world) > 0)) continue;
      ++count;
      for (size_t observer : observers[static_cast<size_t>(landmark)]) ++shared[observer];
    }
    for (size_t k = 0; k < shared.size(); ++k) {
      candidates[k].shared_landmarks = count > 0 ? static_cast<double>(shared[k]) / count : 1;
    }
    for (const auto& view : SelectSourceViews(all[i].view, plan.range, candidates, max_sources).views) {
      plan.sources.push_back((*images)[view.index].index);
    }
  });
}

/// @param all 0, 0: none yet
void Extend(const std::optional<DepthRange>& range, DepthRange* all) {
  if (!range) return;
  all->min = all->max == 0 ? range->min : std::min(all->min, range->min);
  all->max = std::max(all->max, range->max);
}

std::optional<DepthRange> LandmarkRange(const Scene& scene, const SceneImage& image) {
  std::vector<Eigen::Vector3d> landmarks = LandmarksOf(scene, image);
  if (!image.mask.empty()) {
    landmarks = WithoutMasked(std::move(landmarks), image.camera, image.cam_from_world, LoadMask(scene, image));
  }
  return DepthRangeFromLandmarks(landmarks, image.camera, image.cam_from_world);
}

std::string NoRange(const SceneImage& image) {
  const bool has_enough = image.landmark_indices.size() >= kMinDepthLandmarks;
  return Concat("no depth range: the dataset names none, and of its ", image.landmark_indices.size(),
                " landmarks fewer than ", kMinDepthLandmarks, " are in view",
                has_enough ? ": poses and points do not fit each other. If the poses are right," : ";",
                " give a depth range (--depth-min and --depth-max)");
}

}  // namespace

std::optional<DepthRange> DatasetRange(const SceneImage& image) {
  // Datasets name the range of their sparse points, and up to a fifth of the surfaces seen lies nearer (measured). The
  // factor 2 that landmarks get brings no more here and costs 0.5 points at 2 cm, since the prior's bandwidth goes with
  // the range.
  constexpr float kMargin = 1.5f;
  if (!image.depth_range) return std::nullopt;
  return DepthRange{image.depth_range->min / kMargin, image.depth_range->max * kMargin};
}

namespace {

/// The range to search: that of the options, else the dataset's, else the landmarks'; none where there are too few of
/// these.
std::optional<DepthRange> FindDepthRange(const Scene& scene, int index, const ReconstructOptions& options) {
  const SceneImage& image = scene.images[index];
  const bool given = options.depth_min > 0 && options.depth_max > 0;
  std::optional<DepthRange> range = DatasetRange(image);
  if (!range && !given) {
    range = LandmarkRange(scene, image);
    if (!range && image.face) {  // then those of the other faces, which look into the same surroundings
      DepthRange all;
      const auto [first, last] = ImagesOfFile(scene, index);
      for (int i = first; i < last; ++i) Extend(LandmarkRange(scene, scene.images[static_cast<size_t>(i)]), &all);
      if (all.max > 0) range = all;
    }
  }
  if (!range && !given) return std::nullopt;
  DepthRange result = range.value_or(DepthRange());
  if (options.depth_min > 0) result.min = static_cast<float>(options.depth_min);
  if (options.depth_max > 0) result.max = static_cast<float>(options.depth_max);
  CheckDepthRange(Concat("image ", image.name, ": depth range").c_str(), result);
  return result;
}

}  // namespace

const ImagePlan* ReconstructPlan::Find(int index) const {
  const auto found = std::lower_bound(images.begin(), images.end(), index,
                                      [](const ImagePlan& image, int wanted) { return image.index < wanted; });
  return found != images.end() && found->index == index ? &*found : nullptr;
}

std::vector<int> ReconstructPlan::Indices() const {
  std::vector<int> indices;
  for (const ImagePlan& image : images) indices.push_back(image.index);
  return indices;
}

std::set<int> ReconstructPlan::WithMap() const {
  std::set<int> indices;
  for (const ImagePlan& image : images) {
    if (image.no_map.empty()) indices.insert(image.index);
  }
  return indices;
}

std::vector<int> ReconstructPlan::ImagesRead(const ImagePlan& image) const {
  std::vector<int> indices = {image.index};
  for (int source : image.sources) {
    if (HasMap(source)) indices.push_back(source);
  }
  return indices;
}

void CheckSomeImageGetsAMap(const ReconstructPlan& plan, const Scene& scene) {
  for (const ImagePlan& image : plan.images) {
    if (image.no_map.empty()) return;
  }
  const ImagePlan& first = plan.images.front();
  throw InvalidInputError(Concat("none of the ", plan.images.size(), " images gets a map; for example ",
                                 scene.images[first.index].name, ": ", first.no_map));
}

ReconstructPlan MakePlan(const Scene& scene, const std::vector<int>& indices, const ReconstructOptions& options,
                         const std::vector<std::optional<DepthRange>>& given) {
  ReconstructPlan plan;
  plan.origin = OriginOf(scene, indices);
  plan.images.resize(indices.size());
  for (size_t i = 0; i < indices.size(); ++i) plan.images[i].index = indices[i];
  if (options.online()) return plan;
  std::vector<std::optional<DepthRange>> ranges = given;
  ranges.resize(indices.size());
  DepthRange any;  // for what is done with an image that gets no map
  for (size_t i = 0; i < indices.size(); ++i) {
    if (!ranges[i]) ranges[i] = FindDepthRange(scene, indices[i], options);
    Extend(ranges[i], &any);
  }
  const std::set<int> taking_part(indices.begin(), indices.end());
  for (size_t i = 0; i < indices.size(); ++i) {
    ImagePlan& image = plan.images[i];
    image.range = ranges[i].value_or(any);
    if (!ranges[i]) image.no_map = NoRange(scene.images[image.index]);
    image.sources = SourcesOfDataset(scene, image, taking_part, options.source_views, &plan.warnings);
  }
  ChooseSourceViews(scene, options.source_views, &plan.images);
  const auto needed = static_cast<size_t>(MinSourceViews(options));
  for (ImagePlan& image : plan.images) {
    if (image.sources.size() >= needed || !image.no_map.empty()) continue;
    image.no_map = Concat(image.sources.size(), " useful source views for depths of ", image.range.min, " to ",
                          image.range.max, " (unit of the poses): must be at least ", needed);
    const size_t left_out = CountLeftOut(scene.images[image.index], taking_part);
    if (left_out > 0) image.no_map += Concat("; ", left_out, " of the scene's for it are not among --images");
  }
  CheckSomeImageGetsAMap(plan, scene);
  CheckRange("number of images to fuse", static_cast<int>(plan.WithMap().size()), 1, kMaxFusionViews);
  return plan;
}

DepthRange UnionOfDatasetRanges(const Scene& scene, const std::vector<int>& indices) {
  DepthRange all;
  for (int index : indices) Extend(DatasetRange(scene.images[static_cast<size_t>(index)]), &all);
  return all;
}

PinholeCamera MatchedCamera(const SceneImage& image, const ReconstructOptions& options) {
  int width = image.camera.width, height = image.camera.height;
  LimitSize(options.max_image_size, &width, &height);
  return image.camera.Resized(width, height);
}

void CheckSizes(const Scene& scene, const std::vector<int>& indices, const ReconstructOptions& options) {
  const int levels = MakePipelineOptions(options).start_level, least = 1 << levels;
  for (int index : indices) {
    const SceneImage& image = scene.images[index];
    const PinholeCamera matched = MatchedCamera(image, options);
    if (matched.width >= least && matched.height >= least) continue;
    throw InvalidInputError(Concat("image ", image.path.string(), ": is matched at ", matched.width, " x ",
                                   matched.height, " px (stored: ", image.camera.width, " x ", image.camera.height,
                                   "): must be at least ", least, " x ", least, " for start_level = ", levels));
  }
}

}  // namespace acmp
