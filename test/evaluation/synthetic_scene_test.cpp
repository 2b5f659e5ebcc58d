#include "acmp_mapping/synthetic/synthetic_scene.h"
#include <cstdint>
#include <map>
#include <string>
#include <tuple>

#include <gtest/gtest.h>
#include <Eigen/LU>

namespace acmp {
namespace {

SyntheticSceneOptions NamedScene(const std::string& name, int width, int height, int keyframes) {
  SyntheticSceneOptions options = {width, height, keyframes};
  SelectSyntheticScene(name, &options);
  return options;
}

using Eigen::Vector2d;
using Eigen::Vector3d;

Vector3d ToEigen(const Vec3f& v) { return {v.x, v.y, v.z}; }

Vector3d PointInWorld(const SyntheticView& view, int col, int row) {
  return view.frame.cam_from_world.inverse() *
         view.frame.camera.Unproject(Vector2d(col, row), view.true_depth(col, row));
}

// The hash of Fowler, Noll and Vo, 64 bits.
class Fnv1a {
 public:
  template <class T>
  void Add(const T* values, size_t count) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(values);
    for (size_t i = 0; i < count * sizeof(T); ++i) hash_ = (hash_ ^ bytes[i]) * 0x100000001b3u;
  }
  uint64_t hash() const { return hash_; }

 private:
  uint64_t hash_ = 0xcbf29ce484222325u;
};

// Of all that the renderer makes. Grey values are left out: OpenCV computes them, with whatever instructions the
// machine has.
uint64_t ChecksumOf(const std::vector<SyntheticView>& views) {
  Fnv1a hash;
  for (const SyntheticView& view : views) {
    hash.Add(view.frame.color.data(), view.frame.color.size());
    hash.Add(view.true_depth.data(), view.true_depth.size());
    hash.Add(view.true_normal.data(), view.true_normal.size());
    hash.Add(view.low_texture.data(), view.low_texture.size());
    hash.Add(view.frame.cam_from_world.data(), 16);
    for (const Eigen::Vector3d& landmark : view.frame.landmarks_in_world) hash.Add(landmark.data(), 3);
  }
  return hash.hash();
}

TEST(SyntheticScene, BytesAreTheSameOnEveryMachine) {
  // The same from g++ and clang++, at -O0 and with AVX2.
  const std::map<std::string, uint64_t> checksums = {
      {"room", 10921943880493684088u}, {"hard", 12023321076656201375u}, {"street", 15936677371152641160u}};
  for (const auto& [name, checksum] : checksums) {
    SyntheticSceneOptions options = NamedScene(name, 97, 64, 4);
    EXPECT_EQ(ChecksumOf(MakeSyntheticScene(options)), checksum) << name;
    options.seed = 2;
    EXPECT_NE(ChecksumOf(MakeSyntheticScene(options)), checksum) << name;
  }
}

TEST(SyntheticSurface, CoversWhatTheViewsSeeWithPointsOnTheSurfaces) {
  const std::vector<SyntheticView> views = MakeSyntheticScene(NamedScene("room", 97, 64, 4));
  constexpr float kSpacing_m = 0.05f;
  const PointCloud cloud = SampleSyntheticSurface(views, kSpacing_m);
  // One point per cell, so that every true point has one at most a cell's diagonal away.
  std::map<std::tuple<int, int, int>, std::vector<Vector3d>> cells;
  const auto cell = [&](const Vector3d& p) {
    const Vector3d c = (p / kSpacing_m).array().floor();
    return std::make_tuple(static_cast<int>(c.x()), static_cast<int>(c.y()), static_cast<int>(c.z()));
  };
  for (const SurfacePoint& point : cloud) {
    cells[cell(ToEigen(point.position))].push_back(ToEigen(point.position));
    ASSERT_NEAR(ToEigen(point.normal).norm(), 1.0, 1e-6);
  }
  for (const SyntheticView& view : views) {
    for (int row = 0; row < view.true_depth.height(); ++row) {
      for (int col = 0; col < view.true_depth.width(); ++col) {
        const Vector3d point = PointInWorld(view, col, row);
        double nearest = std::numeric_limits<double>::infinity();
        const auto [x, y, z] = cell(point);
        for (int i = 0; i < 27; ++i) {
          const auto found = cells.find({x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1});
          if (found == cells.end()) continue;
          for (const Vector3d& candidate : found->second) nearest = std::min(nearest, (candidate - point).norm());
        }
        ASSERT_LT(nearest, 1.8 * kSpacing_m) << col << " " << row;
      }
    }
  }
}

}  // namespace
}  // namespace acmp
