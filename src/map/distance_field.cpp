#include "acmp_mapping/map/distance_field.h"

#include <dynamicEDT3D/dynamicEDT3D.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace acmp {
namespace {

/// DynamicEDT3D's cell (28), its share of rows, and two versions of a DistanceGrid.
constexpr size_t kFieldCellBytes = 32;
constexpr unsigned kDistanceBits = 14;  ///< of a DistanceGrid's cell
constexpr unsigned kDistanceMask = (1u << kDistanceBits) - 1;
constexpr int kMaxSquared = kMaxDistanceVoxels * kMaxDistanceVoxels;
/// How much larger than what is known a grid is, to each side, so that it need not be made anew with each keyframe.
constexpr double kRoom = 0.2;
constexpr int kLeastRoom = 2;

int ToInt(size_t number) { return static_cast<int>(number); }

double CellsOf(const VoxelBox& box) {
  double cells = 1;
  for (size_t i = 0; i < 3; ++i) cells *= static_cast<double>(box.high[i]) - box.low[i] + 1;
  return cells;
}

VoxelBox Grown(VoxelBox box, double share, int least) {
  for (size_t i = 0; i < 3; ++i) {
    const int room = std::max(least, static_cast<int>(share * (box.high[i] - box.low[i])));
    box.low[i] -= room;
    box.high[i] += room;
  }
  return box;
}

VoxelBox Common(VoxelBox a, const VoxelBox& b) {
  for (size_t i = 0; i < 3; ++i) a.low[i] = std::max(a.low[i], b.low[i]), a.high[i] = std::min(a.high[i], b.high[i]);
  return a;
}

/// A part of a box with at most so many cells, about a voxel as far as that goes: its longest sides are shortened.
VoxelBox Crop(const VoxelBox& box, const VoxelIndex& centre, double max_cells) {
  std::array<double, 3> size;
  for (size_t i = 0; i < 3; ++i) size[i] = static_cast<double>(box.high[i]) - box.low[i] + 1;
  constexpr double kStep = 0.95;
  while (std::floor(size[0]) * std::floor(size[1]) * std::floor(size[2]) > max_cells) {
    *std::max_element(size.begin(), size.end()) *= kStep;
  }
  VoxelBox part;
  for (size_t i = 0; i < 3; ++i) {
    const int length = std::max(1, static_cast<int>(size[i]));
    part.low[i] = std::clamp(centre[i] - length / 2, box.low[i], box.high[i] + 1 - length);
    part.high[i] = part.low[i] + length - 1;
  }
  return part;
}

VoxelIndex VoxelOf(const Eigen::Vector3d& point, double resolution) {
  const Eigen::Vector3i voxel = (point / resolution).array().floor().cast<int>();
  return {voxel.x(), voxel.y(), voxel.z()};
}

const std::array<float, kMaxSquared + 1>& SquareRoots() {
  static const auto roots = [] {
    std::array<float, kMaxSquared + 1> table{};
    for (size_t i = 0; i < table.size(); ++i) table[i] = std::sqrt(static_cast<float>(i));
    return table;
  }();
  return roots;
}

}  // namespace

struct DistanceField::Transform : DynamicEDT3D {
  Transform() : DynamicEDT3D(kMaxSquared) {}
  /// Of the cells along z; getSQCellDistance would look each of them up.
  const dataCell* Column(int x, int y) const { return data[x][y]; }
};

Occupancy DistanceGrid::OccupancyAt(size_t cell) const { return static_cast<Occupancy>(cells[cell] >> kDistanceBits); }

float DistanceGrid::DistanceAt(size_t cell) const {
  return static_cast<float>(resolution) * SquareRoots()[cells[cell] & kDistanceMask];
}

PointDistance DistanceGrid::At(const Eigen::Vector3d& point) const {
  PointDistance answer;
  answer.distance = std::numeric_limits<float>::quiet_NaN();
  const Eigen::Vector3d at = point / resolution;
  for (int i = 0; i < 3; ++i) {
    const auto axis = static_cast<size_t>(i);
    if (!(at[i] >= box.low[axis] && at[i] < box.high[axis] + 1.0)) return answer;
  }
  answer.occupancy = OccupancyAt(CellOf(VoxelOf(point, resolution)));
  // The eight voxels whose middles are around the point; at the border of the grid some are the same.
  std::array<std::array<size_t, 2>, 3> cell;
  Eigen::Vector3f part;
  const std::array<size_t, 3> step = {size(1) * size(2), size(2), 1};
  for (size_t i = 0; i < 3; ++i) {
    const double from = at[static_cast<int>(i)] - 0.5 - box.low[i];
    const double last = static_cast<double>(size(i) - 1), below = std::clamp(std::floor(from), 0.0, last);
    part[static_cast<int>(i)] = static_cast<float>(std::clamp(from - below, 0.0, 1.0));
    cell[i] = {step[i] * static_cast<size_t>(below), step[i] * static_cast<size_t>(std::min(below + 1, last))};
  }
  answer.distance = 0;
  for (unsigned corner = 0; corner < 8; ++corner) {
    size_t index = 0;
    Eigen::Vector3f weight, slope;
    for (unsigned i = 0; i < 3; ++i) {
      const unsigned side = corner >> i & 1u;
      index += cell[i][side];
      weight[i] = side == 1 ? part[i] : 1 - part[i];
      slope[i] = side == 1 ? 1.0f : -1.0f;
    }
    const float distance = DistanceAt(index);
    answer.distance += weight.prod() * distance;
    answer.gradient += distance / static_cast<float>(resolution) *
                       Eigen::Vector3f(slope[0] * weight[1] * weight[2], weight[0] * slope[1] * weight[2],
                                       weight[0] * weight[1] * slope[2]);
  }
  return answer;
}

