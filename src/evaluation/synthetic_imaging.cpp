#include "synthetic_imaging.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <tbb/parallel_for.h>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

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
  tbb::parallel_for(0, rows.height(), [&](int v) {
    for (int u = 0; u < rows.width(); ++u) rows(u, v) = WeightedSum(in(u, v), in(u + 1, v), in(u + 2, v), side);
  });
  Image<ColorD> out(rows.width(), rows.height() - 2);
  tbb::parallel_for(0, out.height(), [&](int v) {
    for (int u = 0; u < out.width(); ++u) out(u, v) = WeightedSum(rows(u, v), rows(u, v + 1), rows(u, v + 2), side);
  });
  return out;
}

}  // namespace

void Validate(const ImagingModel& model) {
  CheckRange("read_noise_grey", model.read_noise_grey, 0.0, 50.0);
  CheckRange("grey_per_electron", model.grey_per_electron, 0.0, 1.0);
  CheckRange("psf_sigma_px", model.psf_sigma_px, 0.0, 5.0);
  CheckRange("shake_deg", model.shake_deg, 0.0, 2.0);
  CheckRange("exposure_spread", model.exposure_spread, 0.0, 0.5);
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
