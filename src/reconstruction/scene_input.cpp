#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdio>
#include <map>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "plan.h"

namespace acmp {
namespace {

std::vector<PosedImage> PosedImages(const ReconstructPlan& plan, const Scene& scene, int max_size) {
  std::map<int, int> positions;
  for (const ImagePlan& image : plan.images) positions.emplace(image.index, static_cast<int>(positions.size()));
  std::vector<PosedImage> images;
  for (const ImagePlan& planned : plan.images) {
    const SceneImage& image = scene.images[static_cast<size_t>(planned.index)];
    PosedImage posed;
    posed.id = planned.index;
    int width = image.camera.width, height = image.camera.height;
    LimitSize(max_size, &width, &height);
    posed.camera = image.camera.Resized(width, height);
    posed.cam_from_world = image.cam_from_world;
    posed.depth_range = planned.range;
    for (int source : planned.sources) posed.sources.push_back(positions.at(source));
    images.push_back(std::move(posed));
  }
  return images;
}

/// A lens with the radial distortion that its calibration has left.
Lens FoundLens(const Lens& lens, const CameraErrors& errors) {
  return {lens.camera(), WithRadialDistortion(lens, errors.k1, errors.k2)};
}

std::string Describe(const PoseRefinement& refinement, const PinholeCamera& camera) {
  const ClassicLocale point;
  char text[256];
  std::snprintf(text, sizeof(text),
                "poses: matches that took no part lie %.2f px (median of %d) from their epipolar lines as received, "
                "%.2f px with refined poses; ",
                refinement.received_fit.median_px, refinement.received_fit.matches, refinement.refined_fit.median_px);
  std::string message = text;
  message += refinement.changed ? Concat("refined poses are used (", refinement.landmarks, " landmarks)")
                                : "poses stay as they are: " + refinement.reason;
  if (refinement.bent) {
    message += "; those received come from an adjustment that took the camera for an ideal one: it has bent the scene";
  }
  if (!refinement.has_camera_errors) return message;
  const CameraErrors& errors = refinement.camera;
  std::snprintf(
      text, sizeof(text),
      "; calibration leaves radial distortion k1 = %.4f, k2 = %.4f (%.1f px at the corner), rows are read out "
      "in %.3f of the time from image to image%s",
      errors.k1, errors.k2, DistortionShift(camera, errors, 1), errors.readout,
      refinement.changed ? ": both are taken out of the images" : "");
  return message + text;
}

}  // namespace

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

std::optional<Lens> RefineScenePoses(const ReconstructPlan& plan, const ReconstructOptions& options,
                                     const StopRequest& interrupt, Scene* scene, Progress* progress) {
  if (options.pose_refinement.refine == RefinePoses::kOff || options.online()) return std::nullopt;
  progress->Note("refining poses");
  const FrameOptions frame_options = {options.max_image_size};
  const auto load = [&](size_t i) {
    Frame frame = LoadFrame(*scene, plan.images[i].index, frame_options);
    return ImagePixels{std::move(frame.gray), std::move(frame.mask)};
  };
  const PoseRefinement refinement = RefineImagePoses(PosedImages(plan, *scene, options.max_image_size), load,
                                                     options.pose_refinement, [&] { interrupt.Check(); });
  const SceneImage first = scene->images[static_cast<size_t>(plan.images.front().index)];
  std::optional<Lens> found;
  if (refinement.has_camera_errors) found = FoundLens(Lens(first.camera, first.distortion), refinement.camera);
  bool is_one = true;
  for (const RefinedPose& pose : refinement.poses) {
    SceneImage& image = scene->images[static_cast<size_t>(pose.id)];
    image.cam_from_world = pose.cam_from_world;
    if (refinement.changed) image.placed_from_world = pose.cam_from_received.inverse() * pose.cam_from_world;
    image.readout = pose.readout;
    const bool is_first = image.camera == first.camera && image.distortion == first.distortion;
    is_one &= is_first;
    if (!found || !refinement.changed) continue;
    image.distortion = is_first ? found->distortion()
                                : FoundLens(Lens(image.camera, image.distortion), refinement.camera).distortion();
  }
  progress->Note(Describe(refinement, first.camera));
  return is_one ? found : std::nullopt;
}

}  // namespace acmp
