#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <acmp_mapping/GetDistances.h>
#include <acmp_mapping/KeyframePoints.h>
#include <acmp_mapping/LoadSession.h>
#include <acmp_mapping/SaveSession.h>
#include <nav_msgs/Path.h>
#include <tf2_eigen/tf2_eigen.h>
#include <boost/make_shared.hpp>
#include <pluginlib/class_list_macros.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/thread_limit.h"
#include "acmp_mapping/map/find_transform.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/diagnostics.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/mesh_output.h"
#include "acmp_mapping/ros/nodelet_base.h"
#include "acmp_mapping/ros/occupancy_output.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/session_bag.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using acmp_mapping::KeyframePoints;

constexpr char kSessionEnding[] = ".bag";
constexpr size_t kMaxMappers = 100;  ///< in diagnostics and answers; those that were silent longest are forgotten
constexpr double kMapPeriodS = 0.1;  ///< how often the map's rate limit is looked at
constexpr double kFreePeriodS = 1;   ///< how often freed memory goes back to the system
constexpr double kMeshPeriodS = 0.02;
constexpr uint32_t kPathQueue = 2;  ///< each path replaces the one before
/// A GPU may make keyframes faster than the map takes them in. Bounds the memory of those that wait, 6 MB each of
/// 540 x 360 px; more than any flush sends at once. What is lost beyond that is told.
constexpr uint32_t kKeyframeQueue = 200;

/// A rotation that is all 0 is none: what a request has where it was left out.
RigidTransform WorldFromSession(geometry_msgs::Transform transform) {
  geometry_msgs::Quaternion& q = transform.rotation;
  if (q.x == 0 && q.y == 0 && q.z == 0 && q.w == 0) q.w = 1;
  try {
    return ToTransform(transform);
  } catch (const InvalidInputError& error) {
    throw InvalidInputError(Concat("T_world_session: ", error.what()));
  }
}

}  // namespace

/// One map of the keyframes of any number of mappers: cameras of a rig, robots, hosts. Corrects it by loop closures,
/// bounds, publishes, saves and loads it. All poses are in one world, and optimized_path is of the frontend that they
/// all come from: keyframes that it has no pose for move with those that it has one for.
///
/// Threads: one for keyframes and paths, in the order of their arrival; one in which keyframes look around; one for
/// services, which also publishes the map, and one for reset; one for occupancy and distances, and one that asks for
/// these; one for the mesh; one for diagnostics; one that asks the ROS master. Services first wait for all keyframes
/// that have arrived, and until they have looked: in one process with a mapper, these are all that the mapper has
/// published.
///
/// mutex_ guards what diagnostics read, for a moment; none is held while another one is taken.
class MapServerNodelet : public NodeletBase {
 public:
  ~MapServerNodelet() override {
    if (map_output_) map_output_->Stop();
    distance_thread_.Stop();
    looking_thread_.Stop();  // first: services wait for it
    StopThreads();
    occupancy_thread_.Stop();
    mesh_thread_.Stop();
    if (unsaved_keyframes_ <= 0) return;
    const std::string text = Concat(
        "the map ends with keyframes that came after the last save_map or save_session (", unsaved_keyframes_,
        " messages). If a second launch in the same namespace has ended this one: give it another (namespace:=)");
    if (ros::ok()) {
      NODELET_WARN("%s", text.c_str());
    } else {  // the log has ended with ROS, as it does for a second launch and Ctrl-C
      std::cerr << getName() << ": " << text << std::endl;
    }
  }

