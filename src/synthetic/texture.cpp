#include "world.h"

#include <algorithm>
#include <cmath>

namespace acmp {
namespace {

double ToUnit(uint32_t word) { return (word >> 8) * 0x1p-24; }

double HashUnit(uint32_t key, int64_t x, int64_t y, int64_t z) {
  return ToUnit(HashWord(HashWord(HashWord(HashWord(key) + static_cast<uint32_t>(x)) + static_cast<uint32_t>(y)) +
                         static_cast<uint32_t>(z)));
}

double Lerp(double a, double b, double s) { return a + s * (b - a); }

// First and second derivative vanish at the cell's borders.
double SmoothStep(double s) { return s * s * s * (s * (s * 6.0 - 15.0) + 10.0); }

ColorD Mix(const ColorD& a, const ColorD& b, double s) {
  return {Lerp(a.r, b.r, s), Lerp(a.g, b.g, s), Lerp(a.b, b.b, s)};
}

// Amplitudes fall more slowly than cell sizes so that both 240 and 640 px wide images see detail of a few pixels.
double FractalNoise(uint32_t key, const Vec3d& position_m) {
  constexpr int kOctaves = 6;
  constexpr double kPersistence = 0.8;
  double sum = 0, total = 0, amplitude = 1, frequency = 1.0 / 0.24;
  for (int octave = 0; octave < kOctaves; ++octave) {
    sum += amplitude * ValueNoise(key + static_cast<uint32_t>(octave), frequency * position_m);
    total += amplitude;
    amplitude *= kPersistence;
    frequency *= 2.0;
  }
  constexpr double kContrast = 2.6;  // the mean of six octaves hardly leaves 0.3..0.7
  return std::clamp(0.5 + kContrast * (sum / total - 0.5), 0.0, 1.0);
}

// Coordinates on a box's face: u along the horizontal, v upwards (or the second horizontal on lids).
struct FacePoint {
  double u, v;
  uint32_t face;
};

FacePoint OnFace(const Vec3d& local, const Vec3d& normal) {
  if (std::abs(normal.x) > 0.9) return {local.y, local.z, normal.x > 0 ? 0u : 1u};
  if (std::abs(normal.y) > 0.9) return {local.x, local.z, normal.y > 0 ? 2u : 3u};
  return {local.x, local.y, normal.z > 0 ? 4u : 5u};
}

ColorD HashColor(uint32_t key, int64_t i, int64_t j, uint32_t face) {
  const auto channel = [&](int64_t c) { return 40.0 + 190.0 * HashUnit(key + face, i, j, c); };
  return {channel(11), channel(12), channel(13)};
}

ColorD MosaicColor(const Material& material, uint32_t key, const Vec3d& local, const FacePoint& at) {
  const auto i = static_cast<int64_t>(std::floor(at.u / material.cell_m));
  const auto j = static_cast<int64_t>(std::floor(at.v / material.cell_m));
  const ColorD ground = Mix(material.color, material.other, FractalNoise(key, local));
  return Mix(ground, HashColor(key, i, j, at.face), 0.45);
}

// The same from tile to tile: only the ends of the wall tell one from the other.
ColorD TilesColor(const Material& material, const FacePoint& at) {
  constexpr double kJoint = 0.1;
  const double u = at.u / material.cell_m, v = at.v / material.cell_m;
  return u - std::floor(u) < kJoint || v - std::floor(v) < kJoint ? material.other : material.color;
}

ColorD BooksColor(const Material& material, uint32_t key, const Vec3d& local, const FacePoint& at) {
  constexpr double kRowHeight_m = 0.30;
  constexpr double kBoard_m = 0.02;
  const auto row = static_cast<int64_t>(std::floor(at.v / kRowHeight_m));
  const double above_board = at.v - row * kRowHeight_m;
  const double noise = FractalNoise(key, local);
  if (above_board < kBoard_m) return Mix(material.color, material.other, noise);
  // Spines of unequal width: every second border is moved within its cell.
  const double cell = at.u / material.cell_m;
  auto spine = static_cast<int64_t>(std::floor(cell));
  const double border = 0.25 + 0.5 * HashUnit(key + 91u, spine, row, at.face);
  spine = 2 * spine + (cell - std::floor(cell) > border ? 1 : 0);
  const double top_m = 0.20 + 0.07 * HashUnit(key + 92u, spine, row, at.face);
  if (above_board > top_m) return Mix({38, 32, 28}, {60, 50, 42}, noise);
  return Mix(HashColor(key + 93u, spine, row, at.face), material.other, 0.5 * noise);
}

}  // namespace

double BellNoise(RandomStream* random, double sigma) {
  constexpr double kSqrt3 = 1.7320508075688772;  // four draws have a variance of 4 / 12
  double sum = -2.0;
  for (int i = 0; i < 4; ++i) sum += random->NextUniform();
  return sigma * kSqrt3 * sum;
}

double ValueNoise(uint32_t key, const Vec3d& position) {
  const double fx = std::floor(position.x), fy = std::floor(position.y), fz = std::floor(position.z);
  const auto x = static_cast<uint32_t>(static_cast<int64_t>(fx)), y = static_cast<uint32_t>(static_cast<int64_t>(fy)),
             z = static_cast<uint32_t>(static_cast<int64_t>(fz));
  const double sx = SmoothStep(position.x - fx), sy = SmoothStep(position.y - fy), sz = SmoothStep(position.z - fz);
  // HashUnit of the cell's eight corners, what they share computed once: most of a rendering's time goes here.
  const uint32_t at_key = HashWord(key), at_x[] = {HashWord(at_key + x), HashWord(at_key + x + 1)};
  const auto along_x = [&](const uint32_t(&at_y)[2], uint32_t dz) {
    return Lerp(ToUnit(HashWord(at_y[0] + z + dz)), ToUnit(HashWord(at_y[1] + z + dz)), sx);
  };
  const uint32_t front[] = {HashWord(at_x[0] + y), HashWord(at_x[1] + y)};
  const uint32_t back[] = {HashWord(at_x[0] + y + 1), HashWord(at_x[1] + y + 1)};
  return Lerp(Lerp(along_x(front, 0), along_x(back, 0), sy), Lerp(along_x(front, 1), along_x(back, 1), sy), sz);
}

ColorD TextureColor(const Material& material, uint32_t key, const Vec3d& local, const Vec3d& local_normal) {
  switch (material.pattern) {
    case Pattern::kBlank:
      return material.color;
    case Pattern::kNoise:
      return Mix(material.color, material.other, FractalNoise(key, local));
    case Pattern::kWood:
      return Mix(material.color, material.other, FractalNoise(key, {0.22 * local.x, local.y, local.z}));
    case Pattern::kMosaic:
      return MosaicColor(material, key, local, OnFace(local, local_normal));
    case Pattern::kTiles:
      return TilesColor(material, OnFace(local, local_normal));
    case Pattern::kBooks:
      return BooksColor(material, key, local, OnFace(local, local_normal));
  }
  return material.color;
}

}  // namespace acmp
