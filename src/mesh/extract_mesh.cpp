#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "distance_grids.h"

namespace acmp {
namespace {

using openvdb::Coord;
using FloatAccessor = openvdb::tree::ValueAccessor<const FloatTree>;
using ColorAccessor = openvdb::tree::ValueAccessor<const ColorTree>;

/// Of voxels that count as seen: one look at a slant from a pixel of little confidence.
constexpr float kMinWeight = 0.1f;
using BoolTree = openvdb::tree::Tree4<bool, 5, 4, 3>::Type;
constexpr int kCorners = 8;

/// Corner 0..7 of the cell between a voxel and the next ones.
Coord CornerOf(const Coord& cell, int corner) { return cell.offsetBy(corner & 1, corner >> 1 & 1, corner >> 2 & 1); }

/// Active: of the leaves of `distance` the cells whose corners all have been seen.
openvdb::Grid<BoolTree>::Ptr SeenCells(const FloatTree& distance, const FloatTree& weight) {
  auto tree = std::make_shared<BoolTree>(distance, false, openvdb::TopologyCopy());
  std::vector<BoolTree::LeafNodeType*> leaves;
  tree->getNodes(leaves);
  constexpr int kSize = FloatTree::LeafNodeType::DIM;
  tbb::parallel_for(size_t{0}, leaves.size(), [&](size_t i) {
    const Coord origin = leaves[i]->origin();
    const FloatTree::LeafNodeType* leaf = weight.probeConstLeaf(origin);
    const FloatAccessor weights(weight);
    unsigned seen[kSize + 1][kSize + 1] = {};  // bit z: the voxel (x, y, z) of the leaf or beside it
    for (int x = 0; x <= kSize; ++x) {
      for (int y = 0; y <= kSize; ++y) {
        const int inside = leaf && x < kSize && y < kSize ? kSize : 0;
        const float* row = inside > 0 ? leaf->buffer().data() + (x * kSize + y) * kSize : nullptr;
        for (int z = 0; z <= kSize; ++z) {
          const float value = z < inside ? row[z] : weights.getValue(origin.offsetBy(x, y, z));
          seen[x][y] |= value < kMinWeight ? 0u : 1u << z;
        }
      }
    }
    for (int x = 0; x < kSize; ++x) {
      for (int y = 0; y < kSize; ++y) {
        const unsigned columns = seen[x][y] & seen[x + 1][y] & seen[x][y + 1] & seen[x + 1][y + 1];
        const unsigned cells = columns & columns >> 1;
        for (int z = 0; z < kSize; ++z) {
          leaves[i]->setActiveState(static_cast<openvdb::Index>((x * kSize + y) * kSize + z), (cells >> z & 1u) != 0);
        }
      }
    }
  });
  return openvdb::Grid<BoolTree>::create(tree);
}

/// Colour and confidence of the voxels around a place; confidence 0 where one of them was not seen.
SurfacePoint MakeVertex(const openvdb::Vec3s& position, const FloatAccessor& weight, const ColorAccessor& color) {
  const Coord cell = Coord::floor(position);
  Eigen::Vector3f color_sum = Eigen::Vector3f::Zero();
  float weight_sum = 0;
  bool is_seen = true;
  for (int corner = 0; corner < kCorners; ++corner) {
    const Coord at = CornerOf(cell, corner);
    float share = weight.getValue(at);
    is_seen = is_seen && share >= kMinWeight;
    for (int axis = 0; axis < 3; ++axis) {
      share *= 1 - std::abs(position[axis] - static_cast<float>(at[axis]));
    }
    color_sum += share * UnpackColor(static_cast<uint32_t>(color.getValue(at)));
    weight_sum += share;
  }
  SurfacePoint vertex;
  vertex.position = {position.x(), position.y(), position.z()};
  vertex.normal = {0, 0, 0};
  if (weight_sum > 0) vertex.color = ToRgb(color_sum / weight_sum);
  if (is_seen) vertex.confidence = weight_sum / (1 + weight_sum);
  return vertex;
}

Vec3f NormalTimesArea(const TriangleMesh& mesh, const std::array<uint32_t, 3>& triangle) {
  const Vec3f& a = mesh.vertices[triangle[0]].position;
  return Cross(mesh.vertices[triangle[1]].position - a, mesh.vertices[triangle[2]].position - a);
}

/// OpenVDB's corners are clockwise as seen from outside.
void AddTriangle(uint32_t a, uint32_t c, uint32_t b, TriangleMesh* mesh) {
  for (uint32_t corner : {a, b, c}) {
    if (mesh->vertices[corner].confidence == 0) return;
  }
  const Vec3f normal = NormalTimesArea(*mesh, {a, b, c});
  if (!(Norm(normal) > 0)) return;  // two corners at one place
  mesh->triangles.push_back({a, b, c});
  for (uint32_t corner : {a, b, c}) mesh->vertices[corner].normal = mesh->vertices[corner].normal + normal;
}

/// Cut along the shorter diagonal.
void AddQuad(const openvdb::Vec4I& quad, TriangleMesh* mesh) {
  const auto distance = [mesh](uint32_t a, uint32_t b) {
    return Norm(mesh->vertices[a].position - mesh->vertices[b].position);
  };
  const uint32_t a = quad[0], b = quad[1], c = quad[2], d = quad[3];
  if (distance(a, c) <= distance(b, d)) {
    AddTriangle(a, b, c, mesh);
    AddTriangle(a, c, d, mesh);
  } else {
    AddTriangle(a, b, d, mesh);
    AddTriangle(b, c, d, mesh);
  }
}

/// Leaves out vertices without a triangle, and gives the others unit normals.
void Tidy(TriangleMesh* mesh) {
  std::vector<uint32_t> places(mesh->vertices.size());
  uint32_t count = 0;
  for (size_t i = 0; i < places.size(); ++i) {
    SurfacePoint vertex = mesh->vertices[i];
    const float length = Norm(vertex.normal);
    places[i] = count;
    if (!(length > 0)) continue;
    vertex.normal = (1 / length) * vertex.normal;
    mesh->vertices[count++] = vertex;
  }
  mesh->vertices.resize(count);
  for (auto& triangle : mesh->triangles) {
    for (uint32_t& corner : triangle) corner = places[corner];
  }
}

}  // namespace

TriangleMesh ExtractMeshInVoxels(const FloatTree& distance, const FloatTree& weight, const ColorTree& color) {
  if (distance.leafCount() == 0) return {};
  // The grid does not own the tree, which is only read.
  const auto grid = openvdb::Grid<FloatTree>::create(
      std::shared_ptr<FloatTree>(const_cast<FloatTree*>(&distance), [](FloatTree*) {}));
  grid->setGridClass(openvdb::GRID_LEVEL_SET);  // positive outside
  openvdb::tools::VolumeToMesh mesher;
  mesher.setSurfaceMask(SeenCells(distance, weight));  // but for single cells at its border: AddTriangle
  mesher(*grid);

  TriangleMesh mesh;
  const size_t points = mesher.pointListSize();
  if (points > std::numeric_limits<int32_t>::max()) {
    throw InvalidInputError(Concat("the mesh has ", points, " vertices: must be below 2^31; voxels must be larger"));
  }
  mesh.vertices.resize(points);
  tbb::parallel_for(tbb::blocked_range<size_t>(0, points), [&](const tbb::blocked_range<size_t>& range) {
    const FloatAccessor weights(weight);
    const ColorAccessor colors(color);
    for (size_t i = range.begin(); i < range.end(); ++i) {
      mesh.vertices[i] = MakeVertex(mesher.pointList()[i], weights, colors);
    }
  });
  for (size_t pool = 0; pool < mesher.polygonPoolListSize(); ++pool) {
    const openvdb::tools::PolygonPool& polygons = mesher.polygonPoolList()[pool];
    for (size_t i = 0; i < polygons.numQuads(); ++i) AddQuad(polygons.quad(i), &mesh);
    for (size_t i = 0; i < polygons.numTriangles(); ++i) {
      AddTriangle(polygons.triangle(i)[0], polygons.triangle(i)[1], polygons.triangle(i)[2], &mesh);
    }
  }
  Tidy(&mesh);
  return mesh;
}

}  // namespace acmp
