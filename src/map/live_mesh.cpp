#include "acmp_mapping/map/live_mesh.h"

#include <array>
#include <iterator>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/map/map_mesh.h"

namespace acmp {
namespace {

bool Intersect(const std::vector<VolumeBlock>& a, const std::vector<VolumeBlock>& b) {
  for (auto i = a.begin(), k = b.begin(); i != a.end() && k != b.end();) {
    if (*i == *k) return true;
    *i < *k ? ++i : ++k;
  }
  return false;
}

/// These and all that touch them.
std::vector<VolumeBlock> WithNeighbours(const std::vector<VolumeBlock>& blocks) {
  std::set<VolumeBlock> all;
  for (const auto& [x, y, z] : blocks) {
    for (int i = 0; i < 27; ++i) all.insert({x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1});
  }
  return {all.begin(), all.end()};
}

}  // namespace

MeshUpdate LiveMesh::Update(bool make_again) {
  const auto end =
      Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(options_.max_seconds));
  if (const uint64_t version = map_->version(); version_ != version) {
    version_.reset();  // what Read throws has it read again
    if (Read(end)) version_ = version;
  }
  MeshUpdate update;
  try {
    while (AddKeyframe() && Clock::now() < end) continue;
    while (make_again && MakeAgain() && Clock::now() < end) continue;
  } catch (const VoxelsTooSmallError&) {
    constexpr double kCoarsest = 1 << 20;
    if (coarser_ >= kCoarsest) throw;
    coarser_ *= 2;
    Restart(2 * voxel_size_);
  }
  update.anew = std::exchange(begins_anew_, false);
  update.origin = origin_;
  size_t triangles = 0;
  for (bool more = true, is_first = true; more && (is_first || Clock::now() < end); is_first = false) {
    const size_t before = update.blocks.size();
    more = Tell(options_.max_triangles - triangles, &update);
    for (size_t i = before; i < update.blocks.size(); ++i) triangles += update.blocks[i].mesh.triangles.size();
    more = more && triangles < options_.max_triangles;
  }
  return update;
}

bool LiveMesh::Read(Clock::time_point end) {
  const PlacedKeyframes map = map_->Placed();
  if (map.voxel_size != map_voxel_size_ || map.keyframes.empty()) {
    keyframes_.clear();
    Restart(0);
    coarser_ = 1;
  }
  map_voxel_size_ = map.voxel_size;
  if (map.keyframes.empty() || map.voxel_size == 0) return true;

  EraseGone(map.keyframes, &keyframes_, [this](const Keyframe& gone) { Mark(&Block::stale, gone.blocks); });
  bool is_all = true, any = false;
  for (auto placed = map.keyframes.rbegin(); placed != map.keyframes.rend();
       ++placed) {  // of a mapper the newest first
    const auto known = keyframes_.find(placed->key);
    const bool is_unpacked =
        known != keyframes_.end() && known->second.placed.points_in_camera == placed->points_in_camera;
    if (!is_unpacked && any && Clock::now() >= end) {
      is_all = false;
      continue;
    }
    any = any || !is_unpacked;
    ReadKeyframe(*placed, &keyframes_[placed->key]);
  }

  std::vector<double> spacings;
  const PlacedKeyframe* newest = nullptr;
  for (const auto& [key, keyframe] : keyframes_) {
    spacings.push_back(keyframe.placed.scale * keyframe.spacing);
    if (!newest || keyframe.placed.stamp_ns >= newest->stamp_ns) newest = &keyframe.placed;
  }
  camera_ = newest->world_from_cam.translation();
  const double voxel_size = coarser_ * MeshVoxelSize(std::move(spacings), map.voxel_size, voxel_size_ / coarser_);
  if (voxel_size == voxel_size_ && map.origin == origin_) return is_all;
  origin_ = map.origin;
  Restart(voxel_size);
  for (const PlacedKeyframe& placed : map.keyframes) {
    const auto known = keyframes_.find(placed.key);
    if (known == keyframes_.end() || known->second.placed.points_in_camera != placed.points_in_camera) continue;
    known->second.placed = placed;
    known->second.placed.image.reset();  // the map may let it go
  }
  return is_all;
}

void LiveMesh::ReadKeyframe(const PlacedKeyframe& placed, Keyframe* keyframe) {
  const bool other_points = placed.points_in_camera != keyframe->placed.points_in_camera;
  if (other_points) keyframe->spacing = PointSpacing(placed.points_in_camera->Unpack(), map_voxel_size_);
  if (!keyframe->waits && !HasMoved(keyframe->placed, placed, kMovedVoxels * voxel_size_)) return;
  keyframe->placed = placed;
  keyframe->placed.image.reset();
  Mark(&Block::stale, keyframe->blocks);
  keyframe->has_changed = !keyframe->waits;
  if (keyframe->blocks.empty() && !keyframe->waits) keyframe->waits = Clock::now();  // nowhere would it be made again
}

