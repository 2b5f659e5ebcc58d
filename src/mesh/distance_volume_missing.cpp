// In place of distance_volume.cpp in a build without OpenVDB.

#include "acmp_mapping/mesh/distance_volume.h"
#include "check_mesh.h"

namespace acmp {

struct DistanceVolume::Grids {};

bool CanMesh() { return false; }

DistanceVolume::DistanceVolume(const DistanceVolumeOptions& options) : options_(options) {
  CheckVolumeOptions(options);
}
DistanceVolume::~DistanceVolume() = default;
void DistanceVolume::Integrate(const SurfaceView& /*view*/) { CheckCanMesh(); }
TriangleMesh DistanceVolume::ExtractMesh() const { return {}; }
size_t DistanceVolume::voxels() const { return 0; }

}  // namespace acmp
