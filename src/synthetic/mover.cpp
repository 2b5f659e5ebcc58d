#include "world.h"

#include <algorithm>
#include <cmath>

#include "camera.h"

namespace acmp {
namespace {

constexpr double kShareOfSpeed = 0.3;

/// Ahead of the camera, m.
struct Place {
  double ahead, right, down;
  Vec3d half;  ///< extents
};

Place PlaceOf(SyntheticPlace place) {
  if (place == SyntheticPlace::kStreet) return {8.0, 1.0, 0.4, {0.9, 0.5, 1.0}};  // as large as a car
  return {1.3, 0.2, 0.1, {0.17, 0.12, 0.3}};
}

Vec3d Level(const Vec3d& v) { return {v.x, v.y, 0}; }

}  // namespace

SyntheticWorld WithMovingObject(const SyntheticWorld& world, int index, const SyntheticSceneOptions& options) {
  const auto pose = [&](int i) { return PoseOnPath(world.path, i, options.keyframes, options.seed); };
  const CameraPose middle = pose(options.keyframes / 2);
  const Place place = PlaceOf(options.place);
  const Vec3d from_camera = place.ahead * Normalized(Level(middle.forward)) +
                            place.right * Normalized(Level(middle.right)) - Vec3d{0, 0, place.down};
  const Vec3d moved = kShareOfSpeed * Level(pose(index).center - middle.center);
  const Material material = {Pattern::kMosaic, {70, 40, 90}, {236, 200, 120}};
  SyntheticWorld with = world;
  with.objects.push_back(Box(middle.center + from_camera + moved, place.half, material, kYaw23));
  return with;
}

Mask MaskOfLastObject(const SyntheticWorld& world, const PinholeCamera& camera, const CameraPose& pose,
                      const ImagingModel& imaging) {
  constexpr double kPixelArea = 1;  // px
  const double turn_px = LargestTurn(imaging) * std::max(camera.fx, camera.fy);
  const int margin = static_cast<int>(std::ceil(kPixelArea + turn_px)) + PsfBorder(imaging);
  // All pixels that show it, also beyond the image: what is just outside is mixed into the rim.
  const int width = camera.width + 2 * margin, height = camera.height + 2 * margin;
  Image<unsigned char> shows(width, height);
  ForEachPixel(width, height, [&](int col, int row) {
    const WorldHit hit = Trace(world, PixelRay(camera, pose, col - margin, row - margin));
    shows(col, row) = hit.object + 1 == world.objects.size() ? 1 : 0;
  });
  Mask mask(camera.width, camera.height, 255);
  ForEachPixel(camera.width, camera.height, [&](int col, int row) {
    for (int r = row; r <= row + 2 * margin; ++r) {
      for (int c = col; c <= col + 2 * margin; ++c) {
        if (shows(c, r) != 0) mask(col, row) = 0;
      }
    }
  });
  return mask;
}

}  // namespace acmp