DistanceField::DistanceField(bool unknown_is_obstacle, size_t max_bytes)
    : unknown_is_obstacle_(unknown_is_obstacle), max_cells_(std::max<size_t>(1, max_bytes / kFieldCellBytes)) {}

DistanceField::~DistanceField() = default;

bool DistanceField::Covers(const VoxelBox& known, const VoxelIndex& camera) const {
  if (grid_->box.Contains(known.low) && grid_->box.Contains(known.high)) return true;
  if (!grid_->cropped) return false;
  constexpr double kNearBorder = 0.2;
  const VoxelBox inner = Grown(grid_->box, -kNearBorder, std::numeric_limits<int>::min());
  for (size_t i = 0; i < 3; ++i) {
    if (camera[i] < inner.low[i] && known.low[i] < grid_->box.low[i]) return false;
    if (camera[i] > inner.high[i] && known.high[i] > grid_->box.high[i]) return false;
  }
  return true;
}

void DistanceField::Restart(const OccupancyMap& map, const VoxelBox& known, const VoxelIndex& camera) {
  transform_.reset();
  auto grid = std::make_shared<DistanceGrid>();
  grid->resolution = map.resolution();
  grid->box = Grown(known, kRoom, kLeastRoom);
  const auto max_cells = static_cast<double>(max_cells_);
  if (CellsOf(grid->box) > max_cells) grid->box = Grown(known, 0, kLeastRoom);
  grid->cropped = CellsOf(grid->box) > max_cells;
  if (grid->cropped) grid->box = Crop(grid->box, camera, max_cells);
  std::vector<Occupancy> voxels;
  map.Read(grid->box, &voxels);
  grid->cells.resize(voxels.size());
  // The transform deletes it.
  auto*** obstacles = new bool**[grid->size(0)];
  for (size_t x = 0; x < grid->size(0); ++x) {
    obstacles[x] = new bool*[grid->size(1)];
    for (size_t y = 0; y < grid->size(1); ++y) {
      obstacles[x][y] = new bool[grid->size(2)];
      for (size_t z = 0; z < grid->size(2); ++z) {
        const size_t cell = (x * grid->size(1) + y) * grid->size(2) + z;
        grid->cells[cell] = static_cast<uint16_t>(static_cast<unsigned>(voxels[cell]) << kDistanceBits);
        obstacles[x][y][z] = IsObstacle(voxels[cell]);
      }
    }
  }
  transform_ = std::make_unique<Transform>();
  transform_->initializeMap(ToInt(grid->size(0)), ToInt(grid->size(1)), ToInt(grid->size(2)), obstacles);
  grid_ = std::move(grid);
}

void DistanceField::ReadDistances(const VoxelBox& box, DistanceGrid* grid) const {
  if (box.empty()) return;
  const VoxelIndex& low = grid->box.low;
  for (int x = box.low[0]; x <= box.high[0]; ++x) {
    for (int y = box.low[1]; y <= box.high[1]; ++y) {
      const auto* transformed = transform_->Column(x - low[0], y - low[1]) - low[2];
      uint16_t* cells = &grid->cells[grid->CellOf({x, y, low[2]})] - low[2];
      for (int z = box.low[2]; z <= box.high[2]; ++z) {
        cells[z] = static_cast<uint16_t>((cells[z] & ~kDistanceMask) |
                                         static_cast<unsigned>(std::clamp(transformed[z].sqdist, 0, kMaxSquared)));
      }
    }
  }
}

VoxelBox DistanceField::Update(const LiveOccupancy& occupancy, const LiveOccupancy::Change& change,
                               const Eigen::Vector3d& camera, uint64_t version) {
  const OccupancyMap& map = *occupancy.map();
  const VoxelBox known = map.KnownBox();
  if (known.empty()) {
    Clear();
    return {};
  }
  const VoxelIndex newest = VoxelOf(camera, map.resolution());
  const bool anew = change.anew || !grid_ || !Covers(known, newest);
  if (anew) Restart(map, known, newest);
  auto grid = std::make_shared<DistanceGrid>(*grid_);
  grid->version = version;
  grid->origin = occupancy.origin();
  VoxelBox moved;
  if (!anew) {
    for (const VoxelIndex& voxel : change.changed) {
      if (!grid->box.Contains(voxel)) continue;
      const size_t cell = grid->CellOf(voxel);
      const Occupancy before = grid->OccupancyAt(cell), now = map.At(voxel);
      if (before == now) continue;
      grid->cells[cell] =
          static_cast<uint16_t>(static_cast<unsigned>(now) << kDistanceBits | (grid->cells[cell] & kDistanceMask));
      if (IsObstacle(before) == IsObstacle(now)) continue;
      const int x = voxel[0] - grid->box.low[0], y = voxel[1] - grid->box.low[1], z = voxel[2] - grid->box.low[2];
      IsObstacle(now) ? transform_->occupyCell(x, y, z) : transform_->clearCell(x, y, z);
      moved.Add(voxel);
    }
  }
  const bool square_roots = false;
  transform_->update(square_roots);
  VoxelBox region = grid->box;
  if (!anew) region = moved.empty() ? moved : Common(Grown(moved, 0, kMaxDistanceVoxels), grid->box);
  ReadDistances(region, grid.get());
  grid_ = std::move(grid);
  return region;
}

void DistanceField::Clear() {
  transform_.reset();
  grid_.reset();
}

}  // namespace acmp
