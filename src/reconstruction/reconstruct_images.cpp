#include "acmp_mapping/reconstruction/reconstruct.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <memory>
#include <numeric>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"
#include "run.h"
#include "run_tasks.h"

namespace acmp {
namespace {

void CheckSources(const std::string& name, int index, const std::vector<int>& sources, int images) {
  std::set<int> seen;
  for (int source : sources) {
    CheckRange((name + ": source view").c_str(), source, 0, images - 1);
    if (source == index) throw InvalidInputError(Concat(name, ": is among its own source views"));
    if (!seen.insert(source).second) {
      throw InvalidInputError(Concat(name, ": source view ", source, " is given more than once"));
    }
  }
}

/// Throws InvalidInputError for an image that does not fit its camera, pose, mask or source views; leaves all but the
/// pixels.
std::vector<FramePtr> MakeFrames(std::vector<InputImage>* images, int max_size, const StopRequest& interrupt) {
  std::vector<FramePtr> frames(images->size());
  tbb::parallel_for(size_t{0}, images->size(), [&](size_t i) {
    InputImage& image = (*images)[i];
    const std::string name = "image " + image.name;
    try {
      frames[i] = std::make_shared<const Frame>(MakeFrame(static_cast<int64_t>(i), 0.0, std::move(image.color),
                                                          image.camera, image.cam_from_world, image.landmarks_in_world,
                                                          max_size, image.mask, image.prior_depth));
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat(name, ": ", error.what()));
    }
    CheckSources(name, static_cast<int>(i), image.ranked_sources, static_cast<int>(images->size()));
    if (image.depth_range) CheckDepthRange((name + ": depth range").c_str(), *image.depth_range);
  });
  interrupt.Check();
  return frames;
}

/// The images as a scene that has no files.
Scene MakeScene(const std::vector<InputImage>& images) {
  Scene scene;
  for (const InputImage& image : images) {
    SceneImage& planned = scene.images.emplace_back();
    planned.name = image.name;
    planned.path = image.name;
    planned.camera = image.camera;
    planned.cam_from_world = image.cam_from_world;
    planned.ranked_sources = image.ranked_sources;
    const auto landmarks = WithoutMasked(image.landmarks_in_world, image.camera, image.cam_from_world, image.mask);
    planned.landmark_indices.resize(landmarks.size());
    std::iota(planned.landmark_indices.begin(), planned.landmark_indices.end(),
              static_cast<int>(scene.landmarks_in_world.size()));
    scene.landmarks_in_world.insert(scene.landmarks_in_world.end(), landmarks.begin(), landmarks.end());
  }
  return scene;
}

/// Computes maps and points of all images.
ImageReconstruction DoTasks(ReconstructRun* run) {
  ImageReconstruction result;
  for (const ImagePlan& image : run->plan.images) {
    result.images.push_back({CameraOf(*run, image.index), {}, image.sources, image.no_map});
  }
  std::vector<PointCloud> clouds(run->plan.images.size());
  const std::set<int> with_map = run->plan.WithMap();
  RunTasks tasks(run, run->store.final_step(), with_map);
  for (int index : with_map) {
    const ImagePlan& image = *run->plan.Find(index);
    FinalMaps& maps = result.images[static_cast<size_t>(index)].maps;
    tasks.AddMaps(image, true, [&maps](FinalMaps made) { maps = std::move(made); });
    PointCloud& cloud = clouds[static_cast<size_t>(index)];
    tasks.AddFusion(image, {}, [&cloud](PointCloud points) { cloud = std::move(points); });
  }
  tasks.Run();
  run->interrupt.Check();
  for (PointCloud& cloud : clouds) {
    const PointCloud points = std::move(cloud);
    result.cloud.insert(result.cloud.end(), points.begin(), points.end());
  }
  result.origin = run->plan.origin;
  result.warnings = run->plan.warnings;
  const PointsJudgement judgement = JudgePoints(*run, result.cloud.size());
  for (const std::string& warning : {judgement.warning, judgement.failure, DescribeUnusedPriorDepth(*run)}) {
    if (!warning.empty()) result.warnings.push_back(warning);
  }
  result.device = run->devices.name();
  return result;
}

}  // namespace

ImageReconstruction ReconstructImages(std::vector<InputImage> images, const ReconstructOptions& options,
                                      const DeviceMaker& make_devices, StopRequest* interrupt) {
  Validate(options);
  if (std::any_of(images.begin(), images.end(), [](const InputImage& image) { return !image.prior_depth.empty(); })) {
    CheckPriorDepthIsUsed(options);
  }
  if (images.empty()) throw InvalidInputError("number of images = 0: must be at least 1");
  FrameStore frames(MakeFrames(&images, options.max_image_size, *interrupt));
  Scene scene = MakeScene(images);
  const std::vector<int> indices = ParseImageIndices("", static_cast<int>(images.size()));
  std::vector<std::optional<DepthRange>> ranges;
  for (const InputImage& image : images) ranges.push_back(image.depth_range);
  ReconstructPlan plan = MakePlan(scene, indices, options, ranges);
  interrupt->Check();
  CheckSizes(scene, indices, options);
  scene.landmarks_in_world.clear();
  const std::string doubt = DescribePoseDoubt(scene, plan, &frames);
  if (!doubt.empty()) plan.warnings.push_back(doubt);
  const Devices devices(make_devices());
  std::ostream nowhere(nullptr);
  Progress progress(&nowhere, &nowhere, true, false);
  ReconstructRun run{scene, options, plan, devices, frames, *interrupt, progress, nullptr};
  return DoTasks(&run);
}

std::vector<InputImage> ReadInputImages(const ReconstructOptions& options, const StopRequest& interrupt,
                                        std::vector<std::string>* warnings) {
  const Scene scene = ReadSceneInput(options);
  *warnings = scene.warnings;
  std::vector<InputImage> images(scene.images.size());
  tbb::parallel_for(size_t{0}, images.size(), [&](size_t i) {
    Frame frame = LoadFrame(scene, static_cast<int>(i));
    const SceneImage& image = scene.images[i];
    images[i] = {image.name,
                 std::move(frame.color),
                 frame.camera,
                 frame.cam_from_world,
                 std::move(frame.mask),
                 std::move(frame.prior_depth),
                 std::move(frame.landmarks_in_world),
                 DatasetRange(image),
                 image.ranked_sources};
  });
  interrupt.Check();
  return images;
}

}  // namespace acmp