DistanceVolumeOptions LiveMesh::VolumeOptions() const {
  return {voxel_size_, options_.max_bytes - std::min(options_.max_bytes / 2, max_batch() * kFullBlockBytes),
          kMinMeshConfidence};
}

void LiveMesh::Restart(double voxel_size) {
  begins_anew_ = begins_anew_ || !blocks_.empty();
  blocks_.clear();
  batch_.reset();
  volume_.reset();
  voxel_size_ = voxel_size;
  if (voxel_size > 0) volume_ = std::make_unique<DistanceVolume>(VolumeOptions());
  for (auto& [key, keyframe] : keyframes_) {
    if (!keyframe.waits) keyframe.waits = Clock::now();
    keyframe.has_changed = false;
    keyframe.blocks.clear();
  }
}

void LiveMesh::Clear() {
  keyframes_.clear();
  Restart(0);
  map_voxel_size_ = 0;
  coarser_ = 1;
  version_.reset();
  begins_anew_ = true;
}

bool LiveMesh::AddKeyframe() {
  Keyframe* newest = nullptr;
  for (auto& [key, keyframe] : keyframes_) {
    if (keyframe.waits && (!newest || keyframe.placed.stamp_ns >= newest->placed.stamp_ns)) newest = &keyframe;
  }
  if (!newest) return false;
  const SurfaceMaps maps = SurfaceOf(newest->placed, newest->placed.scale * newest->spacing);
  if (!maps.depth.empty()) {
    newest->blocks = volume_->Integrate(maps.View());
    if (batch_) batch_->volume->Integrate(maps.View(), batch_->blocks);
    Mark(&Block::changed, newest->blocks);
  }
  newest->waits.reset();
  newest->has_changed = false;
  return true;
}

bool LiveMesh::MakeAgain() {
  if (!batch_) StartBatch();
  if (!batch_) return false;
  if (batch_->keyframes.empty()) {
    FinishBatch();
    return true;
  }
  const auto keyframe = keyframes_.find(batch_->keyframes.back());
  batch_->keyframes.pop_back();
  if (keyframe != keyframes_.end() && !keyframe->second.waits) AddToBatch(&keyframe->second);
  return true;
}

void LiveMesh::StartBatch() {
  std::vector<VolumeBlock> blocks = MostUrgent(&Block::stale, max_batch());
  if (blocks.empty()) return;
  std::sort(blocks.begin(), blocks.end());
  auto since = Clock::now();
  for (const VolumeBlock& block : blocks) since = std::min(since, *std::exchange(blocks_[block].stale, {}));
  std::vector<KeyframeKey> keyframes;
  for (auto known = keyframes_.rbegin(); known != keyframes_.rend(); ++known) {
    if (Intersect(known->second.blocks, blocks)) keyframes.push_back(known->first);
  }
  DistanceVolumeOptions options = VolumeOptions();
  options.max_bytes = max_batch() * kFullBlockBytes;
  batch_ = Batch{std::move(blocks), since, std::move(keyframes), std::make_unique<DistanceVolume>(options)};
}

void LiveMesh::AddToBatch(Keyframe* keyframe) {
  const SurfaceMaps maps = SurfaceOf(keyframe->placed, keyframe->placed.scale * keyframe->spacing);
  std::vector<VolumeBlock> seen;
  if (!maps.depth.empty()) seen = batch_->volume->Integrate(maps.View(), batch_->blocks);
  if (!keyframe->has_changed) return;
  std::vector<VolumeBlock> others;
  std::set_difference(seen.begin(), seen.end(), batch_->blocks.begin(), batch_->blocks.end(),
                      std::back_inserter(others));
  Mark(&Block::stale, others);
  keyframe->blocks = std::move(seen);
  keyframe->has_changed = false;
}

void LiveMesh::FinishBatch() {
  volume_->Replace(batch_->blocks, batch_->volume.get());
  std::vector<VolumeBlock> changed = WithNeighbours(batch_->blocks);
  const auto has_nothing = [&](const VolumeBlock& block) {
    return blocks_.count(block) == 0 && !volume_->HasVoxels(block);
  };
  changed.erase(std::remove_if(changed.begin(), changed.end(), has_nothing), changed.end());
  Mark(&Block::changed, changed);
  batch_.reset();
}

