#include "acmp_mapping/map/map_store.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/fusion/voxel_map.h"
#include "acmp_mapping/geometry/local_origin.h"

namespace acmp {
namespace {

constexpr size_t kMaxRuns = 200;  ///< of mappers, also of those that have nothing in the map

/// Of a cloud that is not empty.
double MedianDepth(const PointCloud& points) {
  std::vector<float> depths(points.size());
  std::transform(points.begin(), points.end(), depths.begin(), [](const SurfacePoint& p) { return p.position.z; });
  return Median(std::move(depths));
}

double ReachOf(const PointCloud& points) {
  double reach = 0;
  for (const SurfacePoint& point : points) {
    const Vec3f& p = point.position;
    reach = std::max(reach, Eigen::Vector3d(p.x, p.y, p.z).norm());
  }
  return reach;
}

/// The same from the capture's camera, at most.
double ReachInCapture(double reach, const KeyframePose& pose) {
  return reach + pose.capture_from_cam.translation().norm();
}

/// Throws unless a keyframe's points are within kMaxMapVoxels of the map's origin, and near enough to the world's.
/// @param voxel_size 0: not known, any distance is right
void CheckDistance(const RigidTransform& world_from_capture, double reach, const Eigen::Vector3d& origin,
                   double voxel_size) {
  if (voxel_size == 0) return;
  const Eigen::Vector3d& position = world_from_capture.translation();
  const auto check = [&](double distance, const char* from, double max_voxels) {
    if (distance <= max_voxels * voxel_size) return;
    throw InvalidInputError(Concat("position (", position.x(), ", ", position.y(), ", ", position.z(),
                                   "), points up to ", reach, " away: must lie within ", max_voxels * voxel_size,
                                   " of ", from, " (", max_voxels, " voxels of ", voxel_size, ")"));
  };
  check(position.norm() + reach, "the world's origin", kMaxOriginVoxels);
  check((position - origin).norm() + reach, "the map's first keyframe", kMaxMapVoxels);
}

std::string NameOf(const KeyframeKey& key) {
  return Concat("keyframe ", key.id, " of \"", key.mapper, "\", run ", key.run);
}

KeyframeKey CaptureKey(const KeyframeKey& key, const KeyframePose& pose) {
  return {key.mapper, key.run, key.id - pose.view};
}

}  // namespace

MapStore::MapStore(const MapStoreOptions& options) : options_(options) {}

MapStore::ThinnedPoints MapStore::Thinned(const PointCloud& points) const {
  ThinnedPoints thinned;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    thinned.voxel_size = VoxelSize();
  }
  if (points.empty()) {
    thinned.points = std::make_shared<const PackedCloud>();
    return thinned;
  }
  if (thinned.voxel_size == 0) {
    const double depth = MedianDepth(points);
    if (!(depth > 0)) throw InvalidInputError(Concat("median depth of the points = ", depth, ": must be > 0"));
    thinned.voxel_size = kAutoVoxelRatio * depth;
  }
  const PointCloud means = VoxelFilter(points, static_cast<float>(thinned.voxel_size));
  thinned.points = std::make_shared<const PackedCloud>(means);
  thinned.reach = ReachOf(means);
  return thinned;
}

double MapStore::MaxDistance() const {
  return VoxelSize() > 0 ? kMaxMapVoxels * VoxelSize() : std::numeric_limits<double>::infinity();
}

Eigen::Vector3d MapStore::Origin(double voxel_size, const RigidTransform& world_from_capture) const {
  const Capture* first = Oldest();
  const RigidTransform& place = first ? first->pose.world_from_capture : world_from_capture;
  return voxel_size == 0 ? Eigen::Vector3d::Zero()
                         : LocalOrigin(place.translation(), kNearVoxels * voxel_size, kOriginStepVoxels * voxel_size);
}