 private:
  void Start() override {
    ParameterReader reader = ReadParameters();
    options_ = LoadMapServerOptions(&reader);
    WarnOfUnknown(reader);
    images_ = std::make_unique<ImageStore>(options_.save_folder);
    map_ = std::make_unique<MapStore>(options_.map);
    map_output_ = std::make_unique<MapOutput>(status_thread_.Attach(getNodeHandle()), map_.get(), options_,
                                              [this](const RejectedInput& rejected) { Report(rejected); });
    occupancy_output_ = std::make_unique<OccupancyOutput>(occupancy_thread_.Attach(getNodeHandle()), map_.get(),
                                                          options_, map_output_.get(),
                                                          [this](const RejectedInput& rejected) { Report(rejected); });
    mesh_output_ =
        std::make_unique<MeshOutput>(mesh_thread_.Attach(getNodeHandle()), map_.get(), options_, map_output_.get(),
                                     [this](const RejectedInput& rejected) { Report(rejected); });
    path_ = status_thread_.Attach(getNodeHandle()).advertise<nav_msgs::Path>(names::kKeyframePath, 1, true);
    if (!options_.load_session.empty()) {
      const std::filesystem::path path = MapPathBelow(options_.save_folder, options_.load_session, kSessionEnding);
      JoinSession(path, LoadFile(path), RigidTransform::Identity());
      NODELET_INFO("loaded %zu keyframes of %s", map_->statistics().keyframes, options_.load_session.c_str());
    }
    Subscribe();
    StartServices();
    diagnostics_ = std::make_unique<Diagnostics<MapSnapshot>>(
        &status_thread_, getNodeHandle(), getName(), [this] { return TakeSnapshot(); },
        Diagnostics<MapSnapshot>::Statuses{{"map", &DescribeMap}, {"mappers", &DescribeMappers}});
    NODELET_INFO("maps the keyframes of %s", keyframes_.getTopic().c_str());
  }

  void Subscribe() {
    ros::NodeHandle nh = input_thread_.Attach(getNodeHandle());
    keyframes_ = SubscribeChecked<KeyframePoints>(
        nh, names::kKeyframePoints, kKeyframeQueue, [this](const auto& message) { Receive(*message); },
        ros::TransportHints().tcpNoDelay());
    optimized_path_ = SubscribeChecked<nav_msgs::Path>(nh, names::kOptimizedPath, kPathQueue,
                                                       [this](const auto& message) { HandleOptimizedPath(*message); });
  }

  void StartServices() {
    AddTrigger(&urgent_thread_, names::kReset, [this] {
      CallInInputThread([this] { Forget(); });
      return "the map is empty";
    });
    AddTrigger(&service_thread_, names::kPublishMap, [this] {
      WaitForArrived();
      occupancy_output_->Request();
      return Concat("published ", map_output_->Publish(), " points");
    });
    const auto missing = [this] { return DescribeMissing(TakeSnapshot().mappers); };
    const auto save_map = [this](const auto& request, auto* response) {
      WaitForArrived();
      const int64_t unsaved = unsaved_keyframes_;
      *response = map_output_->Save(request);
      unsaved_keyframes_ -= unsaved;
    };
    AddService<acmp_mapping::SaveMap>(&service_thread_, names::kSaveMap, save_map, missing);
    const auto save_session = [this](const auto& request, auto* response) {
      WaitForArrived();
      const int64_t unsaved = unsaved_keyframes_;
      response->message = SaveSession(request.path, response);
      unsaved_keyframes_ -= unsaved;
    };
    AddService<acmp_mapping::SaveSession>(&service_thread_, names::kSaveSession, save_session, missing);
    AddService<acmp_mapping::LoadSession>(
        &service_thread_, names::kLoadSession, [this](const auto& request, auto* response) {
          const std::filesystem::path path = MapPathBelow(options_.save_folder, request.path, kSessionEnding);
          RigidTransform world_from_session = WorldFromSession(request.T_world_session);
          Session session = LoadFile(path);
          std::string where;
          if (request.find_transform) {
            if (!world_from_session.isApprox(RigidTransform::Identity())) {
              throw InvalidInputError("T_world_session and find_transform: must be one of them");
            }
            where = FindSession(path, session, &world_from_session);
          }
          for (const SessionKeyframe& keyframe : session.map.keyframes)
            response->points += keyframe.points_in_camera->size();
          response->keyframes = session.map.keyframes.size();
          CallInInputThread([&] { JoinSession(path, std::move(session), world_from_session); });
          response->T_world_session = tf2::eigenToTransform(world_from_session).transform;
          response->message = Concat("loaded ", response->keyframes, " keyframes of ", path.string(), where);
        });
    AddService<acmp_mapping::GetDistances>(
        &distance_thread_, names::kGetDistances,
        [this](const auto& request, auto* response) { *response = occupancy_output_->Answer(request); });
    publish_timer_ = service_thread_.MakeTimer(getNodeHandle(), kMapPeriodS, [this] { map_output_->PublishIfDue(); });
    occupancy_timer_ = occupancy_thread_.MakeTimer(
        getNodeHandle(), kMapPeriodS, [this] { occupancy_limit_.Run([this] { occupancy_output_->PublishIfDue(); }); });
    // Images and messages come and go between the points that stay: glibc keeps what they leave, a quarter of the
    // manager's memory.
    free_timer_ = status_thread_.MakeTimer(getNodeHandle(), kFreePeriodS, [] { malloc_trim(0); });
    mesh_timer_ = mesh_thread_.MakeTimer(getNodeHandle(), kMeshPeriodS,
                                         [this] { mesh_limit_.Run([this] { mesh_output_->PublishIfDue(); }); });
    occupancy_thread_.Start();
    distance_thread_.Start();
    mesh_thread_.Start();
    looking_thread_.Start();
  }

