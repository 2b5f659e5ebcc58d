#include <gtest/gtest.h>
#include "plan.h"

#include <cmath>
#include <random>

#include "acmp_mapping/keyframe/source_view_selection.h"

namespace acmp {
namespace {

constexpr double kDepth = 5;

/// Cameras on an area, or along a street, that look about; some with twice the focal length.
Scene RandomScene(int images, double width, double length, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> share(0, 1);
  Scene scene;
  for (int i = 0; i < images; ++i) {
    SceneImage image;
    const double focal = share(random) < 0.1 ? 160 : 80;
    image.camera = {80, 60, focal, focal, 39.5, 29.5};
    RigidTransform world_from_cam = RigidTransform::Identity();
    world_from_cam.translation() = Eigen::Vector3d(width * share(random), 0.2 * share(random), length * share(random));
    const double turn = 2 * M_PI * (share(random) < 0.7 ? 0.05 * share(random) : share(random));
    world_from_cam.linear() = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitY()).toRotationMatrix();
    image.cam_from_world = world_from_cam.inverse();
    scene.images.push_back(image);
  }
  return scene;
}

std::vector<int> AmongAll(const Scene& scene, int index, int max_sources) {
  const auto camera = [&](size_t i) { return PosedCamera{scene.images[i].camera, scene.images[i].cam_from_world}; };
  std::vector<SourceViewCandidate> candidates;
  std::vector<int> others, sources;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (static_cast<int>(i) == index) continue;
    candidates.push_back({camera(i)});
    others.push_back(static_cast<int>(i));
  }
  SourceViewOptions options;
  options.max_source_views = max_sources;
  for (const auto& view : SelectSourceViews(camera(static_cast<size_t>(index)), kDepth, candidates, options).views) {
    sources.push_back(others[view.index]);
  }
  return sources;
}

TEST(ChooseSourceViewsTest, AsAmongAllPairs) {
  unsigned seed = 1;
  for (const auto& [width, length] : {std::pair(3.0, 1500.0), {400.0, 400.0}, {1.0, 1.0}, {0.0, 0.0}}) {
    for (const int max_sources : {1, 10, 32}) {
      const Scene scene = RandomScene(600, width, length, seed++);
      std::vector<int> indices(scene.images.size());
      for (size_t i = 0; i < indices.size(); ++i) indices[i] = static_cast<int>(i);
      std::vector<double> depths(indices.size());
      for (size_t i = 0; i < indices.size(); i += 17) depths[i] = kDepth;
      const auto chosen = ChooseSourceViews(scene, indices, depths, max_sources);
      for (size_t i = 0; i < indices.size(); ++i) {
        ASSERT_EQ(chosen[i], depths[i] > 0 ? AmongAll(scene, indices[i], max_sources) : std::vector<int>())
            << width << " x " << length << ", " << max_sources << " of image " << i;
      }
    }
  }
}

}  // namespace
}  // namespace acmp
