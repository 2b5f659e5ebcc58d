#include <atomic>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/patch_match/match_setup.h"

namespace acmp {
namespace {

MatchView MakeMatchView(const EngineView& view) {
  MatchView result;
  result.gray = view.frame->gray.View();
  result.camera = view.frame->camera;
  result.cam_from_world = view.cam_from_world();
  return result;
}

void CheckView(const char* name, const EngineView& view) {
  if (!view.frame || !view.image) throw InvalidInputError(Concat(name, ": frame and image must not be null"));
}

PosedCamera PosedCameraOf(const std::string& name, const EngineView& view) {
  if (!view.frame) throw InvalidInputError(name + ": frame must not be null");
  CheckCamera(name, view.frame->camera);
  CheckPose(name.c_str(), view.cam_from_world());
  return {view.frame->camera, view.cam_from_world()};
}

FusionMaps CheckedMaps(const std::string& name, const FusionMaps& maps, const PinholeCamera& camera) {
  CheckSize(name + ": estimate", maps.depth.width, maps.depth.height, camera);
  if (!maps.color.empty()) CheckSize(name + ": colours", maps.color.width, maps.color.height, camera);
  return maps;
}

}  // namespace

bool IsUnique(const EngineEstimatePtr& estimate) {
  if (estimate.use_count() != 1) return false;
  // The count alone orders nothing: what others read before they let go comes before what the caller does now.
  std::atomic_thread_fence(std::memory_order_acquire);
  return true;
}

PinholeCamera CameraAtLevel(PinholeCamera camera, int level) {
  for (int i = 0; i < level; ++i) camera = camera.Halved();
  return camera;
}

int LevelOf(const EngineProblem& problem, int width, int height) {
  CheckView("reference", problem.reference);
  const PinholeCamera& camera = problem.reference.frame->camera;
  for (int level = 0; level <= kMaxLevels; ++level) {
    const PinholeCamera of_level = CameraAtLevel(camera, level);
    if (of_level.width == width && of_level.height == height) return level;
  }
  throw InvalidInputError(Concat("estimate: ", width, " x ", height, " px, but the camera has ", camera.width, " x ",
                                 camera.height, ", or these halved up to ", kMaxLevels, " times"));
}

void CheckLoad(const FramePtr& frame, int levels) {
  if (!frame) throw InvalidInputError("frame: must not be null");
  CheckRange("levels", levels, 0, kMaxLevels);
  CheckCamera("camera of the smallest level", CameraAtLevel(frame->camera, levels));
  if (!frame->mask.empty()) CheckSize("mask", frame->mask.width(), frame->mask.height(), frame->camera);
}

std::vector<MaskDistanceMap> MakeMaskDistances(const Frame& frame, int levels) {
  std::vector<MaskDistanceMap> mask_distances;
  mask_distances.push_back(MakeMaskDistance(frame.mask));
  Mask halved;
  for (int level = 1; level <= levels; ++level) {
    halved = HalveMask(level == 1 ? frame.mask : halved);
    mask_distances.push_back(MakeMaskDistance(halved));
  }
  return mask_distances;
}

void CheckUpsample(const FramePtr& frame, int level, int width, int height) {
  if (!frame) throw InvalidInputError("frame: must not be null");
  CheckRange("level", level, 0, kMaxLevels);
  CheckSize("halved estimate", width, height, CameraAtLevel(frame->camera, level));
}

PatchMatchProblem MakePatchMatchProblem(const EngineProblem& problem, int level) {
  CheckRange("level", level, 0, kMaxLevels);
  CheckView("reference", problem.reference);
  for (const EngineView& source : problem.sources) CheckView("source view", source);
  PatchMatchProblem result;
  result.reference = MakeMatchView(problem.reference);
  result.sources.reserve(problem.sources.size());
  for (const EngineView& source : problem.sources) result.sources.push_back(MakeMatchView(source));
  result.depth_range = problem.depth_range;
  Check(result);
  result.reference.camera = CameraAtLevel(result.reference.camera, level);
  for (MatchView& source : result.sources) source.camera = CameraAtLevel(source.camera, level);
  return result;
}

FusionSetup SetUpFusion(const EngineView& reference, const std::vector<EngineView>& sources, const FusionLimits& limits,
                        const std::function<FusionMaps(const EngineView&)>& maps_of,
                        const std::function<ImageView<Stamp>(const Frame&)>& stamps_of, Stamp current) {
  CheckRange("number of source views", static_cast<int>(sources.size()), 0, kMaxFusionSources);
  const PosedCamera camera = PosedCameraOf("reference view", reference);
  FusionSetup setup(camera, CheckedMaps("reference view", maps_of(reference), camera.camera), limits,
                    stamps_of ? camera.cam_from_world.inverse() : RigidTransform::Identity());
  if (stamps_of) setup.SetStamps(stamps_of(*reference.frame), current);
  for (size_t i = 0; i < sources.size(); ++i) {
    if (!sources[i].estimate) continue;
    const std::string name = Concat("source view ", i);
    const PosedCamera source = PosedCameraOf(name, sources[i]);
    setup.AddSource(source, CheckedMaps(name, maps_of(sources[i]), source.camera),
                    stamps_of ? stamps_of(*sources[i].frame) : ImageView<Stamp>());
  }
  return setup;
}

void CheckUpload(const EstimateState& state, const PinholeCamera& camera) {
  CheckSize("plane map", state.planes.width(), state.planes.height(), camera);
  CheckSize("cost map", state.cost.width(), state.cost.height(), camera);
}

PlaneMap MakePlanes(const EstimateMapViews& maps, const PinholeCamera& camera) {
  CheckSize("depth map", maps.depth.width, maps.depth.height, camera);
  CheckSize("normal map", maps.normal.width, maps.normal.height, camera);
  CheckSize("cost map", maps.cost.width, maps.cost.height, camera);
  PlaneMap planes(camera.width, camera.height);
  const RayGrid rays = MakeRayGrid(camera);
  ForEachPixel(camera.width, camera.height, [&](int col, int row) {
    const Vec3f ray = rays.Ray(static_cast<float>(col), static_cast<float>(row));
    const float depth = maps.depth(col, row);
    if (depth > 0) planes(col, row) = PlaneThrough(maps.normal(col, row), ray, depth);
  });
  return planes;
}

}  // namespace acmp