const MapStore::Capture* MapStore::Oldest() const {
  const auto oldest = std::min_element(captures_.begin(), captures_.end(), [](const auto& a, const auto& b) {
    return a.second.arrival < b.second.arrival;
  });
  return oldest == captures_.end() ? nullptr : &oldest->second;
}

bool MapStore::Add(const KeyframeKey& key, const KeyframePose& pose, const PointCloud& points_in_camera,
                   StoredImagePtr image) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (keyframes_.count(key) > 0) return false;
    StartRun(key.mapper, key.run);  // first: what it evicts may have chosen the voxel size
  }
  ThinnedPoints thinned = Thinned(points_in_camera);
  std::lock_guard<std::mutex> lock(mutex_);
  const double reach = ReachInCapture(thinned.reach, pose), voxel_size = thinned.voxel_size;
  CheckDistance(pose.world_from_capture, reach, Origin(voxel_size, pose.world_from_capture), voxel_size);
  if (const auto known = captures_.find(CaptureKey(key, pose)); known != captures_.end()) {  // which may lie elsewhere
    const CorrectedPose& place = known->second.pose;
    CheckDistance(place.world_from_capture, place.scale * reach, Origin(voxel_size), voxel_size);
  }
  auto_voxel_size_ = thinned.voxel_size;  // not before: what is refused tells nothing about the scene
  Keyframe& inserted = Insert({key, pose, std::move(thinned.points), std::move(image)}, reach);
  ApplyPath();
  Evict();
  ++version_;
  if (keyframes_.count(key) == 0) return true;  // out of map_radius
  ThinImages(&inserted);
  std::vector<KeyframeKey> around = Around(key);
  if (!around.empty()) to_look_.push_back({key, pose, inserted.points_in_camera, std::move(around)});
  return true;
}

MapStore::Keyframe& MapStore::Insert(SessionKeyframe added, double reach) {
  Keyframe& keyframe = keyframes_[added.key];
  keyframe.arrival = keyframe.points_arrival = arrivals_++;
  const auto [found, is_new] = captures_.try_emplace(CaptureKey(added.key, added.pose));
  Capture& capture = found->second;
  if (is_new) {
    capture.arrival = keyframe.arrival;
    capture.number = num_captures_come_[added.key.mapper]++;
    capture.pose.stamp_ns = added.pose.stamp_ns;
    capture.pose.path = added.pose.path;
    capture.pose.received = capture.pose.world_from_capture = added.pose.received();
  }
  ++capture.keyframes;
  capture.pose.reach = std::max(capture.pose.reach, reach);
  keyframe.capture = &capture;
  keyframe.reach = reach;
  keyframe.as_sent = std::move(added.pose);
  statistics_.points += added.points_in_camera->size();
  keyframe.points_in_camera = std::move(added.points_in_camera);
  keyframe.image = std::move(added.image);
  return keyframe;
}

void MapStore::StartRun(const std::string& mapper, uint64_t run) {
  const auto [last, is_new_mapper] = runs_.try_emplace(mapper, run);
  if (is_new_mapper && runs_.size() > kMaxRuns) {  // those of mappers that have nothing in the map
    std::set<std::string> present = {mapper};
    for (const auto& [key, keyframe] : keyframes_) present.insert(key.mapper);
    const auto forget = [&](auto* of_mappers) {
      for (auto one = of_mappers->begin(); one != of_mappers->end();) {
        one = present.count(one->first) == 0 ? of_mappers->erase(one) : std::next(one);
      }
    };
    forget(&runs_);
    forget(&num_captures_come_);
  }
  if (is_new_mapper || last->second == run) return;
  last->second = run;
  path_.clear();
  if (!options_.forget_earlier_runs) return;
  statistics_.evicted_by_run += EraseIf([&](const KeyframeKey& key, const Capture& capture) {
    return key.mapper == mapper && key.run != run && !capture.joined;
  });
  if (keyframes_.empty()) auto_voxel_size_ = 0;  // another scene may have another scale
}

