#include "check_mesh.h"

#include <limits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {
namespace {

template <class T>
void CheckSize(const char* name, const ImageView<T>& map, const PinholeCamera& camera) {
  if (map.width == camera.width && map.height == camera.height) return;
  throw InvalidInputError(Concat(name, " has ", map.width, " x ", map.height, " px: must be the camera's ",
                                 camera.width, " x ", camera.height));
}

}  // namespace

void CheckVolumeOptions(const DistanceVolumeOptions& options) {
  CheckRange("mesh_voxel_size", options.voxel_size, std::numeric_limits<float>::min() + 0.0, 1e9);
  if (options.max_bytes == 0) throw InvalidInputError("memory for the mesh's voxels = 0: must be > 0");
  CheckRange("min_confidence", options.min_confidence, 0.0f, 1.0f);
}

void CheckSurfaceView(const SurfaceView& view) {
  const PinholeCamera& camera = view.camera.camera;
  CheckCamera("camera", camera);
  CheckPose("cam_from_world", view.camera.cam_from_world);
  CheckSize("depth", view.depth, camera);
  CheckSize("normal", view.normal, camera);
  CheckSize("confidence", view.confidence, camera);
  if (!view.color.empty()) CheckSize("color", view.color, camera);
}

}  // namespace acmp
