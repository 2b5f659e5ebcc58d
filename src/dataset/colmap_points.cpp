#include <algorithm>
#include <cmath>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/random.h"
#include "acmp_mapping/dataset/colmap_workspace.h"

namespace acmp {

ColmapPoints::ColmapPoints(const PointCloud& cloud, const Eigen::Vector3d& origin) {
  const size_t count = std::min(cloud.size(), kMaxPoints);
  points_.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    const SurfacePoint& point = cloud[i * cloud.size() / count];
    const Vec3f& p = point.position;
    points_.push_back({origin + Eigen::Vector3d(p.x, p.y, p.z), point.color, {}});
  }
  views_.resize(count);
  unconfirmed_.assign(count, kNone);
}

void ColmapPoints::AddImage(size_t image, const PosedCamera& camera, const DepthMap& depth) {
  if (depth.width() != camera.camera.width || depth.height() != camera.camera.height) {
    throw InvalidInputError(Concat("depth map of ", depth.width(), " x ", depth.height(), " px: must have the size of ",
                                   "its camera, ", camera.camera.width, " x ", camera.camera.height));
  }
  for (size_t i = 0; i < points_.size(); ++i) {
    const Eigen::Vector3d in_cam = camera.cam_from_world * points_[i].position_in_world;
    if (!(in_cam.z() > 0)) continue;
    const Eigen::Vector2d pixel = camera.camera.Project(in_cam);
    if (!camera.camera.Contains(pixel)) continue;
    const double seen =
        depth(static_cast<int>(std::floor(pixel.x() + 0.5)), static_cast<int>(std::floor(pixel.y() + 0.5)));
    if (!(seen > 0)) unconfirmed_[i] = std::min(unconfirmed_[i], static_cast<uint32_t>(image));
    if (!(std::abs(seen - in_cam.z()) <= kMaxRelativeDepth * in_cam.z())) continue;
    // Reservoir sampling (Vitter, 1985), with numbers that depend on the point and the view alone.
    std::vector<size_t>& images = points_[i].images;
    const uint32_t view = views_[i]++;
    if (images.size() < kMaxTrack) {
      images.push_back(image);
    } else if (const uint32_t place = HashWord(HashWord(static_cast<uint32_t>(i)) + view) % (view + 1);
               place < kMaxTrack) {
      images[place] = image;
    }
  }
}

std::vector<ColmapModelPoint> ColmapPoints::Take() {
  for (size_t i = 0; i < points_.size(); ++i) {
    if (points_[i].images.empty() && unconfirmed_[i] != kNone) points_[i].images = {unconfirmed_[i]};
  }
  return std::move(points_);
}

}  // namespace acmp
