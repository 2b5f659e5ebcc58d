#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "acmp_mapping/fusion/packed_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/map/image_store.h"
#include "acmp_mapping/map/loop_correction.h"

namespace acmp {

struct MapStoreOptions {
  /// Captures of all mappers together (a wide image is one, with a keyframe for each face); those that came first go
  /// first, 1..1000000.
  int max_keyframes = 500;
  double voxel_size = 0;  ///< unit of the poses, >= 0; 0 = kAutoVoxelRatio of the first keyframe's median depth
  /// Unit of the poses, >= 0; keyframes farther than this from the newest one of every mapper go; 0 = no limit.
  double map_radius = 0;
  bool forget_earlier_runs = false;  ///< a mapper's keyframes go when it begins a new run
  /// That images may take together: when it is more, every second one goes, of all keyframes alike.
  uint64_t max_image_bytes = std::numeric_limits<uint64_t>::max();
};

constexpr double kAutoVoxelRatio = 0.005;  ///< about 2.5 px of a 500 px focal length

/// Greatest distance of a keyframe's points from the map's local origin, in voxels: a little less than VoxelFilter
/// takes.
constexpr double kMaxMapVoxels = 2e9;
/// The same of the world's origin: a first keyframe whose points are closer to the camera than that allows, as of a
/// frontend that starts with a tiny scale, must not choose the voxel size of all that follow.
constexpr double kMaxOriginVoxels = kMaxMapVoxels;
/// A map whose first keyframe is within so many voxels of the world's origin needs no other one: float32 knows 1/256
/// voxel there. Beyond, its local origin is where that keyframe stands, in whole steps, so that it seldom changes.
constexpr double kNearVoxels = 1 << 16;
constexpr double kOriginStepVoxels = 1 << 14;

/// A correction that moves points by less than about a thousandth of a voxel is none: nobody sees it, and a map of many
/// points takes seconds to build. The angle is what moves points by that at 200 voxels, the median depth with
/// kAutoVoxelRatio.
constexpr double kSamePoseVoxels = 1e-3;
constexpr double kSamePoseRad = 5e-6;

constexpr size_t kMaxLookedAt = 16;  ///< keyframes, by one that is added: bounds its time

/// Which keyframe of which mapper.
struct KeyframeKey {
  std::string mapper;
  uint64_t run = 0;  ///< of the mapper, see MapStore
  uint64_t id = 0;   ///< grows with time within a run

  bool operator<(const KeyframeKey& other) const {
    return std::tie(mapper, run, id) < std::tie(other.mapper, other.run, other.id);
  }
  bool operator==(const KeyframeKey& other) const {
    return std::tie(mapper, run, id) == std::tie(other.mapper, other.run, other.id);
  }
};

/// A capture's place in time and space, and the keyframe's in it.
struct KeyframePose {
  int64_t stamp_ns = 0;
  RigidTransform world_from_capture = RigidTransform::Identity();  ///< as received, or where the mapper put it
  PathConvention path;
  std::string path_frame = {};  ///< frame of the poses of optimized_path; empty: any
  /// Of the capture; none: the mapper took the pose as received.
  std::optional<RefinedAndReceived> refined = {};

  std::string camera_frame = {};  ///< name of the optical frame
  PinholeCamera camera = {};      ///< of the keyframe's maps
  uint64_t view = 0;              ///< number in its capture, whose first keyframe has the id KeyframeKey::id - view
  RigidTransform capture_from_cam = RigidTransform::Identity();  ///< constant, unit of the received poses

