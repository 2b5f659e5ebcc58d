#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>

#include "acmp_mapping/intake/input_matcher.h"
#include "acmp_mapping/map/live_mesh.h"
#include "acmp_mapping/map/map_store.h"
#include "acmp_mapping/ros/callback_thread.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {

/// Publishes statuses that are all made of one snapshot on /diagnostics, once a second of wall time, so that a paused
/// or jumping clock does not silence them. Not by diagnostic_updater's Updater, which computes with ROS time and a
/// parameter that anybody may set, and throws for most of their values.
template <class Snapshot>
class Diagnostics {
 public:
  using Describe = void (*)(const Snapshot&, diagnostic_updater::DiagnosticStatusWrapper*);
  using Statuses = std::vector<std::pair<const char*, Describe>>;  ///< names, and what describes each

  /// @param name of the nodelet, with its slash
  Diagnostics(CallbackThread* thread, const ros::NodeHandle& nh, const std::string& name,
              std::function<Snapshot()> take_snapshot, Statuses statuses)
      : name_(name.substr(1)),
        take_snapshot_(std::move(take_snapshot)),
        statuses_(std::move(statuses)),
        publisher_(thread->Attach(nh).template advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 1)),
        timer_(thread->MakeTimer(nh, 1.0, [this] { Publish(); })) {}

 private:
  void Publish() {
    diagnostic_msgs::DiagnosticArray message;
    message.header.stamp = ros::Time::now();  // first: what happened before the stamp is in the snapshot
    const Snapshot snapshot = take_snapshot_();
    for (const auto& [status_name, describe] : statuses_) {
      diagnostic_updater::DiagnosticStatusWrapper status;
      status.name = name_ + ": " + status_name;
      status.hardware_id = "none";
      describe(snapshot, &status);
      message.status.push_back(status);
    }
    publisher_.publish(message);
  }

  const std::string name_;
  const std::function<Snapshot()> take_snapshot_;
  const Statuses statuses_;
  ros::Publisher publisher_;
  ros::WallTimer timer_;
};

/// Everything diagnostics are made of, taken at one moment.
struct MapperSnapshot {
  double now_s = 0;  ///< the clock of all the times below
  bool paused = false;
  std::vector<InputStatus> inputs;
  size_t waiting_images = 0;
  std::string waiting_for;  ///< what images wait for in vain; empty = all is well
  size_t queued = 0;
  uint64_t images_dropped = 0;  ///< drops that ended an image
  uint64_t matched = 0;         ///< keyframes handed to the worker
  uint64_t not_chosen = 0;      ///< posed images that the keyframe gate passed over
  std::optional<PoseGap> last_gap;
  PoseUse pose_use;
  double sync_tolerance_s = 0;
  std::optional<double> points_in_front;  ///< share of the first keyframes' sparse points, 0..1
  std::string convention_warning;         ///< why poses are probably read wrongly; empty: they are not
  WorkerStatus worker;
  uint32_t maps = 0;         ///< nodes that listen to keyframe_points
  uint64_t points_sent = 0;  ///< messages sent to them
  std::map<std::string, IncidentLog::Entry> drops;
};

/// Of what waits, and of poses. @param snapshot has the time
void AddIntake(const KeyframeIntake& intake, MapperSnapshot* snapshot);

/// Before what images say of the reading of the poses.
constexpr char kPosesDoNotFit[] = "poses do not fit the images";

/// Images that were received and have had no end yet: they wait for a pose, for the worker or for later keyframes.
uint64_t ImagesUnderWay(const MapperSnapshot& snapshot);

/// Every image that came is in one of these: "112 received = 90 refined + 12 dropped + 6 passed over + 4 under way".
std::string AccountForImages(const MapperSnapshot& snapshot);

/// Why images were dropped, most first: " (12 no_pose, 3 overload)"; empty: none was.
std::string DescribeDrops(const MapperSnapshot& snapshot);

/// For the log and the status: where images show clearly more radial distortion than their calibration tells; empty:
/// they do not.
/// @param shift_px of a pixel 0.7 of the way from the middle to the corner, outwards
/// @param width of the images, px
std::string DescribeDistortion(double shift_px, int width, const LensDistortion& told);

/// For the log and the status: less than that, but enough to cost depth, with the coefficients that `calibration_file`
/// should have; empty: nothing to tell.
/// @param calibration of a model that can have radial distortion
std::string DescribeCameraErrors(const CameraErrors& errors, const CameraCalibration& calibration);

/// The same about PoseChecks::stamp_offset_s.
std::string DescribeStampOffset(double offset_s);

/// For the log: the required inputs that never came or fell silent while others go on, and what images wait for in
/// vain. Empty: nothing, also when all have fallen silent, as after a recording, and while paused.
std::string DescribeMissing(const MapperSnapshot& snapshot);

/// One status each, without a master: "inputs", "matching", "mapping".
void DescribeInputs(const MapperSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);
void DescribeMatching(const MapperSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);
void DescribeMapping(const MapperSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);

/// What has come from one mapper since the map was last emptied.
struct MapperTraffic {
  uint64_t received = 0;  ///< messages
  uint64_t lost = 0;      ///< messages on the way
  double last_received_s = 0;
  uint64_t images_under_way = 0;  ///< not finished when it sent its last message
  uint64_t count = 0;             ///< of that message
};

/// Everything the map server's diagnostics are made of, taken at one moment.
struct MapSnapshot {
  double now_s = 0;  ///< steady clock, as of all the times below
  MapStatistics map;
  LiveMeshStatistics mesh;
  uint32_t mesh_listeners = 0;
  std::string optimized_path_topic;
  uint32_t optimized_path_publishers = 0;
  bool optimized_path_is_named = false;  ///< by the user, as InputStatus::is_named
  std::string keyframe_topic;
  uint32_t keyframe_publishers = 0;
  std::map<std::string, MapperTraffic> mappers;  ///< by name
  std::map<std::string, IncidentLog::Entry> incidents;
};

/// What of the images is not in the map: for each mapper how many messages of points were lost on the way, and how many
/// images were under way when its last one was sent; empty when there is nothing.
std::string DescribeMissing(const std::map<std::string, MapperTraffic>& mappers);

/// One status each, without a master: "map" and "mappers".
void DescribeMap(const MapSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);
void DescribeMappers(const MapSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);

}  // namespace acmp