bool MapStore::Replace(const KeyframeKey& key, const KeyframePose& pose, const PointCloud& points_in_camera) {
  {
    std::lock_guard<std::mutex> lock(mutex_);  // refused points tell nothing about the scene
    if (keyframes_.count(key) == 0) {
      ++statistics_.not_replaced;
      return false;
    }
  }
  ThinnedPoints thinned = Thinned(points_in_camera);
  std::lock_guard<std::mutex> lock(mutex_);
  const auto keyframe = keyframes_.find(key);
  if (keyframe == keyframes_.end()) {
    ++statistics_.not_replaced;
    return false;
  }
  CorrectedPose& corrected = keyframe->second.capture->pose;
  const double reach = ReachInCapture(thinned.reach, keyframe->second.as_sent);
  CheckDistance(corrected.world_from_capture, corrected.scale * reach,
                Origin(thinned.voxel_size, corrected.world_from_capture), thinned.voxel_size);
  auto_voxel_size_ = thinned.voxel_size;
  keyframe->second.reach = reach;
  corrected.reach = std::max(corrected.reach, reach);
  keyframe->second.as_sent.world_from_capture = pose.refined ? pose.world_from_capture : corrected.received;
  keyframe->second.as_sent.refined = pose.refined;
  PackedCloudPtr& points = keyframe->second.points_in_camera;
  statistics_.points += thinned.points->size();
  statistics_.points -= points->size();
  points = std::move(thinned.points);
  keyframe->second.later_views.reset();
  keyframe->second.points_arrival = arrivals_++;
  ++statistics_.replaced;
  ++version_;
  return true;
}

ReposeResult MapStore::Repose(std::vector<StampedPose> path) {
  if (path.empty()) return {};
  std::stable_sort(path.begin(), path.end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.stamp_ns < b.stamp_ns; });
  std::lock_guard<std::mutex> lock(mutex_);
  path_ = std::move(path);
  ++statistics_.paths;
  ReposeResult result = ApplyPath();
  if (!result.moved.empty()) {
    ++statistics_.corrections;
    statistics_.reposed += result.moved.size();
    Evict();
  }
  return result;
}

bool MapStore::IsOfLastRun(const KeyframeKey& key) const {
  const auto last = runs_.find(key.mapper);
  return last != runs_.end() && last->second == key.run;
}

ReposeResult MapStore::ApplyPath() {
  if (path_.empty()) return {};
  std::vector<CorrectedPose*> trajectory;
  for (auto& [key, capture] : captures_) {
    if (!IsOfLastRun(key)) continue;
    capture.pose.trajectory = static_cast<size_t>(std::distance(runs_.begin(), runs_.find(key.mapper)));
    trajectory.push_back(&capture.pose);
  }
  std::stable_sort(trajectory.begin(), trajectory.end(),
                   [](const CorrectedPose* a, const CorrectedPose* b) { return a->stamp_ns < b->stamp_ns; });
  const PoseTolerance same = {kSamePoseVoxels * VoxelSize(), kSamePoseRad, kSamePoseRad};
  ReposeResult result = acmp::Repose(path_, same, {Origin(VoxelSize()), MaxDistance()}, trajectory);
  statistics_.path_poses = path_.size();
  statistics_.path_unmatched = result.unmatched;
  statistics_.path_too_far = result.too_far;
  if (!result.moved.empty()) ++version_;
  return result;
}

void MapStore::Evict() {
  if (options_.map_radius > 0) {
    std::map<std::string, Eigen::Vector3d> newest;  // of each mapper
    for (const auto& [key, capture] : captures_) {
      if (IsOfLastRun(key)) newest[key.mapper] = capture.pose.world_from_capture.translation();
    }
    statistics_.evicted_by_radius += EraseIf([&](const KeyframeKey&, const Capture& capture) {
      const Eigen::Vector3d& position = capture.pose.world_from_capture.translation();
      return std::none_of(newest.begin(), newest.end(),
                          [&](const auto& camera) { return (position - camera.second).norm() <= options_.map_radius; });
    });
  }
  while (captures_.size() > static_cast<size_t>(options_.max_keyframes)) {
    const Capture* oldest = Oldest();
    statistics_.evicted += EraseIf([&](const KeyframeKey&, const Capture& capture) { return &capture == oldest; });
  }
}

