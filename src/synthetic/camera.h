#pragma once

#include <cstdint>
#include <variant>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/for_each_pixel.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "geometry.h"
#include "texture.h"

namespace acmp {

/// Camera centre and axes in the world (x right, y down, z forward).
struct CameraPose {
  Vec3d center;
  Vec3d right, down, forward;
};

/// Arcs around a target, one above the other.
struct HandHeldPath {
  Vec3d target;         ///< m
  double orbit_m;       ///< horizontal distance kept from it
  double tan_per_step;  ///< tangent of half the angle between two keyframes, seen from the target
};

/// Along +y and back again (looking along +y all the while), at the height of a camera on a vehicle.
struct StraightPath {
  Vec3d start;    ///< m
  double step_m;  ///< between two keyframes
  int steps;      ///< keyframes until it turns back
};

using CameraPath = std::variant<HandHeldPath, StraightPath>;

/// Pose of keyframe `index` of `count`, with the slow sway of a hand or a vehicle.
CameraPose PoseOnPath(const CameraPath& path, int index, int count, uint32_t seed);

/// 60 degrees of horizontal field of view; principal point a little off the centre, as real ones are.
PinholeCamera SyntheticCamera(int width, int height);

/// Ray through a pixel whose parameter t is the depth z.
Ray PixelRay(const PinholeCamera& camera, const CameraPose& pose, double col, double row);

/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const ImagingModel& model);

/// Exposure of image `index`, as a factor.
double ExposureOf(const ImagingModel& model, uint32_t seed, int index);

/// The camera at `count` evenly spaced moments while the shutter is open; `pose` lies in their middle. The camera only
/// turns: at 0.2 m/s it moves 3 mm in 1/60 s, at 2.4 m a third of what a shake of 0.25 degrees moves the image.
std::vector<CameraPose> PosesDuringExposure(const ImagingModel& model, const CameraPose& pose, uint32_t seed, int index,
                                            int count);

/// Largest angle in radians between a pose during the exposure and the one in the middle.
double LargestTurn(const ImagingModel& model);

/// Pixels around the image that its blur reads.
int PsfBorder(const ImagingModel& model);

/// Blurs an image that has PsfBorder() more pixels on each side than the result. Repeated symmetric kernels of three
/// taps with the model's variance in all: close to a Gaussian, and exact without libm.
Image<ColorD> BlurByPsf(const ImagingModel& model, Image<ColorD> light);

/// Share of the light that reaches a pixel.
double VignettingAt(const ImagingModel& model, const PinholeCamera& camera, int col, int row);

/// Grey levels of one pixel whose noiseless signal is `signal`.
Rgb Digitize(const ImagingModel& model, const ColorD& signal, RandomStream* random);

}  // namespace acmp
