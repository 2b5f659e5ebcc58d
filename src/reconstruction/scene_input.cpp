#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "plan.h"

namespace acmp {
namespace {

/// The images of the plan whose poses are refined: of the faces of a wide image, which share its pose, the first.
std::vector<int> PosedImages(const ReconstructPlan& plan, const Scene& scene) {
  std::vector<int> indices;
  for (const ImagePlan& image : plan.images) {
    if (indices.empty() || indices.back() < ImagesOfFile(scene, image.index).first) indices.push_back(image.index);
  }
  return indices;
}

std::vector<PosedImage> WithSources(const std::vector<int>& indices, const ReconstructPlan& plan, const Scene& scene,
                                    const ReconstructOptions& options) {
  std::map<int, int> positions;
  for (int index : indices) positions.emplace(index, static_cast<int>(positions.size()));
  std::vector<PosedImage> images;
  for (int index : indices) {
    const ImagePlan& planned = *plan.Find(index);
    const SceneImage& image = scene.images[static_cast<size_t>(planned.index)];
    PosedImage posed;
    posed.id = planned.index;
    posed.camera = MatchedCamera(image, options);
    posed.cam_from_world = image.cam_from_world;
    posed.depth_range = planned.range;
    for (int source : planned.sources) {
      if (const auto found = positions.find(source); found != positions.end()) posed.sources.push_back(found->second);
    }
    images.push_back(std::move(posed));
  }
  return images;
}

/// Whether the camera's errors can be taken out of an image: faces of wide ones have others than the face ahead, for
/// which they are found.
bool CanBeFreed(const SceneImage& image) { return !image.face && CanHaveRadialDistortion(image.distortion.model); }

/// The image's lens with the radial distortion that its calibration has left.
Lens FoundLens(const SceneImage& image, const CameraErrors& errors) {
  return {image.camera, WithRadialDistortion({image.camera, image.distortion}, errors.k1, errors.k2)};
}

std::string Describe(const PoseRefinement& refinement, const PinholeCamera& camera, bool frees) {
  std::string message = StringPrintf(
      "poses: matches that took no part lie %.2f px (median of %d) from their epipolar lines as received, "
      "%.2f px with refined poses; ",
      refinement.received_fit.median_px, refinement.received_fit.matches, refinement.refined_fit.median_px);
  message += refinement.changed ? Concat("refined poses are used (", refinement.landmarks, " landmarks)")
                                : "poses stay as they are: " + refinement.reason;
  if (refinement.bent) {
    message += "; those received come from an adjustment that took the camera for an ideal one: it has bent the scene";
  }
  if (!refinement.checks.has_camera_errors) return message;
  const CameraErrors& errors = *refinement.checks.camera_errors;
  return message +
         StringPrintf(
             "; calibration leaves radial distortion k1 = %.4f, k2 = %.4f (%.1f px at the corner), rows are read out "
             "in %.3f of the time from image to image%s",
             errors.k1, errors.k2, DistortionShift(camera, errors, 1), errors.readout,
             refinement.changed && frees ? ": both are taken out of the images" : "");
}

/// Gives all faces of a wide image the refined pose of one of them.
void MoveFile(const RefinedPose& pose, Scene* scene) {
  const int index = static_cast<int>(pose.id);
  const auto rotation = [&](int i) {
    const auto& face = scene->images[static_cast<size_t>(i)].face;
    return face ? face->lens_from_face : Eigen::Matrix3d::Identity();
  };
  const auto [first, last] = ImagesOfFile(*scene, index);
  for (int i = first; i < last; ++i) {
    const RigidTransform face_from_given(Eigen::Matrix3d(rotation(i).transpose() * rotation(index)));
    SceneImage& image = scene->images[static_cast<size_t>(i)];
    image.cam_from_world = i == index ? pose.cam_from_world : face_from_given * pose.cam_from_world;
    image.placed_from_world = pose.cam_from_received.inverse() * pose.cam_from_world;
  }
}

}  // namespace

Scene ReadSceneInput(const ReconstructOptions& options) {
  Scene scene = ReadScene(options.scene, ParseSceneFormat(options.format), ParsePixelCenters(options.pixel_centers),
                          options.image_path);
  scene.rectifiers->set_max_bytes(options.MemoryBytes(options.kRectifierShare));
  if (!options.masks.empty()) AddMasks(options.masks, &scene);
  if (!options.prior_depth.empty()) AddPriorDepths(options.prior_depth, &scene);
  for (SceneImage& image : scene.images) {
    if (options.field_of_view == 0 || image.distortion.model == LensDistortion::Model::kNone) continue;
    image.field_of_view = options.field_of_view;
    CheckLens(image.path.string(), image.camera, image.distortion, image.field_of_view);
  }
  if (options.wide_faces == "auto") SplitWideImages(&scene);
  return scene;
}

std::vector<int> TakeMasks(const ReconstructOptions& options, const std::vector<int>& indices, const Scene& scene,
                           Progress* progress) {
  if (options.masks.empty()) return indices;
  const auto image = [&](size_t i) -> const SceneImage& { return scene.images[static_cast<size_t>(indices[i])]; };
  std::vector<char> is_of_use(indices.size(), 1);
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    if (!image(i).mask.empty() && IgnoresAll(LoadMask(scene, image(i)))) is_of_use[i] = 0;
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

void CheckPriorDepths(const ReconstructOptions& options, const std::vector<int>& indices, const Scene& scene,
                      Progress* progress) {
  if (options.prior_depth.empty()) return;
  const auto image = [&](size_t i) -> const SceneImage& { return scene.images[static_cast<size_t>(indices[i])]; };
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
  const std::vector<int> indices = PosedImages(plan, *scene);
  const auto load = [&](size_t i) {
    Frame frame = LoadFrame(*scene, indices[i], options.max_image_size);
    return ImagePixels{std::move(frame.gray), std::move(frame.mask)};
  };
  const auto can_be_freed = [&](int index) { return CanBeFreed(scene->images[static_cast<size_t>(index)]); };
  const bool frees = std::all_of(indices.begin(), indices.end(), can_be_freed);
  const PoseRefinement refinement = RefineImagePoses(WithSources(indices, plan, *scene, options), load,
                                                     options.pose_refinement, frees, [&] { interrupt.Check(); });
  const SceneImage first = scene->images[static_cast<size_t>(plan.images.front().index)];
  std::optional<Lens> found;
  if (refinement.checks.has_camera_errors && frees) found = FoundLens(first, *refinement.checks.camera_errors);
  bool is_one = true;
  for (const RefinedPose& pose : refinement.poses) {
    SceneImage& image = scene->images[static_cast<size_t>(pose.id)];
    const bool is_first = image.camera == first.camera && image.distortion == first.distortion;
    is_one &= is_first;
    if (!refinement.changed) continue;
    MoveFile(pose, scene);
    image.readout = pose.readout;
    if (found) image.distortion = (is_first ? *found : FoundLens(image, *refinement.checks.camera_errors)).distortion();
  }
  progress->Note(Describe(refinement, first.camera, frees));
  return is_one ? found : std::nullopt;
}

}  // namespace acmp