void MapStore::ThinImages(Keyframe* newest) {
  const auto largest_stride = static_cast<uint64_t>(options_.max_keyframes);  // which leaves one of each mapper
  for (;; image_stride_ *= 2) {
    uint64_t bytes = 0;
    for (auto& [key, keyframe] : keyframes_) {
      if (keyframe.image && keyframe.capture->number % image_stride_ != 0) keyframe.image.reset();
      bytes += keyframe.image ? keyframe.image->bytes() : 0;
    }
    if (bytes <= options_.max_image_bytes) return;
    if (image_stride_ >= largest_stride) return newest->image.reset();
  }
}

template <class Predicate>
size_t MapStore::EraseIf(const Predicate& is_to_go) {
  const size_t before = keyframes_.size();
  for (auto keyframe = keyframes_.begin(); keyframe != keyframes_.end();) {
    keyframe = is_to_go(keyframe->first, *keyframe->second.capture) ? Erase(keyframe) : std::next(keyframe);
  }
  return before - keyframes_.size();
}

MapStore::Keyframes::iterator MapStore::Erase(Keyframes::const_iterator keyframe) {
  statistics_.points -= keyframe->second.points_in_camera->size();
  const auto has_gone = [&](const ToLook& look) { return look.key == keyframe->first; };
  const auto left = std::remove_if(to_look_.begin(), to_look_.end(), has_gone);
  statistics_.never_looked += left == to_look_.end() ? 0 : 1;
  to_look_.erase(left, to_look_.end());
  ++version_;
  if (--keyframe->second.capture->keyframes == 0) {
    captures_.erase(CaptureKey(keyframe->first, keyframe->second.as_sent));
  }
  return keyframes_.erase(keyframe);
}

void MapStore::Clear() {
  std::lock_guard<std::mutex> lock(mutex_);
  keyframes_.clear();
  captures_.clear();
  runs_.clear();
  path_.clear();
  to_look_.clear();
  auto_voxel_size_ = 0;
  num_captures_come_.clear();
  image_stride_ = 1;
  statistics_ = {};
  ++version_;
}

void MapStore::CheckCanJoin(const MapSession& session) const {
  std::set<KeyframeKey> captures;
  for (const auto& [key, pose, points, image] : session.keyframes) captures.insert(CaptureKey(key, pose));
  if (captures.size() + captures_.size() > static_cast<size_t>(options_.max_keyframes)) {
    throw InvalidInputError(Concat(captures.size(), " keyframes, and ", captures_.size(),
                                   " are in the map: together at most max_keyframes = ", options_.max_keyframes,
                                   "; raise it"));
  }
  uint64_t image_bytes = 0;
  for (const auto& [key, keyframe] : keyframes_) image_bytes += keyframe.image ? keyframe.image->bytes() : 0;
  for (const SessionKeyframe& keyframe : session.keyframes) image_bytes += keyframe.image ? keyframe.image->bytes() : 0;
  if (image_bytes > options_.max_image_bytes) {
    throw InvalidInputError(Concat("its images and those in the map take ", image_bytes, " bytes: at most ",
                                   options_.max_image_bytes, ", half of what was free on the disk of save_folder"));
  }
  std::set<KeyframeKey> keys;
  for (const SessionKeyframe& keyframe : session.keyframes) {
    if (!keys.insert(keyframe.key).second) throw InvalidInputError(Concat(NameOf(keyframe.key), " comes twice"));
    if (captures_.count(CaptureKey(keyframe.key, keyframe.pose)) == 0) continue;
    throw InvalidInputError(Concat(
        NameOf(keyframe.key), " is in the map already: to go back to what was saved, empty the map first (reset)"));
  }
}

