#include <cmath>
#include <iostream>
#include <map>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "acmp_mapping/engine/host_depth_engine.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "support/lens.h"

namespace acmp {
namespace {

/// What a mapper has made of wide images.
struct WideMap {
  PointCloud points;
  double sphere = 0;  ///< share of it with confident depth, mean of the images
  int masked_points = 0;
};

WideMap MapWide(const std::vector<SyntheticView>& views, const std::vector<PinholeFace>& faces) {
  std::map<int64_t, KeyframeDepthPtr> maps;
  DenseMapper::Callbacks callbacks;
  callbacks.on_refined =
      callbacks.on_refined_again = [&](const KeyframeDepthPtr& made) { maps[made->frame->id] = made; };
  HostDepthEngine engine;
  DenseMapperOptions options;
  options.pipeline = MakePreset("online");
  DenseMapper mapper(&engine, options, callbacks);
  int64_t id = 0;
  for (const SyntheticView& view : views) {
    const SyntheticWideImage& wide = *view.wide;
    Capture capture;
    for (const PinholeFace& face : faces) {
      const Rectifier rectifier(wide.lens, face);
      const RigidTransform cam_from_world = RigidTransform(face.lens_from_face.transpose()) * view.frame.cam_from_world;
      capture.keyframes.push_back(std::make_shared<Frame>(
          MakeFrame(id++, view.frame.stamp_s, rectifier.Rectify(wide.color.Clone()), face.camera, cam_from_world,
                    wide.landmarks_in_world, {}, rectifier.RectifyMask({}))));
    }
    mapper.AddCapture(capture);
  }
  mapper.Flush();
  WideMap result;
  for (const auto& [number, made] : maps) {
    const Frame& frame = *made->frame;
    for (SurfacePoint point : made->points_in_camera) {
      const Eigen::Vector2d pixel = frame.camera.Project({point.position.x, point.position.y, point.position.z});
      const int col = static_cast<int>(std::lround(pixel.x())), row = static_cast<int>(std::lround(pixel.y()));
      if (!frame.mask.empty() && frame.mask(col, row) == 0) ++result.masked_points;
      const Eigen::Vector3f in_world =
          (made->cam_from_world.inverse() * Eigen::Vector3d(point.position.x, point.position.y, point.position.z))
              .cast<float>();
      point.position = {in_world.x(), in_world.y(), in_world.z()};
      result.points.push_back(point);
    }
    for (int row = 0; row < frame.camera.height; ++row) {
      for (int col = 0; col < frame.camera.width; ++col) {
        if (made->confidence(col, row) < 0.5f) continue;
        result.sphere += test::SolidAngle(frame.camera, col, row) / (4 * M_PI * static_cast<double>(views.size()));
      }
    }
  }
  return result;
}

TEST(WideCamera, FacesMapWhatOnePinholeLoses) {
  SyntheticSceneOptions options;
  options.width = options.height = 160;
  options.keyframes = 6;
  options.field_of_view = 190;
  const std::vector<SyntheticView> views = MakeSyntheticScene(options);
  const Lens& lens = views.front().wide->lens;
  const std::vector<PinholeFace> faces = FacesOf(lens);
  ASSERT_EQ(faces.size(), 5u);
  const WideMap wide = MapWide(views, faces);
  const WideMap pinhole = MapWide(views, {{"", lens.camera()}});
  const PointCloud truth = SampleSyntheticSurface(views, 0.02f);
  constexpr double kThreshold_m = 0.05;
  const CloudMetrics of_wide = EvaluateCloud(wide.points, truth, {kThreshold_m}, 0.02).front();
  const CloudMetrics of_pinhole = EvaluateCloud(pinhole.points, truth, {kThreshold_m}, 0.02).front();
  for (const auto& [name, map, metrics] :
       {std::make_tuple("faces", &wide, of_wide), {"pinhole", &pinhole, of_pinhole}}) {
    std::cout << name << ": sphere " << 100 * map->sphere << " %, accuracy " << metrics.accuracy << ", completeness "
              << metrics.completeness << ", F1 " << metrics.f1 << "\n";
  }
  // The lens shows 54 % of the sphere, the pinhole of its focal length 26 %.
  EXPECT_GT(wide.sphere, 1.3 * pinhole.sphere);
  EXPECT_GT(of_wide.completeness, 1.2 * of_pinhole.completeness);
  EXPECT_GT(of_wide.accuracy, of_pinhole.accuracy - 5);
  EXPECT_EQ(wide.masked_points, 0);
}

}  // namespace
}  // namespace acmp
