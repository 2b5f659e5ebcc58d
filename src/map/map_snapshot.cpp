// What is read of a map: a copy of the list, so that mappers go on meanwhile.

#include <utility>
#include <vector>

#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/map/map_store.h"

namespace acmp {

MapStore::Snapshot MapStore::TakeSnapshot() const {
  std::lock_guard<std::mutex> lock(mutex_);
  Snapshot snapshot;
  snapshot.voxel_size = VoxelSize();
  snapshot.max_distance = MaxDistance();
  snapshot.origin = Origin(snapshot.voxel_size);
  snapshot.keyframes.reserve(keyframes_.size());
  for (const auto& [key, keyframe] : keyframes_) snapshot.keyframes.push_back({key, keyframe, IsOfLastRun(key)});
  return snapshot;
}

std::vector<PlacedKeyframe> MapStore::Place(const Snapshot& snapshot) {
  std::vector<PlacedKeyframe> placed;
  placed.reserve(snapshot.keyframes.size());
  std::vector<TrajectoryKeyframe> trajectory;  // of one run
  std::vector<size_t> members;
  const auto place_trajectory = [&] {
    const std::vector<std::optional<PlacedCamera>> cameras = PlaceAlong(trajectory);
    for (size_t i = 0; i < cameras.size(); ++i) {
      if (!cameras[i]) continue;
      const double reach = cameras[i]->scale * snapshot.keyframes[members[i]].keyframe.pose.reach;
      const Eigen::Vector3d offset = cameras[i]->world_from_cam.translation() - snapshot.origin;
      if (!(offset.norm() + reach <= snapshot.max_distance)) continue;
      placed[members[i]].world_from_cam = cameras[i]->world_from_cam;
      placed[members[i]].scale = cameras[i]->scale;
    }
    trajectory.clear(), members.clear();
  };
  const KeyframeKey* last = nullptr;
  for (const auto& [key, keyframe, is_of_last_run] : snapshot.keyframes) {
    if (last && (last->mapper != key.mapper || last->run != key.run)) place_trajectory();
    last = &key;
    const CorrectedPose& pose = keyframe.pose;
    if (keyframe.as_sent.refined) {
      trajectory.push_back({pose.stamp_ns, {keyframe.as_sent.refined->refined, pose.world_from_cam}});
      members.push_back(placed.size());
    }
    placed.push_back({pose.Placed(keyframe.as_sent.world_from_cam), pose.scale, keyframe.points_in_camera,
                      pose.stamp_ns, key, keyframe.as_sent.camera, keyframe.image});
  }
  place_trajectory();
  return placed;
}

MapSession MapStore::Session() const {
  const Snapshot snapshot = TakeSnapshot();
  const std::vector<PlacedKeyframe> placed = Place(snapshot);
  MapSession session;
  session.voxel_size = snapshot.voxel_size;
  std::map<std::pair<bool, uint64_t>, size_t> order;
  for (size_t i = 0; i < placed.size(); ++i) {
    const auto& [key, keyframe, is_of_last_run] = snapshot.keyframes[i];
    order.try_emplace({is_of_last_run, keyframe.arrival}, i);
    session.earlier += is_of_last_run ? 0 : 1;
  }
  for (const auto& [rank, i] : order) {
    const Keyframe& keyframe = snapshot.keyframes[i].keyframe;
    SessionKeyframe saved = {snapshot.keyframes[i].key, keyframe.as_sent, keyframe.points_in_camera, keyframe.image};
    const double scale = placed[i].scale;
    saved.pose.world_from_cam = placed[i].world_from_cam;
    if (saved.pose.refined) {
      saved.pose.refined->received = keyframe.pose.world_from_cam;
      saved.pose.refined->refined.scale *= scale;
    }
    if (scale != 1) {
      saved.points_in_camera = std::make_shared<const PackedCloud>(Scaled(saved.points_in_camera->Unpack(), scale));
    }
    session.keyframes.push_back(std::move(saved));
  }
  return session;
}

PlacedKeyframes MapStore::Placed() const {
  const Snapshot snapshot = TakeSnapshot();
  PlacedKeyframes placed = {Place(snapshot), snapshot.voxel_size, snapshot.origin};
  for (PlacedKeyframe& keyframe : placed.keyframes) keyframe.world_from_cam.translation() -= snapshot.origin;
  return placed;
}

bool HasMoved(const PlacedKeyframe& before, const PlacedKeyframe& now, double tolerance) {
  if (before.points_in_camera != now.points_in_camera) return true;
  const PackedCloud& points = *now.points_in_camera;
  const auto moves = [&](const Eigen::Vector3d& p) {
    return (now.world_from_cam * (now.scale * p) - before.world_from_cam * (before.scale * p)).norm() > tolerance;
  };
  if (moves(Eigen::Vector3d::Zero())) return true;
  constexpr size_t kSome = 16;
  for (size_t i = 0; i < points.size(); i += 1 + points.size() / kSome) {
    const Vec3f p = points[i].position;
    if (moves({p.x, p.y, p.z})) return true;
  }
  return false;
}

MapCloud MapStore::WorldCloud() const { return CloudOf(Placed()); }

MapCloud CloudOf(const PlacedKeyframes& map) {
  std::vector<PlacedCloud<PackedCloud>> clouds;
  for (const PlacedKeyframe& keyframe : map.keyframes) {
    if (keyframe.points_in_camera->empty()) continue;
    clouds.push_back({keyframe.world_from_cam, keyframe.points_in_camera.get(), keyframe.scale});
  }
  MapCloud cloud = {{}, map.origin, map.keyframes.size()};
  if (!clouds.empty()) cloud.points = MergeClouds(clouds, static_cast<float>(map.voxel_size));
  return cloud;
}

std::vector<StampedPose> MapStore::Path() const {
  const Snapshot snapshot = TakeSnapshot();
  const std::vector<PlacedKeyframe> placed = Place(snapshot);
  std::vector<StampedPose> path;
  for (size_t i = 0; i < placed.size(); ++i) {
    const auto key = [&](size_t k) -> const KeyframeKey& { return snapshot.keyframes[k].key; };
    if (i > 0 && IsSameCapture(key(i - 1), placed[i - 1].stamp_ns, key(i), placed[i].stamp_ns)) continue;
    path.push_back({placed[i].stamp_ns, placed[i].world_from_cam});
  }
  return path;
}

}  // namespace acmp