  const RigidTransform& received() const { return refined ? refined->received : world_from_capture; }
  RigidTransform world_from_cam() const { return world_from_capture * capture_from_cam; }
};

/// How many later keyframes saw a surface where a point is, and how many saw through it (a free-space violation in
/// Merrell et al., Real-Time Visibility-Based Fusion of Depth Maps, ICCV 2007); 255 at most.
struct LaterViews {
  uint8_t confirming = 0;
  uint8_t through = 0;
};

/// A keyframe as it goes to a file and comes back.
struct SessionKeyframe {
  KeyframeKey key;
  KeyframePose pose;                ///< as in use
  PackedCloudPtr points_in_camera;  ///< scaled as in use
  StoredImagePtr image = nullptr;   ///< or none
};

/// All of a map, for another one.
struct MapSession {
  std::vector<SessionKeyframe> keyframes;  ///< in the order in which they came, those of earlier runs first
  size_t earlier = 0;                      ///< so many are of earlier runs: loop closures leave them alone
  double voxel_size = 0;                   ///< the points are one per voxel; 0: there are none
};

struct MapStatistics {
  size_t keyframes = 0;
  size_t points = 0;                             ///< held, all keyframes together
  size_t yet_to_look = 0;                        ///< keyframes that LookAroundNext has not come to
  double voxel_size = 0;                         ///< in use; 0 = not known yet
  double smallest_scale = 1, largest_scale = 1;  ///< that loop closures gave keyframes, and 1
  // Since the last Clear:
  size_t evicted = 0;            ///< keyframes that made room for later ones
  size_t evicted_by_radius = 0;  ///< keyframes that were farther than map_radius away
  size_t evicted_by_run = 0;     ///< keyframes of earlier runs that were not kept
  size_t replaced = 0;           ///< keyframes that got better points
  size_t not_replaced = 0;       ///< better points of keyframes that were not in the map
  size_t paths = 0;              ///< given to Repose
  size_t corrections = 0;        ///< paths that moved keyframes
  size_t reposed = 0;            ///< keyframes moved, summed over the corrections
  size_t path_poses = 0;         ///< of the last path
  size_t path_unmatched = 0;     ///< of these, poses that belong to no keyframe
  size_t looked_through = 0;     ///< points that later keyframes saw through, and that have gone
  size_t never_looked = 0;       ///< keyframes that left before LookAroundNext came to them
  size_t path_too_far = 0;       ///< keyframes that it would have put too far away, and left
  size_t images = 0;             ///< keyframes with an image
  uint64_t image_bytes = 0;      ///< of these
  uint64_t image_stride = 1;     ///< one in so many captures of a mapper keeps its images
};

/// A keyframe's points and where they lie; the points are shared and never change.
struct PlacedKeyframe {
  RigidTransform world_from_cam = RigidTransform::Identity();  ///< in use
  double scale = 1;                                            ///< of the points' positions, before they are moved
  PackedCloudPtr points_in_camera;
  int64_t stamp_ns = 0;
  KeyframeKey key = {};
  PinholeCamera camera = {};       ///< of the keyframe's maps
  StoredImagePtr image = nullptr;  ///< or none
};

/// All of a map at one moment, in coordinates that float32 holds: those of the world less `origin` (LocalOrigin).
struct PlacedKeyframes {
  std::vector<PlacedKeyframe> keyframes;  ///< by mapper and run, each in the order of ids; poses in local coordinates
  double voxel_size = 0;                  ///< the points are one per voxel; 0: not known yet, no points
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< of the local coordinates, in the world
};

/// Whether a keyframe has other points, or some of them lie elsewhere by more than a tolerance (local coordinates).
bool HasMoved(const PlacedKeyframe& before, const PlacedKeyframe& now, double tolerance);

/// Erases what somebody keeps of keyframes that are not among those of a map (any more), each after a call of `leave`.
template <class Kept, class Function>
void EraseGone(const std::vector<PlacedKeyframe>& present, std::map<KeyframeKey, Kept>* kept, const Function& leave) {
  std::set<KeyframeKey> keys;
  for (const PlacedKeyframe& keyframe : present) keys.insert(keyframe.key);
  for (auto known = kept->begin(); known != kept->end();) {
    if (keys.count(known->first) > 0) {
      ++known;
    } else {
      leave(known->second);
      known = kept->erase(known);
    }
  }
}

/// The points of a map.
struct MapCloud {
  PointCloud points;                                 ///< local coordinates, axes of the world
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< of the local coordinates, in the world
  size_t keyframes = 0;                              ///< that they are of
};
/// All keyframes' points, one per voxel. Takes time in proportion to them.
MapCloud CloudOf(const PlacedKeyframes& map);

/// The map of any number of mappers in one world: the fused points of each keyframe in its own camera frame, thinned to
/// one per voxel, with the keyframe's pose. So a pose can be corrected later without matching or touching a point.
/// Thread-safe: one mutex guards the list and is held for a moment only, and clouds are immutable and shared, so that
/// building a map holds up nobody.
///
/// A mapper's keyframes form runs: a new one begins when its images go back in time, its frontend goes on in another
/// world, or the mapper forgets everything. It may be in another world. Loop closures concern the last run of each
/// mapper, and leave earlier ones alone though stamps may be the same.
///
/// Keyframes with refined poses are placed along the trajectory that the frontend gave, as corrected (PlaceAlong), anew
/// whenever the map is read: so later keyframes and loop closures also tell where earlier ones lie.
///
/// A keyframe with a later stamp, added before or after, removes the points of an earlier one that it sees through
/// (TakeLaterView). Each keyframe looks once, at as many as kMaxLookedAt around it. That takes
/// longer than to add it, and may be done later (LookAroundNext): the map comes to be the same.
///
/// The map does not depend on the order in which keyframes of different mappers come, but for what the limits of the
/// options evict and the voxel size that the first keyframe chooses.
class MapStore {
 public:
  explicit MapStore(const MapStoreOptions& options);