void MapStore::Join(MapSession session, const RigidTransform& world_from_session) {
  double voxel_size = options_.voxel_size;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  CheckRange("voxel_size", session.voxel_size, 0.0, 1e6);
  {
    std::lock_guard<std::mutex> lock(mutex_);
    CheckCanJoin(session);
    if (voxel_size == 0 && !keyframes_.empty()) voxel_size = auto_voxel_size_;
    if (voxel_size == 0) voxel_size = session.voxel_size;
    if (!session.keyframes.empty()) {
      origin = Origin(voxel_size, world_from_session * session.keyframes.front().pose.world_from_capture);
    }
  }
  std::vector<double> reaches;
  std::map<KeyframeKey, RigidTransform> places;  // of captures
  for (SessionKeyframe& keyframe : session.keyframes) {
    try {
      keyframe.pose.world_from_capture = world_from_session * keyframe.pose.world_from_capture;
      if (keyframe.pose.refined) keyframe.pose.refined->received = world_from_session * keyframe.pose.refined->received;
      PointCloud points = keyframe.points_in_camera->Unpack();
      if (!points.empty()) CheckPoints(points, static_cast<float>(voxel_size));
      if (!points.empty() && voxel_size != session.voxel_size) {
        points = VoxelFilter(points, static_cast<float>(voxel_size));
        keyframe.points_in_camera = std::make_shared<const PackedCloud>(points);
      }
      reaches.push_back(ReachInCapture(ReachOf(points), keyframe.pose));
      const RigidTransform& own = keyframe.pose.world_from_capture;
      const RigidTransform& first = places.try_emplace(CaptureKey(keyframe.key, keyframe.pose), own).first->second;
      for (const RigidTransform& place : {own, first}) CheckDistance(place, reaches.back(), origin, voxel_size);
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat(NameOf(keyframe.key), ": ", error.what()));
    }
  }
  std::lock_guard<std::mutex> lock(mutex_);
  const bool begins_anew = keyframes_.empty();
  if (begins_anew) {
    path_.clear();
    runs_.clear();
  }
  if (options_.voxel_size == 0) auto_voxel_size_ = voxel_size;
  for (size_t i = 0; i < reaches.size(); ++i) {
    SessionKeyframe& keyframe = session.keyframes[i];
    if (begins_anew && i >= session.earlier) runs_.insert_or_assign(keyframe.key.mapper, keyframe.key.run);
    Insert(std::move(keyframe), reaches[i]).capture->joined = true;
  }
  ++version_;
}

MapStatistics MapStore::statistics() const {
  std::lock_guard<std::mutex> lock(mutex_);
  MapStatistics statistics = statistics_;
  statistics.keyframes = keyframes_.size();
  statistics.voxel_size = VoxelSize();
  statistics.image_stride = image_stride_;
  statistics.yet_to_look = to_look_.size();
  for (const auto& [key, keyframe] : keyframes_) {
    statistics.images += keyframe.image ? 1 : 0;
    statistics.image_bytes += keyframe.image ? keyframe.image->bytes() : 0;
    statistics.smallest_scale = std::min(statistics.smallest_scale, keyframe.capture->pose.scale);
    statistics.largest_scale = std::max(statistics.largest_scale, keyframe.capture->pose.scale);
  }
  return statistics;
}

uint64_t MapStore::version() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return version_;
}

// What is read of a map: a copy of the list, so that mappers go on meanwhile.

MapStore::Snapshot MapStore::TakeSnapshot() const {
  std::lock_guard<std::mutex> lock(mutex_);
  Snapshot snapshot;
  snapshot.voxel_size = VoxelSize();
  snapshot.max_distance = MaxDistance();
  snapshot.origin = Origin(snapshot.voxel_size);
  snapshot.keyframes.reserve(keyframes_.size());
  for (const auto& [key, keyframe] : keyframes_) {
    snapshot.keyframes.push_back({key, keyframe, *keyframe.capture, IsOfLastRun(key)});
  }
  return snapshot;
}

