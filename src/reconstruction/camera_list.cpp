#include <Eigen/Geometry>
#include <iomanip>
#include <sstream>

#include "acmp_mapping/dataset/output_file.h"
#include "reconstruct_run.h"

namespace acmp {

void WriteCameraList(const ReconstructRun& run, const std::vector<int>& images) {
  std::ostringstream text;
  text << "# cameras of the maps (image plane: x right, y down, pixel centres at integer coordinates, no distortion)\n"
          "# columns: index filename fx fy cx cy width height qw qx qy qz tx ty tz\n"
          "# qw..tz is T_world_cam (camera -> world): X_world = R(q) * X_cam + t; camera axes x right, y down, z "
          "forward\n"
       << std::setprecision(15);
  for (int index : images) {
    const PinholeCamera c = CameraOf(run.scene, index, run.options.max_image_size);
    const RigidTransform world_from_cam = run.scene.images[index].cam_from_world.inverse();
    const Eigen::Quaterniond q(world_from_cam.linear());
    const Eigen::Vector3d t = world_from_cam.translation();
    text << index << ' ' << run.scene.images[index].name << ' ' << c.fx << ' ' << c.fy << ' ' << c.cx << ' ' << c.cy
         << ' ' << c.width << ' ' << c.height << ' ' << q.w() << ' ' << q.x() << ' ' << q.y() << ' ' << q.z() << ' '
         << t.x() << ' ' << t.y() << ' ' << t.z() << '\n';
  }
  WriteFileAtomically(run.folder.path() / "cameras.txt", text.str());
}

}  // namespace acmp