  /// Add and Replace belong to one thread. Another run than that of the mapper's last keyframe is a new one. False, and
  /// nothing is changed, for a keyframe that is in the map already. Throws InvalidInputError for points that
  /// VoxelFilter refuses, that have no positive median depth, or that lie too far from the map's local origin
  /// (kMaxMapVoxels) or with it from the world's (kMaxOriginVoxels).
  /// @param image undistorted, or none
  bool Add(const KeyframeKey& key, const KeyframePose& pose, const PointCloud& points_in_camera,
           StoredImagePtr image = nullptr);
  /// Better points of a keyframe in the map, and the refined pose that they belong to, if there is one: of `pose` only
  /// that is taken. False, and nothing is changed, where the keyframe is not there (any more). Throws as Add.
  bool Replace(const KeyframeKey& key, const KeyframePose& pose, const PointCloud& points_in_camera);
  /// Lets the keyframe that was added first, of those that have not, look at the points of those around it that are
  /// earlier, and later ones at its own (TakeLaterView). In any one thread. False when none was left.
  bool LookAroundNext();
  void Clear();

  /// All of the map. What loop closures have changed is as if it had been received so; points that they have scaled
  /// are rounded to float32 once more.
  MapSession Session() const;
  /// Adds all keyframes of another map, or none: throws InvalidInputError that names what cannot be used, above all a
  /// keyframe that is in the map already, more than max_keyframes or max_image_bytes, or what Add refuses. In the
  /// thread of Add.
  ///
  /// An empty map becomes what the other one was: its points are left as they are unless options.voxel_size is another
  /// one, and loop closures correct what they corrected there. In a map that has keyframes they count as earlier
  /// runs, and their points are thinned to its voxel size where that is another one.
  /// @param world_from_session applied to the keyframes' poses
  void Join(MapSession session, const RigidTransform& world_from_session);

  /// Corrects poses after a loop closure, see Repose in loop_correction.h: all mappers' last runs are taken for one
  /// trajectory, since cameras of a rig share the path. It also counts for keyframes that come later, until a mapper
  /// begins a new run. Only poses and scales change: takes microseconds per keyframe. An empty path does nothing.
  /// Keyframes never go farther than kMaxMapVoxels from the map's local origin: one such pose would make the whole map
  /// unusable.
  ReposeResult Repose(std::vector<StampedPose> path);

  /// The map: CloudOf all keyframes.
  MapCloud WorldCloud() const;

  /// The keyframes at the poses in use.
  PlacedKeyframes Placed() const;

  /// Poses in use (T_world_cam) of all captures: by mapper and run, in the order of ids.
  std::vector<StampedPose> Path() const;

  MapStatistics statistics() const;

  /// Changes whenever the map does.
  uint64_t version() const;

