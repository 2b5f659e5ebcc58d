#include "world.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/degrees.h"

namespace acmp {
namespace {

// Tangent-half-angle form: smooth, exact to rounding, no libm.
Yaw YawOf(double half_angle_tangent) {
  const double q = half_angle_tangent * half_angle_tangent;
  return {(1.0 - q) / (1.0 + q), 2.0 * half_angle_tangent / (1.0 + q)};
}

// Value in -1..1 that drifts with a period of a few keyframes.
double Sway(uint32_t seed, uint32_t axis, int index) {
  return 2.0 * ValueNoise(seed * 977u + axis, {0.37 * index + 0.5, 0.5, 0.5}) - 1.0;
}

// Looks at the target, level but for a roll of up to 2.3 degrees.
CameraPose LookAt(const Vec3d& center, const Vec3d& target, double roll_sway) {
  CameraPose pose;
  pose.center = center;
  pose.forward = Normalized(target - center);
  const Vec3d level_right = Normalized(Cross(pose.forward, {0, 0, 1}));
  const Vec3d level_down = Cross(pose.forward, level_right);
  const Yaw roll = YawOf(0.02 * roll_sway);
  pose.right = roll.cos * level_right + roll.sin * level_down;
  pose.down = roll.cos * level_down - roll.sin * level_right;
  return pose;
}

CameraPose PoseOn(const HandHeldPath& path, int index, int count, uint32_t seed) {
  constexpr int kPerArc = 14;
  constexpr int kArcs = 3;  // heights: there and back again, then repeated with another sway
  const int per_arc = std::min(count, kPerArc);
  const int arc = index / per_arc;
  const int step = arc % 2 == 0 ? index % per_arc : per_arc - 1 - index % per_arc;
  const int cycle = arc % (2 * kArcs - 2);
  const int level = cycle < kArcs ? cycle : 2 * kArcs - 2 - cycle;

  const Yaw angle = YawOf(path.tan_per_step * (step - 0.5 * (per_arc - 1)));
  const double radius = path.orbit_m + 0.05 * Sway(seed, 1, index);
  const double height = 1.42 + 0.22 * level + 0.06 * Sway(seed, 2, index);
  const Vec3d center = {path.target.x + radius * angle.sin + 0.02 * Sway(seed, 3, index),
                        path.target.y - radius * angle.cos, height};
  const Vec3d target = path.target + Vec3d{0.06 * Sway(seed, 4, index), 0.0, 0.05 * Sway(seed, 5, index)};
  return LookAt(center, target, Sway(seed, 6, index));
}

CameraPose PoseOn(const StraightPath& path, int index, int /*count*/, uint32_t seed) {
  const int cycle = index % (2 * path.steps);
  const int step = cycle <= path.steps ? cycle : 2 * path.steps - cycle;
  constexpr double kTarget_m = 20;  // looked at ahead
  const Vec3d on_path = path.start + Vec3d{0, path.step_m * (step + 0.2 * Sway(seed, 1, index)), 0};
  const Vec3d center = on_path + Vec3d{0.15 * Sway(seed, 3, index), 0, 0.05 * Sway(seed, 2, index)};
  const Vec3d target = on_path + Vec3d{1.2 * Sway(seed, 4, index), kTarget_m, 0.5 * Sway(seed, 5, index)};
  return LookAt(center, target, 0.3 * Sway(seed, 6, index));
}

// Numbers of the streams of draws that belong to an image; noise uses the image's index, 0..999.
constexpr uint32_t kExposureStream = 0xe590, kShakeStream = 0x5ba4e;

unsigned char Quantize(double value) {
  return static_cast<unsigned char>(std::floor(std::clamp(value, 0.0, 255.0) + 0.5));
}

// Turned by the small rotation vector `turn` (world axes); orthonormal to rounding.
CameraPose Turned(const CameraPose& pose, const Vec3d& turn) {
  CameraPose turned = pose;
  turned.forward = Normalized(pose.forward + Cross(turn, pose.forward));
  const Vec3d right = pose.right + Cross(turn, pose.right);
  turned.right = Normalized(right - Dot(right, turned.forward) * turned.forward);
  turned.down = Cross(turned.forward, turned.right);
  return turned;
}

// A variance of 1/2 is the most that three taps can have without a hole in the middle: 1/4, 1/2, 1/4.
int PsfPasses(double sigma) { return static_cast<int>(std::ceil(2.0 * sigma * sigma)); }

ColorD WeightedSum(const ColorD& before, const ColorD& here, const ColorD& after, double side) {
  const double middle = 1.0 - 2.0 * side;
  return {side * (before.r + after.r) + middle * here.r, side * (before.g + after.g) + middle * here.g,
          side * (before.b + after.b) + middle * here.b};
}

// One pass along both axes; the result is one pixel smaller on each side.
Image<ColorD> BlurOnce(const Image<ColorD>& in, double side) {
  Image<ColorD> rows(in.width() - 2, in.height());
  ForEachPixel(rows.width(), rows.height(),
               [&](int u, int v) { rows(u, v) = WeightedSum(in(u, v), in(u + 1, v), in(u + 2, v), side); });
  Image<ColorD> out(rows.width(), rows.height() - 2);
  ForEachPixel(out.width(), out.height(),
               [&](int u, int v) { out(u, v) = WeightedSum(rows(u, v), rows(u, v + 1), rows(u, v + 2), side); });
  return out;
}

}  // namespace

CameraPose PoseOnPath(const CameraPath& path, int index, int count, uint32_t seed) {
  return std::visit([&](const auto& kind) { return PoseOn(kind, index, count, seed); }, path);
}

PinholeCamera SyntheticCamera(int width, int height) {
  constexpr double kFocalPerWidth = 0.8660254037844386;  // 0.5 / tan(30 degrees)
  return {
      width, height, kFocalPerWidth * width, 1.004 * kFocalPerWidth * width, 0.508 * width - 0.5, 0.494 * height - 0.5};
}

Ray PixelRay(const PinholeCamera& camera, const CameraPose& pose, double col, double row) {
  const double x = (col - camera.cx) / camera.fx;
  const double y = (row - camera.cy) / camera.fy;
  return {pose.center, x * pose.right + y * pose.down + pose.forward};
}

double ExposureOf(const ImagingModel& model, uint32_t seed, int index) {
  RandomStream random(seed, static_cast<uint32_t>(index), kExposureStream);
  const double change = model.exposure_spread * (2.0 * random.NextUniform() - 1.0);
  return (1.0 + change) / (1.0 - change);  // as often brighter as darker by the same factor
}

std::vector<CameraPose> PosesDuringExposure(const ImagingModel& model, const CameraPose& pose, uint32_t seed, int index,
                                            int count) {
  std::vector<CameraPose> poses(count, pose);
  if (model.shake_deg == 0) return poses;
  RandomStream random(seed, static_cast<uint32_t>(index), kShakeStream);
  const double sigma = kRadPerDeg<double> * model.shake_deg;
  const Vec3d turn = {BellNoise(&random, sigma), BellNoise(&random, sigma), BellNoise(&random, sigma)};
  const Vec3d in_world = turn.x * pose.right + turn.y * pose.down + turn.z * pose.forward;
  for (int i = 0; i < count; ++i) poses[i] = Turned(pose, ((i + 0.5) / count - 0.5) * in_world);
  return poses;
}

double LargestTurn(const ImagingModel& model) {
  constexpr double kLargestDraw = 3.47, kAxes = 1.74;  // BellNoise ends at 2 sqrt(3) sigma; sqrt(3)
  return 0.5 * kLargestDraw * kAxes * kRadPerDeg<double> * model.shake_deg;
}

int PsfBorder(const ImagingModel& model) { return PsfPasses(model.psf_sigma_px); }

Image<ColorD> BlurByPsf(const ImagingModel& model, Image<ColorD> light) {
  const int passes = PsfPasses(model.psf_sigma_px);
  const double side = passes > 0 ? model.psf_sigma_px * model.psf_sigma_px / (2 * passes) : 0;
  for (int i = 0; i < passes; ++i) light = BlurOnce(light, side);
  return light;
}

double VignettingAt(const ImagingModel& model, const PinholeCamera& camera, int col, int row) {
  if (!model.vignetting) return 1.0;
  const double x = (col - camera.cx) / camera.fx;
  const double y = (row - camera.cy) / camera.fy;
  const double squared_cosine = 1.0 / (1.0 + x * x + y * y);
  return squared_cosine * squared_cosine;
}

Rgb Digitize(const ImagingModel& model, const ColorD& signal, RandomStream* random) {
  const double read_variance = model.read_noise_grey * model.read_noise_grey;
  const auto digitize = [&](double grey) {
    return Quantize(grey + BellNoise(random, std::sqrt(read_variance + model.grey_per_electron * grey)));
  };
  // Braces fix the order of the draws.
  return Rgb{digitize(signal.r), digitize(signal.g), digitize(signal.b)};
}

}  // namespace acmp
