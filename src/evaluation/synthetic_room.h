#pragma once

#include <cstdint>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "synthetic_texture.h"

namespace acmp {

struct RoomObject {
  Solid solid;
  Material material;
};

/// The room of MakeSyntheticScene. World frame: metres, z up, floor at z = 0, the camera looks along +y. The geometry
/// does not depend on the seed.
const std::vector<RoomObject>& RoomObjects();

/// What a ray sees first. Every ray from inside the room sees something.
struct RoomHit {
  Intersection where;
  size_t object = 0;  ///< index into RoomObjects()
  bool low_texture = false;
};
RoomHit TraceRoom(const Ray& ray);

/// Indices of the objects that a ray within `margin` metres of this one, up to the far wall, can meet; the room itself
/// is always one. Tracing a pixel's many rays against these alone gives the same hits several times faster.
std::vector<size_t> ObjectsNear(const Ray& ray, double margin);
RoomHit TraceRoom(const Ray& ray, const std::vector<size_t>& objects);

/// Lit colour at a hit, 0..255 per channel, the same from wherever it is seen.
ColorD RoomColor(const RoomHit& hit, const Ray& ray, uint32_t seed);

/// Camera centre and axes in the world (x right, y down, z forward).
struct CameraPose {
  Vec3d center;
  Vec3d right, down, forward;
};

/// Pose of keyframe `index` of `count`: arcs of 5 degree steps around the table, one above the other, with the slow
/// sway of a hand.
CameraPose HandHeldPose(int index, int count, uint32_t seed);

/// 60 degrees of horizontal field of view; principal point a little off the centre, as real ones are.
PinholeCamera RoomCamera(int width, int height);

/// No ray inside the room is longer.
constexpr double kRoomDiameter_m = 6.7;

/// Ray through a pixel whose parameter t is the depth z.
Ray PixelRay(const PinholeCamera& camera, const CameraPose& pose, double col, double row);

}  // namespace acmp