bool LiveMesh::Tell(size_t max_triangles, MeshUpdate* update) {
  constexpr size_t kAtOnce = 64, kUsualTriangles = 2000;
  size_t count = 0, expected = 0;
  std::vector<VolumeBlock> chosen = MostUrgent(&Block::changed, kAtOnce);
  for (; count < chosen.size() && (count == 0 || expected < max_triangles); ++count) {
    const Block& block = blocks_[chosen[count]];
    expected += block.triangles > 0 ? block.triangles : kUsualTriangles;
  }
  if (count == 0) return false;
  chosen.resize(count);
  std::vector<TriangleMesh> meshes = volume_->ExtractBlocks(chosen);
  size_t triangles = 0;
  for (size_t i = 0; i < count; ++i) {
    const auto place = blocks_.find(chosen[i]);
    Block& block = place->second;
    triangles += meshes[i].triangles.size();
    if (triangles > max_triangles && !update->blocks.empty()) return false;  // it waits
    block.changed.reset();
    const bool is_repeat = std::exchange(block.repeats, false);
    const bool is_told = !meshes[i].triangles.empty() || block.triangles > 0 || is_repeat;
    if (is_told && !is_repeat && !block.once) block.once = Clock::now();
    block.triangles = meshes[i].triangles.size();
    if (is_told) update->blocks.push_back({block.number, std::move(meshes[i])});
    if (block.triangles == 0 && !block.stale && !block.once) blocks_.erase(place);
  }
  return true;
}

void LiveMesh::Mark(Since Block::*since, const std::vector<VolumeBlock>& blocks) {
  const auto now = Clock::now();
  for (const VolumeBlock& place : blocks) {
    const auto [block, is_new] = blocks_.try_emplace(place);
    if (is_new) block->second.number = next_number_++;
    if (!(block->second.*since)) block->second.*since = now;
    if (block->second.repeats) block->second.once = now;  // what is told instead is told for the first time
  }
}

std::vector<VolumeBlock> LiveMesh::MostUrgent(Since Block::*since, size_t count) const {
  const auto now = Clock::now();
  const double size = kBlockVoxels * voxel_size_;
  std::vector<std::pair<double, VolumeBlock>> waiting;
  for (const auto& [place, block] : blocks_) {
    if (!(block.*since)) continue;
    const Eigen::Vector3d middle = size * (Eigen::Vector3d(place[0], place[1], place[2]).array() + 0.5);
    const double waited_s = std::chrono::duration<double>(now - *(block.*since)).count();
    waiting.emplace_back((middle - camera_).norm() / (1 + waited_s), place);
  }
  std::sort(waiting.begin(), waiting.end());
  std::vector<VolumeBlock> urgent;
  for (size_t i = 0; i < std::min(count, waiting.size()); ++i) urgent.push_back(waiting[i].second);
  return urgent;
}

bool LiveMesh::HasWork(bool make_again) const {
  if (version_ != map_->version() || begins_anew_) return true;
  const LiveMeshStatistics now = statistics();
  return now.keyframes_to_add + now.to_tell + (make_again ? now.to_make_again : 0) > 0;
}

void LiveMesh::TellAll() {
  for (auto& [place, block] : blocks_) {
    if (block.triangles > 0 && !block.changed) block.changed = Clock::now();
  }
}

bool LiveMesh::Repeat(size_t count) {
  const std::vector<VolumeBlock> repeated = MostUrgent(&Block::once, count);
  Mark(&Block::changed, repeated);
  for (const VolumeBlock& place : repeated) {
    blocks_[place].once.reset();
    blocks_[place].repeats = true;
  }
  return !repeated.empty();
}

LiveMeshStatistics LiveMesh::statistics() const {
  LiveMeshStatistics statistics;
  const auto now = Clock::now();
  auto earliest = now;
  const auto waits = [&](const Since& since) {
    if (since) earliest = std::min(earliest, *since);
    return since.has_value();
  };
  for (const auto& [key, keyframe] : keyframes_) {
    ++(waits(keyframe.waits) ? statistics.keyframes_to_add : statistics.keyframes);
  }
  for (const auto& [place, block] : blocks_) {
    statistics.blocks += block.triangles > 0 ? 1 : 0;
    statistics.triangles += block.triangles;
    statistics.to_tell += waits(block.changed) ? 1 : 0;
    statistics.to_make_again += waits(block.stale) ? 1 : 0;
  }
  if (batch_ && waits(batch_->since)) statistics.to_make_again += batch_->blocks.size();
  statistics.longest_wait_s = std::chrono::duration<double>(now - earliest).count();
  if (volume_) statistics.bytes = volume_->bytes() + (batch_ ? batch_->volume->bytes() : 0);
  statistics.voxel_size = voxel_size_;
  statistics.coarser = coarser_;
  return statistics;
}

}  // namespace acmp
