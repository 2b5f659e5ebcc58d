#pragma once

#include <memory>
#include <vector>

#include "acmp_mapping/engine/depth_engine.h"
#include "support/planar_scene.h"

namespace acmp {

/// Rendered views as an engine sees them, without estimates; frames are numbered from 0.
inline std::vector<EngineView> LoadViews(const std::vector<PlanarView>& views, DepthEngine* engine, int levels = 0) {
  std::vector<EngineView> loaded;
  for (const PlanarView& view : views) {
    auto frame = std::make_shared<Frame>();
    frame->id = static_cast<int64_t>(loaded.size());
    frame->camera = view.camera;
    frame->cam_from_world = view.cam_from_world;
    frame->gray = view.gray.Clone();
    loaded.push_back({frame, engine->Load(frame, levels), nullptr});
  }
  return loaded;
}

/// The view's own depths as an estimate, for others' geometric passes.
inline EngineEstimatePtr UploadDepth(const PlanarView& view, DepthEngine* engine) {
  const int width = view.camera.width, height = view.camera.height;
  const NormalMap normal(width, height, Vec3f{0, 0, -1});
  const CostMap cost(width, height);
  return engine->UploadMaps({view.depth.View(), normal.View(), cost.View()}, view.camera);
}

/// The first view against all others, with or without their depths.
inline EngineProblem MakeEngineProblem(const std::vector<PlanarView>& views, const DepthRange& range, bool with_depths,
                                       DepthEngine* engine) {
  EngineProblem problem;
  problem.sources = LoadViews(views, engine);
  for (size_t i = 1; i < views.size() && with_depths; ++i) {
    problem.sources[i].estimate = UploadDepth(views[i], engine);
  }
  problem.reference = problem.sources.front();
  problem.sources.erase(problem.sources.begin());
  problem.depth_range = range;
  return problem;
}

inline PlaneHypothesis ToHypothesis(const WorldPlane& plane) {
  const Eigen::Vector3f normal = plane.normal.cast<float>();
  return {normal.x(), normal.y(), normal.z(), static_cast<float>(plane.d)};
}

/// A prior of one plane everywhere, in the camera's frame.
inline PriorMesh PriorOfPlane(const PinholeCamera& camera, const PlaneHypothesis& plane) {
  PriorMesh mesh;
  mesh.triangles = {{{-1, 2 * camera.width + 1, -1}, {-1, -1, 2 * camera.height + 1}}};
  mesh.planes = {plane};
  return mesh;
}

}  // namespace acmp
