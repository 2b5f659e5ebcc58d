#include "acmp_mapping/geometry/pinhole_camera.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {

PinholeCamera PinholeCamera::Resized(int new_width, int new_height) const {
  const double sx = static_cast<double>(new_width) / width;
  const double sy = static_cast<double>(new_height) / height;
  return {new_width, new_height, fx * sx, fy * sy, (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5};
}

void CheckCamera(const std::string& name, const PinholeCamera& camera) {
  if (camera.width <= 0 || camera.height <= 0) {
    throw InvalidInputError(Concat(name, ": image size ", camera.width, " x ", camera.height, ": must be positive"));
  }
  if (!(camera.fx > 0 && camera.fy > 0 && std::isfinite(camera.fx) && std::isfinite(camera.fy))) {
    throw InvalidInputError(
        Concat(name, ": focal length fx = ", camera.fx, ", fy = ", camera.fy, ": must be positive and finite"));
  }
  if (!std::isfinite(camera.cx) || !std::isfinite(camera.cy)) {
    throw InvalidInputError(
        Concat(name, ": principal point cx = ", camera.cx, ", cy = ", camera.cy, ": must be finite"));
  }
}

void CheckSize(const std::string& name, int width, int height, const PinholeCamera& camera) {
  if (width == camera.width && height == camera.height) return;
  throw InvalidInputError(
      Concat(name, " size ", width, " x ", height, ": must be the camera's, ", camera.width, " x ", camera.height));
}

RayGrid MakeRayGrid(const PinholeCamera& camera) {
  return {static_cast<float>(1.0 / camera.fx), static_cast<float>(1.0 / camera.fy), static_cast<float>(camera.cx),
          static_cast<float>(camera.cy)};
}

void LimitSize(int max_size, int* width, int* height) {
  const int longer = std::max(*width, *height);
  if (max_size <= 0 || longer <= max_size) return;
  const double scale = static_cast<double>(max_size) / longer;
  *width = std::max(1, static_cast<int>(std::lround(*width * scale)));
  *height = std::max(1, static_cast<int>(std::lround(*height * scale)));
}

}  // namespace acmp
