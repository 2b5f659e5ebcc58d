#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

/// An image of a scene's cameras.txt.
struct ListedImage {
  int index = 0;
  std::string name;  ///< file name within images/, without white space
};

/// A whole line of it: index filename fx fy cx cy width height qw qx qy qz tx ty tz. The last seven are T_world_cam
/// (camera to world), the quaternion of any length > 0. Pixel centres are at integers, lenses have no distortion.
struct ListedCamera {
  ListedImage image;
  PinholeCamera camera;
  RigidTransform world_from_cam = RigidTransform::Identity();
};

/// Throws ProcessingError with the system's reason.
void WriteCameraList(const std::filesystem::path& path, const std::vector<ListedCamera>& cameras);

/// Throws InvalidInputError naming file, line and value.
std::vector<ListedCamera> ReadCameraList(const std::filesystem::path& path);

}  // namespace acmp