  std::string SaveSession(const std::string& path, acmp_mapping::SaveSession::Response* response) const {
    const std::filesystem::path file = MapPathBelow(options_.save_folder, path, kSessionEnding);
    const bool replaces = std::filesystem::exists(file);
    const Session session = {map_->Session(), map_output_->Header().frame_id};
    if (!session.map.keyframes.empty()) ClaimMapFile(file);
    WriteSession(file, session, [this] { map_output_->CheckStopped(); });
    size_t images = 0;
    for (const SessionKeyframe& keyframe : session.map.keyframes) {
      response->points += keyframe.points_in_camera->size();
      images += keyframe.image ? 1 : 0;
    }
    response->keyframes = session.map.keyframes.size();
    const size_t without = images > 0 ? response->keyframes - images : 0;
    return Concat("saved ", response->points, " points of ", response->keyframes, " keyframes to ", file.string(),
                  replaces ? kReplaced : "", without > 0 ? Concat("; ", without, " of them are without an image") : "");
  }

  /// FindTransform; says what was found. Throws InvalidInputError where that is not sure.
  std::string FindSession(const std::filesystem::path& path, const Session& session,
                          RigidTransform* world_from_session) {
    WaitForArrived();
    FoundTransform found;
    try {
      found = FindTransform(map_->Session(), session.map, [this] { map_output_->CheckStopped(); });
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat(path, ": where it lies in the map is not sure: ", error.what(),
                                     "; nothing was loaded: give T_world_session"));
    }
    *world_from_session = found.map_from_session;
    const Eigen::Vector3d& at = found.map_from_session.translation();
    return Concat("; T_world_session was found by ", found.matches, " matches, position (", at.x(), ", ", at.y(), ", ",
                  at.z(), "): of ", std::lround(100 * found.overlap), " % of its points, which the map's cameras saw, ",
                  std::lround(100 * found.agreement), " % lie on the map's surfaces");
  }

  /// Throws InvalidInputError where its images have no room: a map without them would replace the file at the next
  /// save_session.
  Session LoadFile(const std::filesystem::path& path) {
    uint64_t bytes = map_->statistics().image_bytes;
    return ReadSession(path, options_.memory_limit_bytes(), [&](const KeyframePoints& message) {
      bytes += message.image.data.size();
      if (bytes > options_.map.max_image_bytes) {
        throw InvalidInputError(Concat("no room for images beyond ", options_.map.max_image_bytes,
                                       " bytes, half of what was free on the disk of save_folder; nothing was loaded"));
      }
      return StoreImage(message, images_.get());
    });
  }

  /// Adds all keyframes or throws, see MapStore::Join. In the input thread, or before the threads start.
  void JoinSession(const std::filesystem::path& path, Session session, const RigidTransform& world_from_session) {
    const bool begins_anew = map_->statistics().keyframes == 0;
    const KeyframePose newest = session.map.keyframes.back().pose;
    try {
      map_->Join(std::move(session.map), world_from_session);
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat(path, ": ", error.what(), "; nothing was loaded"));
    }
    if (begins_anew) {
      world_frame_ = session.world_frame;
      path_frame_ = newest.path_frame;
      newest_stamp_ns_ = newest.stamp_ns;
    }
    CheckFrame(path.string(), session.world_frame);
    map_output_->SetHeader(world_frame_, newest_stamp_ns_);
    PublishPath();
  }

  void Receive(const acmp_mapping::KeyframePoints& message) {
    try {
      const KeyframePointsHead head = ReadHead(message, options_.memory_limit_bytes());
      CountMessage(head.key.mapper, message);
      CheckFrame(head.key.mapper, head.world_frame);
      adding_limit_.Run([&] { AddKeyframe(head, message); });
      ++unsaved_keyframes_;
    } catch (const std::exception& error) {  // one that leaves a callback would end the whole manager
      Report({"bad_keyframe", Concat(NameOf(message), ": ", error.what())});
    }
  }

  void CountMessage(const std::string& mapper, const acmp_mapping::KeyframePoints& message) {
    uint64_t lost = 0;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      if (mappers_.size() >= kMaxMappers && mappers_.count(mapper) == 0) {
        mappers_.erase(std::min_element(mappers_.begin(), mappers_.end(), [](const auto& a, const auto& b) {
          return a.second.last_received_s < b.second.last_received_s;
        }));
      }
      MapperTraffic& traffic = mappers_[mapper];
      // A mapper that was started again counts from the beginning.
      if (traffic.received > 0 && message.count > traffic.count) lost = message.count - traffic.count - 1;
      traffic.count = message.count;
      ++traffic.received;
      traffic.lost += lost;
      traffic.last_received_s = SteadySeconds();
      traffic.images_under_way = message.images_under_way;
    }
    if (lost > 0) Report({"keyframes_lost", Concat(lost, " messages of ", mapper, " were lost on the way")});
  }

  void CheckFrame(const std::string& whose, const std::string& world_frame) {
    if (world_frame_.empty()) world_frame_ = world_frame;
    if (world_frame == world_frame_) return;
    Report({"other_world_frame", Concat("keyframes of ", whose, " are in \"", world_frame, "\", the map is in \"",
                                        world_frame_, "\": taken as if they were in the map's")});
  }

  void AddKeyframe(const KeyframePointsHead& head, const acmp_mapping::KeyframePoints& message) {
    const PointCloud points = ToPointCloud(message.points);
    if (message.replaces) {
      map_->Replace(head.key, head.pose, points);  // where it is not in the map any more, that is counted there
      return;
    }
    if (!map_->Add(head.key, head.pose, points, KeepImage(message))) {
      return Report({"keyframe_twice", Concat("keyframe ", head.key.id, " of ", head.key.mapper,
                                              " has come already: have two mappers the same name?")});
    }
    looking_thread_.Queue([this] { looking_limit_.Run([this] { map_->LookAroundNext(); }); });
    path_frame_ = head.pose.path_frame;
    newest_stamp_ns_ = head.pose.stamp_ns;
    map_output_->SetHeader(world_frame_, newest_stamp_ns_);
    PublishPath();
  }

  /// None where it has none or it cannot be kept, which is reported. Thread-safe.
  StoredImagePtr KeepImage(const acmp_mapping::KeyframePoints& message) {
    try {
      return StoreImage(message, images_.get());
    } catch (const std::exception& error) {
      Report({"image_not_kept", Concat(NameOf(message), " is in the map without its image: ", error.what())});
      return nullptr;
    }
  }

  void HandleOptimizedPath(const nav_msgs::Path& message) {
    try {
      const OptimizedPath path =
          ToOptimizedPath(message, path_frame_, [this](const RejectedInput& rejected) { Report(rejected); });
      const ReposeResult result = map_->Repose(path.poses);
      for (const RejectedInput& doubt : {DescribeDoubt(path, result, path_frame_), DescribeTooFar(result)}) {
        if (!doubt.message.empty()) Report(doubt);
      }
      if (!result.moved.empty()) PublishPath();
    } catch (const std::exception& error) {  // one that leaves a callback would end the whole manager
      Report({"bad_optimized_path", Concat("optimized_path: ", error.what())});
    }
  }

  void PublishPath() {
    auto path = boost::make_shared<nav_msgs::Path>();
    path->header.stamp.fromNSec(static_cast<uint64_t>(newest_stamp_ns_));
    path->header.frame_id = world_frame_;
    for (const StampedPose& pose : map_->Path()) {
      path->poses.emplace_back();
      path->poses.back().header.stamp.fromNSec(static_cast<uint64_t>(pose.stamp_ns));
      path->poses.back().header.frame_id = world_frame_;
      path->poses.back().pose = tf2::toMsg(pose.pose);
    }
    path_.publish(path);
  }

  /// After all that has arrived. Throws ProcessingError when the nodelet is being unloaded, and what the function
  /// throws.
  void CallInInputThread(const std::function<void()>& function) {
    if (!input_thread_.Call(function)) throw ProcessingError("the map server is shutting down");
  }

  void WaitForArrived() {
    CallInInputThread([] {});
    if (!looking_thread_.Drain()) throw ProcessingError("the map server is shutting down");
  }

  /// Empties the map, what is known of it and of its mappers, and what is latched. In the input thread.
  void Forget() {
    map_->Clear();
    PublishPath();  // none, in the old frame: what is latched is no more
    map_output_->PublishNothing();
    world_frame_.clear();
    path_frame_.clear();
    newest_stamp_ns_ = 0;
    unsaved_keyframes_ = 0;
    std::lock_guard<std::mutex> lock(mutex_);
    mappers_.clear();
  }

  MapSnapshot TakeSnapshot() {
    MapSnapshot snapshot;
    snapshot.now_s = SteadySeconds();
    snapshot.map = map_->statistics();
    snapshot.mesh = mesh_output_->statistics();
    snapshot.mesh_listeners = mesh_output_->listeners();
    snapshot.optimized_path_topic = optimized_path_.getTopic();
    snapshot.optimized_path_publishers = optimized_path_.getNumPublishers();
    snapshot.optimized_path_is_named =
        snapshot.optimized_path_topic != Concat(names::kDefaultTopics, names::kOptimizedPath) &&
        snapshot.optimized_path_topic != getNodeHandle().resolveName(names::kOptimizedPath, false);
    snapshot.keyframe_topic = keyframes_.getTopic();
    snapshot.keyframe_publishers = keyframes_.getNumPublishers();
    snapshot.incidents = incidents_.entries();
    std::lock_guard<std::mutex> lock(mutex_);
    snapshot.mappers = mappers_;
    return snapshot;
  }

  MapServerOptions options_;
  CallbackThread occupancy_thread_{report_failure_}, distance_thread_{report_failure_}, mesh_thread_{report_failure_},
      looking_thread_{report_failure_};
  static constexpr int kThreads = 2;  ///< each of what follows: mappers have work to do
  ThreadLimit adding_limit_{kThreads}, looking_limit_{kThreads}, mesh_limit_{kThreads}, occupancy_limit_{kThreads};
  std::unique_ptr<ImageStore> images_;
  std::unique_ptr<MapStore> map_;
  std::unique_ptr<MapOutput> map_output_;
  std::unique_ptr<OccupancyOutput> occupancy_output_;
  std::unique_ptr<MeshOutput> mesh_output_;

  std::mutex mutex_;
  std::map<std::string, MapperTraffic> mappers_;
  std::atomic<int64_t> unsaved_keyframes_{0};  ///< messages since the last save_map, save_session or reset

  // Used by the input thread alone.
  std::string world_frame_;      ///< of the first keyframe, or of the session that an empty map began with
  std::string path_frame_;       ///< of the last keyframe
  int64_t newest_stamp_ns_ = 0;  ///< of the last keyframe

  ros::Subscriber keyframes_;
  ros::Subscriber optimized_path_;
  ros::Publisher path_;
  ros::WallTimer publish_timer_, occupancy_timer_, mesh_timer_, free_timer_;
  std::unique_ptr<Diagnostics<MapSnapshot>> diagnostics_;
};

}  // namespace acmp

PLUGINLIB_EXPORT_CLASS(acmp::MapServerNodelet, nodelet::Nodelet)
