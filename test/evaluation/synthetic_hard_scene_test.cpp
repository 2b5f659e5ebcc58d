#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/evaluation/synthetic_scene.h"
#include "evaluation/named_scene.h"
#include "synthetic_world.h"

namespace acmp {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

const std::vector<SyntheticView>& LargeViews() {
  static const std::vector<SyntheticView> kViews = MakeSyntheticScene(NamedScene("hard", 640, 480, 3));
  return kViews;
}

TEST(HardScene, HasTheExposuresOfAVideoAndBlankSurfacesLikeAnOffice) {
  const std::vector<SyntheticView> views = MakeSyntheticScene(NamedScene("hard", 120, 90, 14));
  double least = 10, most = 0;
  for (const SyntheticView& view : views) {
    least = std::min(least, view.exposure);
    most = std::max(most, view.exposure);
    const auto blank = std::count(view.low_texture.begin(), view.low_texture.end(), 1);
    const double share = static_cast<double>(blank) / view.low_texture.size();
    EXPECT_GT(share, 0.25);
    EXPECT_LT(share, 0.50);
  }
  EXPECT_GT(most, 1.5 * least);  // of 14 draws between 0.67 and 1.5
}

// Pixels along a row or column whose depth is within `margin` of `depth`, around a pixel; 0 if what ends them is in
// front or outside of the picture, so that more may be hidden.
int RunLength(const DepthMap& map, int col, int row, int step_col, int step_row, double depth, double margin) {
  int length = -1;  // the pixel itself is met from both sides
  for (const int side : {-1, 1}) {
    for (int k = 0;; k += side, ++length) {
      const int u = col + k * step_col, v = row + k * step_row;
      if (!map.View().Contains(u, v) || map(u, v) < depth - margin) return 0;
      if (map(u, v) > depth + margin) break;
    }
  }
  return length;
}

/// Where a point lies in a view, unless it is outside of it or something is in front.
struct Seen {
  int col, row;
  double depth;
};
std::optional<Seen> Find(const SyntheticView& view, const Vec3d& point, double radius) {
  const Vector3d p = view.frame.cam_from_world * Vector3d(point.x, point.y, point.z);
  if (p.z() <= 0) return std::nullopt;
  const Vector2d pixel = view.frame.camera.Project(p);
  const int col = static_cast<int>(std::lround(pixel.x())), row = static_cast<int>(std::lround(pixel.y()));
  if (!view.true_depth.View().Contains(col, row)) return std::nullopt;
  // The surface is a radius or less in front of the axis.
  if (std::abs(view.true_depth(col, row) - p.z()) > 2 * radius) return std::nullopt;
  return Seen{col, row, p.z()};
}

// A strip of `width` pixels holds the centres of as many, rounded up or down. Perspective and roll tilt rods by up to
// 15 degrees, which lengthens rows across them by 4 %.
void ExpectWidth(int pixels, double width) {
  EXPECT_GE(pixels, std::floor(0.98 * width));
  EXPECT_LE(pixels, std::ceil(1.06 * width));
}

TEST(HardScene, RodsAreInTheDepthMapsAtTheirWidth) {
  int thinner_than_3px = 0, thicker = 0;
  for (const SyntheticView& view : LargeViews()) {
    for (const WorldObject& object : OfficeWorld().objects) {
      const double radius = object.solid.size.x;
      if (object.solid.shape != Shape::kCylinder || radius > 0.0125) continue;
      for (const double part : {-0.7, -0.4, -0.1, 0.2, 0.5}) {  // of the half height
        const Vec3d point = object.solid.center + Vec3d{0, 0, part * object.solid.size.z};
        const auto seen = Find(view, point, radius);
        if (!seen) continue;
        const int run = RunLength(view.true_depth, seen->col, seen->row, 1, 0, seen->depth, 2 * radius);
        if (run == 0) continue;
        const double width = 2 * radius * view.frame.camera.fx / seen->depth;
        ExpectWidth(run, width);
        (width < 3 ? thinner_than_3px : thicker) += 1;
      }
    }
  }
  // Of 17 rods in three views at five heights; the rest is hidden or outside.
  EXPECT_GT(thinner_than_3px, 5);
  EXPECT_GT(thicker, 30);
}

TEST(HardScene, CablesCrossTheDepthMaps) {
  int found = 0;
  for (const SyntheticView& view : LargeViews()) {
    for (const WorldObject& object : OfficeWorld().objects) {
      const Vec3d& half = object.solid.size;
      if (object.solid.shape != Shape::kBox || half.z > 0.006 || half.y > 0.006) continue;
      for (double x = -0.6; x <= 0.6; x += 0.1) {
        const auto seen = Find(view, {x, object.solid.center.y, object.solid.center.z}, 2 * half.y);
        if (!seen) continue;  // outside of the picture or behind a lamp
        // Front and lower face are in view: between one and two times the thickness (which is 1 px to 2 px).
        const double thickness = 2 * half.z * view.frame.camera.fy / seen->depth;
        const int run = RunLength(view.true_depth, seen->col, seen->row, 0, 1, seen->depth, 4 * half.y);
        if (run == 0) continue;
        ++found;
        EXPECT_GE(run, std::floor(thickness));
        EXPECT_LE(run, std::ceil(2 * thickness));
      }
    }
  }
  EXPECT_GT(found, 50);
}

TEST(HardScene, LandmarksLieOnTexture) {
  for (const SyntheticView& view : LargeViews()) {
    int blank = 0;
    for (const Vector3d& landmark : view.frame.landmarks_in_world) {
      const Vector2d pixel = view.frame.camera.Project(view.frame.cam_from_world * landmark);
      blank += view.low_texture(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
    }
    const size_t landmarks = view.frame.landmarks_in_world.size();
    EXPECT_GE(landmarks, 30u);
    // Their error of some millimetres moves some at the edge of a surface past it.
    EXPECT_LT(blank, 0.1 * landmarks);
  }
}

TEST(HardScene, HighlightsMoveWithTheCameraAndPaintDoesNot) {
  const SyntheticWorld& world = OfficeWorld();
  int glossy = 0, matt = 0;
  for (size_t i = 0; i < world.objects.size(); ++i) {
    const WorldObject& object = world.objects[i];
    if (object.solid.shape != Shape::kBox) continue;
    double largest = 0;
    for (double x = -0.9; x <= 0.9; x += 0.1) {
      const Vec3d point = object.solid.center + Vec3d{x * object.solid.size.x, -object.solid.size.y, 0};
      WorldHit hit;
      hit.object = i;
      hit.where = {1.0, {0, -1, 0}, point - object.solid.center, {0, -1, 0}};
      const auto green_from = [&](const Vec3d& eye) { return LitColor(world, hit, {eye, point - eye}, 1).g; };
      largest = std::max(largest, std::abs(green_from({-0.6, -1.3, 1.5}) - green_from({0.6, -1.3, 1.7})));
    }
    if (object.material.gloss > 0) {
      EXPECT_GT(largest, 10.0);  // grey levels: three times the noise
      ++glossy;
    } else {
      EXPECT_LT(largest, 1e-6);
      ++matt;
    }
  }
  EXPECT_EQ(glossy, 1);
  EXPECT_GT(matt, 5);
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
  for (const std::string& name : SyntheticSceneNames()) EXPECT_NO_THROW(SelectSyntheticScene(name, &options));
  try {
    SelectSyntheticScene("kitchen", &options);
    FAIL();
  } catch (const InvalidInputError& error) {
    EXPECT_STREQ(error.what(), "scene = \"kitchen\": must be one of room, hard, street");
  }
}

}  // namespace
}  // namespace acmp
