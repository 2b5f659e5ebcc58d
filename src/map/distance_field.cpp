#include "acmp_mapping/map/distance_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace acmp {
namespace {

constexpr size_t kFieldCellBytes = 8;   ///< two versions of a DistanceGrid, and two grids while distances are found
constexpr unsigned kDistanceBits = 14;  ///< of a DistanceGrid's cell
constexpr unsigned kDistanceMask = (1u << kDistanceBits) - 1;
constexpr int kMaxSquared = kMaxDistanceVoxels * kMaxDistanceVoxels;
/// How much larger than what is known a grid is, to each side, so that it need not be made anew with each keyframe.
constexpr double kRoom = 0.2;
constexpr int kLeastRoom = 2;

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

/// Squared distances to the nearest obstacle; kNone: farther than kMaxDistanceVoxels.
using Squares = std::vector<int16_t>;
constexpr int16_t kNone = 10000;  ///< with the greatest squares of two axes added it is below 2^15

/// Of rows, from distances within each row alone (Felzenszwalb and Huttenlocher, Distance Transforms of Sampled
/// Functions, 2012, as far as kMaxDistanceVoxels only): cells [slice][row][cell] get the least of their slice over all
/// rows of that row's value and the squared distance between the rows. Only in rows from `first_row` on, `num_rows`.
Squares AcrossRows(const Squares& within, size_t slices, size_t rows, size_t cells, size_t first_row, size_t num_rows) {
  Squares across(within.size());
  constexpr size_t kChunk = 1024;  // cells: what a chunk's rows need stays in the cache
  const size_t chunks = (cells + kChunk - 1) / kChunk;
  tbb::parallel_for(size_t{0}, slices * chunks, [&](size_t i) {
    const size_t first = i / chunks * rows * cells + i % chunks * kChunk;
    const size_t count = std::min(kChunk, cells - i % chunks * kChunk);
    for (size_t row = first_row; row < first_row + num_rows; ++row) {
      int16_t* out = &across[first + row * cells];
      std::fill(out, out + count, kNone);
      for (size_t away = 0; away <= kMaxDistanceVoxels; ++away) {
        // Rows that the slice does not have: its last one, which has been looked at by its true distance.
        const int16_t* before = &within[first + (row - std::min(row, away)) * cells];
        const int16_t* after = &within[first + std::min(rows - 1, row + away) * cells];
        const auto squared = static_cast<int16_t>(away * away);
        for (size_t k = 0; k < count; ++k) {
          const int16_t least = before[k] < after[k] ? before[k] : after[k];
          const auto distance = static_cast<int16_t>(least + squared);
          out[k] = distance < out[k] ? distance : out[k];
        }
      }
    }
  });
  return across;
}

/// Along a row of so many cells, to both sides.
template <class Predicate>
void WithinRow(size_t size, const Predicate& is_obstacle, int16_t* squares) {
  int away = kMaxDistanceVoxels + 1;
  const auto next = [&](size_t i) {
    away = is_obstacle(i) ? 0 : away + 1;
    return static_cast<int16_t>(away <= kMaxDistanceVoxels ? away * away : kNone);
  };
  for (size_t i = 0; i < size; ++i) squares[i] = next(i);
  away = kMaxDistanceVoxels + 1;
  for (size_t i = size; i-- > 0;) squares[i] = std::min(squares[i], next(i));
}

}  // namespace

bool DistanceGrid::cropped() const {
  const auto is_set = [](bool side) { return side; };
  return std::any_of(goes_on_below.begin(), goes_on_below.end(), is_set) ||
         std::any_of(goes_on_above.begin(), goes_on_above.end(), is_set);
}

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

bool DistanceField::Covers(const VoxelBox& known, const VoxelIndex& camera) const {
  if (grid_->box.Contains(known.low) && grid_->box.Contains(known.high)) return true;
  if (!grid_->cropped()) return false;
  constexpr double kNearBorder = 0.2;
  const VoxelBox inner = Grown(grid_->box, -kNearBorder, std::numeric_limits<int>::min());
  for (size_t i = 0; i < 3; ++i) {
    if (camera[i] < inner.low[i] && known.low[i] < grid_->box.low[i]) return false;
    if (camera[i] > inner.high[i] && known.high[i] > grid_->box.high[i]) return false;
  }
  return true;
}