std::vector<Similarity> MapStore::Place(const Snapshot& snapshot) {
  std::vector<Similarity> placed;
  placed.reserve(snapshot.keyframes.size());
  std::vector<TrajectoryKeyframe> trajectory;  // of one run
  std::vector<size_t> members;
  const auto place_trajectory = [&] {
    const std::vector<std::optional<Similarity>> along = PlaceAlong(trajectory);
    for (size_t i = 0; i < along.size(); ++i) {
      if (!along[i]) continue;
      const double reach = along[i]->scale * snapshot.keyframes[members[i]].keyframe.reach;
      const Eigen::Vector3d offset = along[i]->rigid.translation() - snapshot.origin;
      if (offset.norm() + reach <= snapshot.max_distance) placed[members[i]] = *along[i];
    }
    trajectory.clear(), members.clear();
  };
  const KeyframeKey* last = nullptr;
  for (const auto& [key, keyframe, capture, is_of_last_run] : snapshot.keyframes) {
    if (last && (last->mapper != key.mapper || last->run != key.run)) place_trajectory();
    last = &key;
    if (keyframe.as_sent.refined) {
      trajectory.push_back({static_cast<int64_t>(capture.arrival),
                            {keyframe.as_sent.refined->refined, capture.pose.world_from_capture}});
      members.push_back(placed.size());
    }
    placed.push_back(capture.pose.Placed(keyframe.as_sent.world_from_capture));
  }
  place_trajectory();
  return placed;
}

MapSession MapStore::Session() const {
  const Snapshot snapshot = TakeSnapshot();
  const std::vector<Similarity> placed = Place(snapshot);
  MapSession session;
  session.voxel_size = snapshot.voxel_size;
  std::map<std::pair<bool, uint64_t>, size_t> order;
  for (size_t i = 0; i < placed.size(); ++i) {
    const Snapshot::Member& member = snapshot.keyframes[i];
    order.try_emplace({member.is_of_last_run, member.keyframe.arrival}, i);
    session.earlier += member.is_of_last_run ? 0 : 1;
  }
  for (const auto& [rank, i] : order) {
    const auto& [key, keyframe, capture, is_of_last_run] = snapshot.keyframes[i];
    SessionKeyframe saved = {key, keyframe.as_sent, keyframe.points_in_camera, keyframe.image};
    const double scale = placed[i].scale;
    saved.pose.world_from_capture = placed[i].rigid;
    saved.pose.capture_from_cam.translation() *= scale;
    if (saved.pose.refined) {
      saved.pose.refined->received = capture.pose.world_from_capture;
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
  const std::vector<Similarity> world_from_captures = Place(snapshot);
  PlacedKeyframes placed = {{}, snapshot.voxel_size, snapshot.origin};
  for (size_t i = 0; i < world_from_captures.size(); ++i) {
    const auto& [key, keyframe, capture, is_of_last_run] = snapshot.keyframes[i];
    RigidTransform world_from_cam = world_from_captures[i].Moved(keyframe.as_sent.capture_from_cam);
    world_from_cam.translation() -= snapshot.origin;
    placed.keyframes.push_back({world_from_cam, world_from_captures[i].scale, keyframe.points_in_camera,
                                capture.pose.stamp_ns, key, keyframe.as_sent.camera, keyframe.image});
  }
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
  const std::vector<Similarity> placed = Place(snapshot);
  std::vector<StampedPose> path;
  for (size_t i = 0; i < placed.size(); ++i) {
    const Capture& capture = snapshot.keyframes[i].capture;
    if (i > 0 && capture.arrival == snapshot.keyframes[i - 1].capture.arrival) continue;
    path.push_back({capture.pose.stamp_ns, placed[i].rigid});
  }
  return path;
}

}  // namespace acmp
