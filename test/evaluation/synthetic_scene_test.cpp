#include "acmp_mapping/synthetic/synthetic_scene.h"
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <tuple>

#include <gtest/gtest.h>
#include <Eigen/LU>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

SyntheticSceneOptions NamedScene(const std::string& name, int width, int height, int keyframes) {
  SyntheticSceneOptions options = {width, height, keyframes};
  SelectSyntheticScene(name, &options);
  return options;
}

using Eigen::Vector2d;
using Eigen::Vector3d;

const std::vector<SyntheticView>& DefaultScene() {
  static const std::vector<SyntheticView> kScene = MakeSyntheticScene({});
  return kScene;
}

Vector3d ToEigen(const Vec3f& v) { return {v.x, v.y, v.z}; }

Vector3d PointInWorld(const SyntheticView& view, int col, int row) {
  return view.frame.cam_from_world.inverse() *
         view.frame.camera.Unproject(Vector2d(col, row), view.true_depth(col, row));
}

// True when the 3x3 pixels around lie on one plane with the centre's normal: no outline and no curved surface.
bool OnOnePlane(const SyntheticView& view, int col, int row) {
  if (col < 1 || row < 1 || col >= view.true_depth.width() - 1 || row >= view.true_depth.height() - 1) return false;
  const Vector3d normal = ToEigen(view.true_normal(col, row));
  const Vector3d center = view.frame.camera.Unproject(Vector2d(col, row), view.true_depth(col, row));
  for (int v = row - 1; v <= row + 1; ++v) {
    for (int u = col - 1; u <= col + 1; ++u) {
      const Vector3d point = view.frame.camera.Unproject(Vector2d(u, v), view.true_depth(u, v));
      if (std::abs(normal.dot(point - center)) > 1e-4) return false;  // 0.1 mm: float rounding of the depth is 0.5 um
    }
  }
  return true;
}

// Depth of the plane at a pixel near (col, row), at a position between pixels.
double PlaneDepthAt(const SyntheticView& view, int col, int row, const Vector2d& pixel) {
  const Vector3d normal = ToEigen(view.true_normal(col, row));
  const Vector3d point = view.frame.camera.Unproject(Vector2d(col, row), view.true_depth(col, row));
  return normal.dot(point) / normal.dot(view.frame.camera.Unproject(pixel));
}

TEST(SyntheticScene, SurfacesAgreeBetweenViews) {
  const SyntheticView& from = DefaultScene()[4];
  int same = 0, in_view = 0;
  for (const size_t other : {3, 5, 7}) {
    const SyntheticView& to = DefaultScene()[other];
    for (int row = 0; row < from.true_depth.height(); ++row) {
      for (int col = 0; col < from.true_depth.width(); ++col) {
        const Vector3d point = to.frame.cam_from_world * PointInWorld(from, col, row);
        const Vector2d pixel = to.frame.camera.Project(point);
        const int u = static_cast<int>(std::lround(pixel.x())), v = static_cast<int>(std::lround(pixel.y()));
        if (point.z() <= 0 || !OnOnePlane(to, u, v)) continue;
        ++in_view;
        const double surface = PlaneDepthAt(to, u, v, pixel);
        // Float depths put the point within a micrometre of its surface. Something may stand before it, but a view that
        // looks through it would mean that depth or pose is wrong.
        ASSERT_GT(point.z(), surface - 1e-5) << "view " << other << " pixel " << pixel.transpose();
        same += point.z() < surface + 1e-5;
      }
    }
  }
  EXPECT_GT(same, 0.8 * in_view);  // the rest is occluded
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

TEST(SelectSyntheticScene, SetsPlaceAndCameraOnly) {
  SyntheticSceneOptions options;
  options.width = 77;
  options.seed = 5;
  SelectSyntheticScene("hard", &options);
  EXPECT_EQ(options.place, SyntheticPlace::kOffice);
  EXPECT_GT(options.imaging.grey_per_electron, 0);
  EXPECT_EQ(options.width, 77);
  EXPECT_EQ(options.seed, 5u);
  SelectSyntheticScene("room", &options);
  EXPECT_EQ(options.place, SyntheticPlace::kRoom);
  EXPECT_EQ(options.imaging.grey_per_electron, 0);
  EXPECT_THROW(SelectSyntheticScene("kitchen", &options), InvalidInputError);
}

}  // namespace
}  // namespace acmp
