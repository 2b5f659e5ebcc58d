#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/engine/depth_engine.h"
#include "fusion/analytic_views.h"

namespace acmp {

/// Views as an engine sees them; frames are numbered from 0. One without pixels has no estimate.
inline std::vector<EngineView> UploadViews(const std::vector<FusionView>& views, DepthEngine* engine) {
  std::vector<EngineView> uploaded;
  for (const FusionView& view : views) {
    auto frame = std::make_shared<Frame>();
    frame->id = static_cast<int64_t>(uploaded.size());
    uploaded.push_back({frame, nullptr, nullptr});
    if (view.depth.empty()) continue;
    frame->camera = view.camera;
    frame->cam_from_world = view.cam_from_world;
    frame->gray = GrayImage(view.camera.width, view.camera.height, 100.0f);
    frame->color = Clone(view.color);
    uploaded.back().image = engine->Load(frame, 0);
    uploaded.back().estimate = engine->UploadMaps({view.depth, view.normal, view.cost}, view.camera);
  }
  return uploaded;
}

inline std::vector<EngineView> UploadViews(const std::vector<TestView>& views, DepthEngine* engine) {
  return UploadViews(ViewsOf(views), engine);
}

/// The points of one view.
inline PointCloud FuseOne(DepthEngine* engine, const std::vector<EngineView>& views,
                          const std::vector<std::vector<int>>& neighbors, int view, FusionStamps* stamps,
                          const FusionOptions& options = {}) {
  std::vector<EngineView> sources;
  for (int source : neighbors[static_cast<size_t>(view)]) sources.push_back(views[static_cast<size_t>(source)]);
  return engine->FuseView(views[static_cast<size_t>(view)], sources, options, view, stamps);
}

/// Those of all views, fused one after the other.
inline std::vector<PointCloud> FuseAll(DepthEngine* engine, const std::vector<EngineView>& views,
                                       const std::vector<std::vector<int>>& neighbors,
                                       const FusionOptions& options = {}) {
  const std::unique_ptr<FusionStamps> stamps = engine->MakeFusionStamps();
  std::vector<PointCloud> clouds;
  for (int i = 0; i < static_cast<int>(views.size()); ++i) {
    const bool takes_part = views[static_cast<size_t>(i)].estimate != nullptr;
    clouds.push_back(takes_part ? FuseOne(engine, views, neighbors, i, stamps.get(), options) : PointCloud());
  }
  return clouds;
}

/// The same as one cloud.
inline PointCloud FuseViews(DepthEngine* engine, const std::vector<FusionView>& views,
                            const std::vector<std::vector<int>>& neighbors, const FusionOptions& options) {
  PointCloud points;
  for (const PointCloud& cloud : FuseAll(engine, UploadViews(views, engine), neighbors, options)) {
    points.insert(points.end(), cloud.begin(), cloud.end());
  }
  return points;
}
/// The first view against all others.
inline ConsistencyResult Filter(DepthEngine* engine, const std::vector<FusionView>& views,
                                const FusionOptions& options) {
  std::vector<EngineView> sources = UploadViews(views, engine);
  const EngineView reference = sources.front();
  sources.erase(sources.begin());
  return engine->FilterByConsistency(reference, sources, options);
}

/// Whether the fusions of two views read or mark one frame's pixels.
inline bool HaveCommonFrame(const std::vector<std::vector<int>>& neighbors, int a, int b) {
  std::vector<int> frames = neighbors[static_cast<size_t>(a)];
  frames.push_back(a);
  const std::vector<int>& others = neighbors[static_cast<size_t>(b)];
  return std::any_of(frames.begin(), frames.end(),
                     [&](int f) { return f == b || std::count(others.begin(), others.end(), f) > 0; });
}

/// Where the first point is that differs in a bit, for EXPECT_EQ with "".
inline std::string FirstDifference(const PointCloud& a, const PointCloud& b) {
  if (a.size() != b.size()) return Concat(a.size(), " points, ", b.size(), " points");
  for (size_t i = 0; i < a.size(); ++i) {
    const SurfacePoint &p = a[i], &q = b[i];
    const bool same = p.position.x == q.position.x && p.position.y == q.position.y && p.position.z == q.position.z &&
                      p.normal.x == q.normal.x && p.normal.y == q.normal.y && p.normal.z == q.normal.z &&
                      p.color.r == q.color.r && p.color.g == q.color.g && p.color.b == q.color.b &&
                      p.confidence == q.confidence;
    if (!same) return Concat("point ", i);
  }
  return "";
}

inline std::string FirstDifference(const std::vector<PointCloud>& a, const std::vector<PointCloud>& b) {
  if (a.size() != b.size()) return Concat(a.size(), " clouds, ", b.size(), " clouds");
  for (size_t i = 0; i < a.size(); ++i) {
    const std::string difference = FirstDifference(a[i], b[i]);
    if (!difference.empty()) return Concat("view ", i, ": ", difference);
  }
  return "";
}

}  // namespace acmp
