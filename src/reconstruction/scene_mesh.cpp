#include "run.h"

#include <algorithm>
#include <vector>

#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/mesh/distance_volume.h"

namespace acmp {
namespace {

double VoxelSize(const ReconstructOptions& options, const OutputFolder& folder,
                 const std::vector<ListedCamera>& cameras) {
  if (options.mesh_voxel_size > 0) return options.mesh_voxel_size;
  constexpr size_t kMaxImages = 50;  // spread over the run: their median is that of all
  const size_t step = std::max<size_t>(1, cameras.size() / kMaxImages);
  std::vector<double> footprints;
  for (size_t i = 0; i < cameras.size(); i += step) {
    const DepthMap depth = ReadPfm(folder.MapFile("depth", cameras[i].image.index, ".pfm"));
    footprints.push_back(MedianFootprint(cameras[i].camera, depth));
  }
  return DefaultVoxelSize(std::move(footprints));
}

}  // namespace

void WriteSceneMesh(const ReconstructOptions& options, const Eigen::Vector3d& origin, const OutputFolder& folder,
                    const StopRequest& interrupt, FrameStore* frames, Progress* progress) {
  const Timer timer;
  const std::vector<ListedCamera> cameras = ReadCameraList(folder.path() / "cameras.txt");
  DistanceVolumeOptions volume_options;
  volume_options.voxel_size = VoxelSize(options, folder, cameras);
  volume_options.max_bytes = options.MemoryBytes(1 - options.kImageShare - options.kRectifierShare);
  volume_options.min_confidence = kMinMeshConfidence;
  DistanceVolume volume(volume_options);
  progress->Begin("mesh", static_cast<int>(cameras.size()) + 1);
  for (const ListedCamera& image : cameras) {
    const DepthMap depth = ReadPfm(folder.MapFile("depth", image.image.index, ".pfm"));
    const NormalMap normal = ReadPfmNormals(folder.MapFile("normal", image.image.index, ".pfm"));
    const ConfidenceMap confidence = ReadPfm(folder.MapFile("confidence", image.image.index, ".pfm"));
    const FramePtr frame = frames->Get(image.image.index);
    RigidTransform pose = image.world_from_cam;
    pose.translation() -= origin;
    volume.Integrate({{image.camera, pose.inverse()}, depth, normal, confidence, frame->color});
    interrupt.Check();
    progress->Step();
  }
  const TriangleMesh mesh = volume.ExtractMesh();
  interrupt.Check();
  WriteMesh(options.mesh, mesh, MeshFormatOf(options.mesh), origin);
  progress->Step();
  progress->Result(Concat(options.mesh.string(), ": ", mesh.vertices.size(), " vertices, ", mesh.triangles.size(),
                          " triangles, voxels of ", volume_options.voxel_size, ", ", volume.bytes() / 1000000,
                          " MB while it was made; took ", FormatDuration(timer.Elapsed() / 1000)));
}

}  // namespace acmp
