#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/output_file.h"

namespace acmp {

void WriteObj(const std::filesystem::path& path, const TriangleMesh& mesh, const Eigen::Vector3d& origin) {
  AtomicFile file(path, Durability::kPowerCut);
  constexpr double kWhite = 255;
  const int digits = TextDigits(origin);
  for (const SurfacePoint& v : mesh.vertices) {
    const Eigen::Vector3d p = InWorld(origin, v.position);
    file.Print("v %.*g %.*g %.*g %.4f %.4f %.4f\n", digits, p.x(), digits, p.y(), digits, p.z(), v.color.r / kWhite,
               v.color.g / kWhite, v.color.b / kWhite);
  }
  for (const SurfacePoint& v : mesh.vertices) {
    file.Print("vn %.4f %.4f %.4f\n", v.normal.x, v.normal.y, v.normal.z);
  }
  for (const auto& triangle : mesh.triangles) {
    const unsigned a = triangle[0] + 1, b = triangle[1] + 1, c = triangle[2] + 1;  // counted from 1
    file.Print("f %u//%u %u//%u %u//%u\n", a, a, b, b, c, c);
  }
  file.Commit();
}

MeshFormat MeshFormatOf(const std::filesystem::path& path) {
  const std::string extension = LowerExtension(path);
  if (extension == ".ply") return MeshFormat::kPly;
  if (extension == ".obj") return MeshFormat::kObj;
  throw InvalidInputError(Concat("mesh ", path, ": must end with .ply or .obj"));
}

void WriteMesh(const std::filesystem::path& path, const TriangleMesh& mesh, MeshFormat format,
               const Eigen::Vector3d& origin) {
  if (mesh.triangles.empty()) throw InvalidInputError("the mesh is empty: nothing was written");
  if (format == MeshFormat::kPly) return WritePlyMesh(path, mesh, origin);
  WriteObj(path, mesh, origin);
}

}  // namespace acmp
