#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <acmp_mapping/KeyframePoints.h>
#include <acmp_mapping/SaveSession.h>
#include <nav_msgs/Path.h>

#include "acmp_mapping/ros/diagnostics.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/nodelet_base.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/session_bag.h"

namespace acmp {

/// One map of the keyframes of any number of mappers: cameras of a rig, robots, hosts. Corrects it by loop closures,
/// bounds, publishes, saves and loads it. All poses are in one world, and optimized_path is of the frontend that they
/// all come from: keyframes that it has no pose for move with those that it has one for.
///
/// Threads: one for keyframes and paths, in the order of their arrival; one in which keyframes look around; one for
/// services, which also publishes the map, and one for reset; one for occupancy; one for diagnostics; one that asks the
/// ROS master. Services first wait for all keyframes that have arrived, and until they have looked: in one process with
/// a mapper, these are all that the mapper has published.
///
/// mutex_ guards what diagnostics read, for a moment; none is held while another one is taken.
class MapServerNodelet : public NodeletBase {
 public:
  ~MapServerNodelet() override;

 private:
  void Start() override;
  void Subscribe();
  void StartServices();
  std::string SaveSession(const std::string& path, acmp_mapping::SaveSession::Response* response) const;
  /// FindTransform; says what was found. Throws InvalidInputError where that is not sure.
  std::string FindSession(const std::filesystem::path& path, const Session& session,
                          RigidTransform* world_from_session);
  Session LoadFile(const std::filesystem::path& path);
  /// Adds all keyframes or throws, see MapStore::Join. In the input thread, or before the threads start.
  void JoinSession(const std::filesystem::path& path, Session session, const RigidTransform& world_from_session);
  void Receive(const acmp_mapping::KeyframePoints& message);
  void CountMessage(const std::string& mapper, const acmp_mapping::KeyframePoints& message);
  void CheckFrame(const std::string& whose, const std::string& world_frame);
  void AddKeyframe(const KeyframePointsHead& head, const acmp_mapping::KeyframePoints& message);
  /// None where it has none or it cannot be kept, which is reported. Thread-safe.
  StoredImagePtr KeepImage(const acmp_mapping::KeyframePoints& message);
  void HandleOptimizedPath(const nav_msgs::Path& message);
  void PublishPath();
  /// After all that has arrived. Throws ProcessingError when the nodelet is being unloaded, and what the function
  /// throws.
  void CallInInputThread(const std::function<void()>& function);
  void WaitForArrived();
  /// Empties the map, what is known of it and of its mappers, and what is latched. In the input thread.
  void Forget();
  MapSnapshot TakeSnapshot();

  MapServerOptions options_;
  CallbackThread occupancy_thread_{report_failure_}, looking_thread_{report_failure_};
  std::unique_ptr<ImageStore> images_;
  std::unique_ptr<MapStore> map_;
  std::unique_ptr<MapOutput> map_output_;

  std::mutex mutex_;
  std::map<std::string, MapperTraffic> mappers_;

  // Used by the input thread alone.
  std::map<std::string, uint64_t> counts_;  ///< of each mapper's last message
  std::string world_frame_;                 ///< of the first keyframe, or of the session that an empty map began with
  std::string path_frame_;                  ///< of the last keyframe
  int64_t newest_stamp_ns_ = 0;             ///< of the last keyframe

  ros::Subscriber keyframes_;
  ros::Subscriber optimized_path_;
  ros::Publisher path_;
  ros::WallTimer publish_timer_, occupancy_timer_;
  std::unique_ptr<Diagnostics<MapSnapshot>> diagnostics_;
};

}  // namespace acmp