std::shared_ptr<DistanceGrid> DistanceField::MakeGrid(const OccupancyMap& map, const VoxelBox& known,
                                                      const VoxelIndex& camera) const {
  auto grid = std::make_shared<DistanceGrid>();
  grid->resolution = map.resolution();
  grid->box = Grown(known, kRoom, kLeastRoom);
  const auto max_cells = static_cast<double>(max_cells_);
  if (CellsOf(grid->box) > max_cells) grid->box = Grown(known, 0, kLeastRoom);
  if (CellsOf(grid->box) > max_cells) grid->box = Crop(grid->box, camera, max_cells);
  std::vector<Occupancy> voxels;
  map.Read(grid->box, &voxels);
  grid->cells.resize(voxels.size());
  std::transform(voxels.begin(), voxels.end(), grid->cells.begin(), [](Occupancy occupancy) {
    return static_cast<uint16_t>(static_cast<unsigned>(occupancy) << kDistanceBits);
  });
  return grid;
}

void DistanceField::FindDistances(const VoxelBox& box, DistanceGrid* grid) const {
  if (box.empty()) return;
  const VoxelBox around = Common(Grown(box, 0, kMaxDistanceVoxels), grid->box);
  const auto size = [&](size_t i) { return static_cast<size_t>(around.high[i] - around.low[i] + 1); };
  Squares squares(size(0) * size(1) * size(2));
  const auto rows_of = [&](const VoxelBox& part, const auto& function) {
    tbb::parallel_for(part.low[0], part.high[0] + 1, [&](int x) {
      for (int y = part.low[1]; y <= part.high[1]; ++y) {
        const size_t row = static_cast<size_t>(x - around.low[0]) * size(1) + static_cast<size_t>(y - around.low[1]);
        function(x, y, &grid->cells[grid->CellOf({x, y, part.low[2]})],
                 &squares[row * size(2) + static_cast<size_t>(part.low[2] - around.low[2])]);
      }
    });
  };
  rows_of(around, [&](int /*x*/, int /*y*/, const uint16_t* cells, int16_t* row) {
    const auto is_obstacle = [&](size_t i) { return IsObstacle(static_cast<Occupancy>(cells[i] >> kDistanceBits)); };
    WithinRow(size(2), is_obstacle, row);
  });
  const auto begin = [&](size_t i) { return static_cast<size_t>(box.low[i] - around.low[i]); };
  const auto length = [&](size_t i) { return static_cast<size_t>(box.high[i] - box.low[i] + 1); };
  squares = AcrossRows(squares, size(0), size(1), size(2), begin(1), length(1));
  squares = AcrossRows(squares, 1, size(0), size(1) * size(2), begin(0), length(0));
  const auto to_side = [&](size_t axis, int at) {
    int voxels = kMaxDistanceVoxels;
    if (grid->goes_on_below[axis]) voxels = std::min(voxels, at - grid->box.low[axis] + 1);
    if (grid->goes_on_above[axis]) voxels = std::min(voxels, grid->box.high[axis] - at + 1);
    return voxels;
  };
  rows_of(box, [&](int x, int y, uint16_t* cells, const int16_t* row) {
    const int across = std::min(to_side(0, x), to_side(1, y));
    for (int i = 0; i <= box.high[2] - box.low[2]; ++i) {
      const int most = std::min(across, to_side(2, box.low[2] + i));
      cells[i] = static_cast<uint16_t>((cells[i] & ~kDistanceMask) | std::min<unsigned>(row[i], most * most));
    }
  });
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
  bool anew = change.anew || !grid_ || !Covers(known, newest);
  const auto grid = anew ? MakeGrid(map, known, newest) : std::make_shared<DistanceGrid>(*grid_);
  grid->version = version;
  grid->origin = occupancy.origin();
  for (size_t i = 0; i < 3; ++i) {
    const bool below = known.low[i]<grid->box.low[i], above = known.high[i]> grid->box.high[i];
    anew = std::exchange(grid->goes_on_below[i], below) != below || anew;
    anew = std::exchange(grid->goes_on_above[i], above) != above || anew;
  }
  VoxelBox moved;
  for (const VoxelIndex& voxel : change.changed) {
    if (!grid->box.Contains(voxel)) continue;
    const size_t cell = grid->CellOf(voxel);
    const Occupancy before = grid->OccupancyAt(cell), now = map.At(voxel);
    if (before == now) continue;
    grid->cells[cell] =
        static_cast<uint16_t>(static_cast<unsigned>(now) << kDistanceBits | (grid->cells[cell] & kDistanceMask));
    if (IsObstacle(before) == IsObstacle(now)) continue;
    moved.Add(voxel);
  }
  VoxelBox region = grid->box;
  if (!anew) region = moved.empty() ? moved : Common(Grown(moved, 0, kMaxDistanceVoxels), grid->box);
  FindDistances(region, grid.get());
  grid_ = grid;
  return region;
}

}  // namespace acmp
