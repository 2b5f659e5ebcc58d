#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "matching.h"

namespace acmp {
namespace {

constexpr int kPatchSide = 2 * kPatchHalfWidth + 1;
constexpr int kPatchPixels = kPatchSide * kPatchSide;

/// Level of the first image whose resolution is that of the other's level `l`.
int LevelOf(const Eigen::Matrix2d& warp, int l, int levels) {
  const double scale = std::sqrt(std::abs(warp.determinant()));
  return std::clamp(static_cast<int>(std::lround(l - std::log2(scale))), 0, levels - 1);
}

/// A value per pixel, row by row. Aligned, so that Eigen adds them in the same order wherever they lie.
struct alignas(EIGEN_MAX_ALIGN_BYTES) Patch {
  float pixels[kPatchPixels];

  auto vector() { return Eigen::Map<Eigen::VectorXf, Eigen::AlignedMax>(pixels, kPatchPixels); }
  auto vector() const { return Eigen::Map<const Eigen::VectorXf, Eigen::AlignedMax>(pixels, kPatchPixels); }
};

struct Template {
  Patch values;  ///< zero mean, unit norm
  Patch dx, dy;  ///< gradients of these
  Eigen::Matrix2f inverse_hessian;
};

/// False where the patch leaves the image or has no texture.
bool MakeTemplate(const GrayPyramid& image, const Eigen::Vector2d& pixel, const Eigen::Matrix2d& inverse_warp,
                  int level, int image_level, Template* patch) {
  const Image<uint8_t>& pixels = image.level(image_level);
  constexpr int padded = kPatchHalfWidth + 1, side = 2 * padded + 1;
  float values[side * side];
  const double scale = static_cast<double>(1 << level) / (1 << image_level);
  const Eigen::Matrix2f step = (inverse_warp * scale).cast<float>();
  const Eigen::Vector2f centre(static_cast<float>(ToLevel(pixel.x(), image_level)),
                               static_cast<float>(ToLevel(pixel.y(), image_level)));
  const Eigen::Vector2f reach = step.cwiseAbs() * Eigen::Vector2f::Constant(static_cast<float>(padded));
  if (centre.x() - reach.x() < 0 || centre.y() - reach.y() < 0 ||
      centre.x() + reach.x() >= static_cast<float>(pixels.width() - 1) ||
      centre.y() + reach.y() >= static_cast<float>(pixels.height() - 1)) {
    return false;
  }
  for (int row = -padded, i = 0; row <= padded; ++row) {
    for (int col = -padded; col <= padded; ++col, ++i) {
      const float u = centre.x() + step(0, 0) * static_cast<float>(col) + step(0, 1) * static_cast<float>(row);
      const float v = centre.y() + step(1, 0) * static_cast<float>(col) + step(1, 1) * static_cast<float>(row);
      values[i] = Sample(pixels, u, v);
    }
  }
  for (int row = 0, i = 0; row < kPatchSide; ++row) {
    for (int col = 0; col < kPatchSide; ++col, ++i) {
      const float* p = values + (row + 1) * side + col + 1;
      patch->values.pixels[i] = *p;
      patch->dx.pixels[i] = 0.5f * (p[1] - p[-1]);
      patch->dy.pixels[i] = 0.5f * (p[side] - p[-side]);
    }
  }
  auto centred = patch->values.vector(), dx = patch->dx.vector(), dy = patch->dy.vector();
  centred.array() -= centred.mean();
  const float squares = centred.squaredNorm();
  if (!(squares > kPatchPixels)) return false;  // a standard deviation of one grey value
  const float inverse_norm = 1.0f / std::sqrt(squares);
  centred *= inverse_norm, dx *= inverse_norm, dy *= inverse_norm;
  const float xx = dx.squaredNorm(), xy = dx.dot(dy), yy = dy.squaredNorm();
  const float determinant = xx * yy - xy * xy;
  if (!(determinant > 1e-4f * (xx + yy) * (xx + yy))) return false;
  patch->inverse_hessian << yy, -xy, -xy, xx;
  patch->inverse_hessian /= determinant;
  return true;
}

/// Samples the patch at `at`, zero mean and unit norm. False where it leaves the image or is blank.
bool SamplePatch(const Image<uint8_t>& image, const Eigen::Vector2f& at, Patch* values) {
  const int left = static_cast<int>(std::floor(at.x())) - kPatchHalfWidth,
            top = static_cast<int>(std::floor(at.y())) - kPatchHalfWidth;
  if (left < 0 || top < 0 || left + kPatchSide >= image.width() || top + kPatchSide >= image.height()) return false;
  const float a = at.x() - std::floor(at.x()), b = at.y() - std::floor(at.y());
  const float w00 = (1 - a) * (1 - b), w01 = a * (1 - b), w10 = (1 - a) * b, w11 = a * b;
  for (int row = 0, i = 0; row < kPatchSide; ++row) {
    const uint8_t* p = &image(left, top + row);
    const uint8_t* q = p + image.width();
    for (int col = 0; col < kPatchSide; ++col, ++i) {
      values->pixels[i] = w00 * p[col] + w01 * p[col + 1] + w10 * q[col] + w11 * q[col + 1];
    }
  }
  auto centred = values->vector();
  centred.array() -= centred.mean();
  const float squares = centred.squaredNorm();
  if (!(squares > 0.25f * kPatchPixels)) return false;
  centred *= 1.0f / std::sqrt(squares);
  return true;
}

}  // namespace

Alignment Align(const GrayPyramid& image, const Eigen::Vector2d& pixel, const Eigen::Matrix2d& warp,
                const GrayPyramid& other, const Eigen::Vector2d& start) {
  constexpr int kStartLevel = 2, kIterations = 12;  // of the pyramids; per level
  constexpr double kMinNcc = 0.85, kMaxShift_px = 12;
  Alignment result;
  const double scale = std::sqrt(std::abs(warp.determinant()));
  if (!(warp.determinant() > 0) || scale > 3 || scale < 1 / 3.0) return result;
  const Eigen::Matrix2d inverse_warp = warp.inverse();
  Eigen::Vector2d at = start;
  Template patch;
  Patch values;
  bool converged = false;
  for (int level = std::min(kStartLevel, other.levels() - 1); level >= 0; --level) {
    const int image_level = LevelOf(warp, level, image.levels());
    if (!MakeTemplate(image, pixel, inverse_warp, level, image_level, &patch)) {
      if (level == 0) return result;
      continue;  // near the border the coarse levels have no room
    }
    Eigen::Vector2f p(static_cast<float>(ToLevel(at.x(), level)), static_cast<float>(ToLevel(at.y(), level)));
    const auto dx = patch.dx.vector(), dy = patch.dy.vector(), wanted = patch.values.vector(), seen = values.vector();
    bool inside = true;
    converged = false;
    for (int iteration = 0; iteration < kIterations && inside; ++iteration) {
      inside = SamplePatch(other.level(level), p, &values);
      if (!inside) break;
      Eigen::Vector2f move = patch.inverse_hessian * Eigen::Vector2f(dx.dot(seen - wanted), dy.dot(seen - wanted));
      const float length = move.norm();
      constexpr float kMaxStep = 2;  // px of the level
      if (length > kMaxStep) move *= kMaxStep / length;
      p -= move;
      if (length < 0.01f) {
        converged = true;
        break;
      }
    }
    if (!inside) {
      if (level == 0) return result;
      continue;
    }
    at = {FromLevel(p.x(), level), FromLevel(p.y(), level)};
    if ((at - start).squaredNorm() > kMaxShift_px * kMaxShift_px) return result;
  }
  if (!converged) return result;
  const Eigen::Vector2f p = at.cast<float>();
  if (!SamplePatch(other.level(0), p, &values)) return result;
  result.pixel = at;
  result.ncc = values.vector().dot(patch.values.vector());
  result.found = result.ncc >= kMinNcc;
  return result;
}

}  // namespace acmp