 private:
  /// What LookAroundNext needs of a keyframe as it was added: it may be replaced before.
  struct ToLook {
    KeyframeKey key;
    KeyframePose as_sent;
    PackedCloudPtr points_in_camera;
    std::vector<KeyframeKey> around;  ///< at most kMaxLookedAt
  };
  struct Capture {
    uint64_t arrival = 0;  ///< of its first keyframe to come: no other capture has the same
    uint64_t number = 0;   ///< of its mapper's captures
    bool joined = false;   ///< by Join: stays when its mapper begins a new run
    size_t keyframes = 0;  ///< of it, in the map
    CorrectedPose pose;
  };
  struct Keyframe {
    Capture* capture = nullptr;  ///< in captures_: to be read with the mutex
    uint64_t arrival = 0;
    KeyframePose as_sent;
    double reach = 0;  ///< as CorrectedPose::reach
    PackedCloudPtr points_in_camera;
    std::shared_ptr<const std::vector<LaterViews>> later_views;  ///< one per point; null: nobody has looked
    uint64_t points_arrival = 0;
    StoredImagePtr image;
  };
  using Keyframes = std::map<KeyframeKey, Keyframe>;

  /// What is read without the mutex.
  struct Snapshot {
    struct Member {
      KeyframeKey key;
      Keyframe keyframe;
      Capture capture;
      bool is_of_last_run = false;
    };
    std::vector<Member> keyframes;  ///< by mapper and run, each in the order of ids
    double voxel_size = 0;
    double max_distance = 0;
    Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  };
  Snapshot TakeSnapshot() const;
  /// World from capture, and the scale of its points, of each keyframe: refined ones along their trajectory; what would
  /// lie too far away stays where its mapper put it.
  static std::vector<Similarity> Place(const Snapshot& snapshot);

  /// A keyframe's points, one per voxel.
  struct ThinnedPoints {
    PackedCloudPtr points;
    double reach = 0;       ///< distance of the farthest from the camera
    double voxel_size = 0;  ///< the map's, or that of the points where it has none; 0: there are no points either
  };
  ThinnedPoints Thinned(const PointCloud& points) const;

  // All of these need the mutex.
  std::vector<KeyframeKey> Around(const KeyframeKey& key) const;
  double MaxDistance() const;  ///< from Origin
  /// Of the local coordinates: about where the first capture stands. @param world_from_capture of the first one to come
  Eigen::Vector3d Origin(double voxel_size,
                         const RigidTransform& world_from_capture = RigidTransform::Identity()) const;
  const Capture* Oldest() const;  ///< null: there is none
  bool IsOfLastRun(const KeyframeKey& key) const;
  void CheckCanJoin(const MapSession& session) const;
  double VoxelSize() const { return options_.voxel_size > 0 ? options_.voxel_size : auto_voxel_size_; }
  /// @param added not in the map yet
  Keyframe& Insert(SessionKeyframe added, double reach);
  void StartRun(const std::string& mapper, uint64_t run);
  ReposeResult ApplyPath();
  void Evict();
  /// Keeps images within max_image_bytes: those of every second, fourth... capture of each mapper, and at last not the
  /// newest one.
  void ThinImages(Keyframe* newest);
  template <class Predicate>
  size_t EraseIf(const Predicate& is_to_go);
  Keyframes::iterator Erase(Keyframes::const_iterator keyframe);

  const MapStoreOptions options_;
  mutable std::mutex mutex_;
  double auto_voxel_size_ = 0;
  Keyframes keyframes_;
  std::map<KeyframeKey, Capture> captures_;            ///< of these, each by the key of its first keyframe
  std::map<std::string, uint64_t> runs_;               ///< the last one of each mapper
  std::map<std::string, uint64_t> num_captures_come_;  ///< of each mapper
  uint64_t arrivals_ = 0;
  std::deque<ToLook> to_look_;  ///< in the order in which they came
  uint64_t image_stride_ = 1;
  std::vector<StampedPose> path_;  ///< the last one of these runs, sorted
  MapStatistics statistics_;       ///< all but the numbers of keyframes and the voxel size
  uint64_t version_ = 0;
};

}  // namespace acmp
