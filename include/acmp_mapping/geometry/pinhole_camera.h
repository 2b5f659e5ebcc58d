#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <string>

#include "acmp_mapping/geometry/plane_hypothesis.h"

namespace acmp {

/// Undistorted pinhole camera. Pixel centres lie at integer coordinates (OpenCV and ROS CameraInfo convention; COLMAP's
/// lie at +0.5). Camera axes: x right, y down, z forward. Depth is the z coordinate.
struct PinholeCamera {
  int width = 0;   ///< px
  int height = 0;  ///< px
  double fx = 0;   ///< px
  double fy = 0;   ///< px
  double cx = 0;   ///< px
  double cy = 0;   ///< px

  /// Pixel of a point with z > 0.
  Eigen::Vector2d Project(const Eigen::Vector3d& point_in_cam) const {
    return {fx * point_in_cam.x() / point_in_cam.z() + cx, fy * point_in_cam.y() / point_in_cam.z() + cy};
  }

  /// Point at depth z = `depth` seen at a pixel.
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel, double depth = 1.0) const {
    return {depth * (pixel.x() - cx) / fx, depth * (pixel.y() - cy) / fy, depth};
  }

  /// True when the pixel's rounded position lies in the image.
  bool Contains(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= -0.5 && pixel.y() >= -0.5 && pixel.x() < width - 0.5 && pixel.y() < height - 0.5;
  }

  /// The pixel that a point is seen at; none where it is not before the camera, or not in the image.
  std::optional<Eigen::Vector2i> PixelOf(const Eigen::Vector3d& point_in_cam) const {
    if (!(point_in_cam.z() > 0)) return std::nullopt;
    const Eigen::Vector2d pixel = Project(point_in_cam);
    if (!Contains(pixel)) return std::nullopt;
    // Rounded as Contains does: -0.5 belongs to pixel 0.
    return Eigen::Vector2i(static_cast<int>(std::floor(pixel.x() + 0.5)),
                           static_cast<int>(std::floor(pixel.y() + 0.5)));
  }

  Eigen::Matrix3d K() const { return (Eigen::Matrix3d() << fx, 0, cx, 0, fy, cy, 0, 0, 1).finished(); }

  /// The camera of the image resized to new_width x new_height: u -> (u + 0.5) s - 0.5, per axis.
  PinholeCamera Resized(int new_width, int new_height) const;

  /// The camera of the image whose pixels are the means of 2 x 2 pixels; an odd last column or row is left out.
  PinholeCamera Halved() const { return {width / 2, height / 2, fx / 2, fy / 2, (cx - 0.5) / 2, (cy - 0.5) / 2}; }

  bool operator==(const PinholeCamera& o) const {
    return width == o.width && height == o.height && fx == o.fx && fy == o.fy && cx == o.cx && cy == o.cy;
  }
};

/// Throws InvalidInputError unless size and focal lengths are positive and everything is finite. `name` starts
/// messages.
void CheckCamera(const std::string& name, const PinholeCamera& camera);

/// Throws InvalidInputError unless the image or map called `name` has the camera's size.
void CheckSize(const std::string& name, int width, int height, const PinholeCamera& camera);

/// Rays of the camera's pixels, rounded to float.
RayGrid MakeRayGrid(const PinholeCamera& camera);

/// Size whose longer side is at most `max_size` px, aspect kept to a pixel; unchanged when already small or max_size <=
/// 0.
void LimitSize(int max_size, int* width, int* height);

}  // namespace acmp
