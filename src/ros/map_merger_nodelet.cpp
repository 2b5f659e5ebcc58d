#include "acmp_mapping/ros/map_merger_nodelet.h"

#include <cmath>

#include <pluginlib/class_list_macros.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/ros/mapper_diagnostics.h"
#include "acmp_mapping/ros/optimized_path.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using acmp_mapping::KeyframePoints;
using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;

constexpr double kPeriodS = 0.1;
constexpr uint32_t kPathQueue = 2;     ///< each path replaces the one before
constexpr uint32_t kQueue = 200;       ///< keyframes; building a map does not hold them up
constexpr double kRecentS = 5;         ///< incidents that young are worth a word, as in MapperDiagnostics
constexpr double kShardTimeoutS = 10;  ///< keyframes wait so long for an earlier one

}  // namespace

MapMergerNodelet::~MapMergerNodelet() {
  input_thread_.Stop();
  service_thread_.Stop();
  status_thread_.Stop();
  if (master_watch_) master_watch_->Stop();
}

void MapMergerNodelet::onInit() {
  try {
    LoadOptions();
    map_ = std::make_unique<MapStore>(options_.map);
    map_output_ = std::make_unique<MapOutput>(status_thread_.Attach(getNodeHandle()), map_.get());
    last_progress_s_ = SteadySeconds();
    const boost::function<void(const acmp_mapping::KeyframePointsConstPtr&)> receive =
        [this](const acmp_mapping::KeyframePointsConstPtr& keyframe) { Receive(keyframe); };
    subscriber_ = input_thread_.Attach(getNodeHandle())
                      .subscribe<KeyframePoints>(names::kKeyframePoints, kQueue, receive, ros::VoidConstPtr(),
                                                 ros::TransportHints().tcpNoDelay());
    StartServices();
    ros::NodeHandle nh = status_thread_.Attach(getNodeHandle());
    const boost::function<void(const nav_msgs::PathConstPtr&)> correct = [this](const nav_msgs::PathConstPtr& path) {
      HandleOptimizedPath(*path);
    };
    optimized_path_ = nh.subscribe(names::kOptimizedPath, kPathQueue, correct);
    updater_ = std::make_unique<diagnostic_updater::Updater>(nh, getPrivateNodeHandle(), getName());
    updater_->setHardwareID("none");
    updater_->add("map", [this](DiagnosticStatusWrapper& status) {
      MapperSnapshot snapshot;
      snapshot.now_s = SteadySeconds();
      snapshot.map = map_->statistics();
      snapshot.optimized_path_topic = optimized_path_.getTopic();
      snapshot.optimized_path_publishers = optimized_path_.getNumPublishers();
      snapshot.path_doubts = path_doubts_.entries();
      DescribeMap(snapshot, &status);
    });
    updater_->add("shards", [this](DiagnosticStatusWrapper& status) { DescribeShards(&status); });
    status_timer_ =
        nh.createWallTimer(ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { updater_->force_update(); });
    master_watch_ = std::make_unique<MasterWatch>(
        getNodeHandle(), [this](const std::string& news) { NODELET_WARN("%s", news.c_str()); });
    for (CallbackThread* thread : {&input_thread_, &service_thread_, &status_thread_}) thread->Start();
    master_watch_->Start();
  } catch (const std::exception& error) {
    NODELET_FATAL("cannot start: %s", error.what());
    throw;
  }
  NODELET_INFO("merging the keyframes of %s", subscriber_.getTopic().c_str());
}

void MapMergerNodelet::LoadOptions() {
  XmlRpc::XmlRpcValue values;
  getPrivateNodeHandle().getParam(getPrivateNodeHandle().getNamespace(), values);
  ParameterReader reader(values);
  reader.Allow("diagnostic_period");   // diagnostic_updater
  reader.Allow("num_worker_threads");  // a nodelet manager of the same name
  options_ = LoadMapServerOptions(&reader);
  poses_ = LoadNodeOptions(&reader);
  for (const std::string& warning : reader.DescribeUnknown()) NODELET_WARN("%s", warning.c_str());
}

void MapMergerNodelet::StartServices() {
  MapperServices::Handlers handlers;
  handlers.reset = [this] { return Reset(); };
  handlers.publish_map = [this] {
    GiveUp();
    const size_t points = map_output_->Publish();
    return Concat("published ", points, " points");
  };
  handlers.save_map = [this](const acmp_mapping::SaveMap::Request& request) {
    GiveUp();
    return map_output_->Save(request);
  };
  handlers.periodic = [this] { HandlePeriod(); };
  services_ = std::make_unique<MapperServices>(service_thread_.Attach(getPrivateNodeHandle()), kPeriodS, handlers);
}

void MapMergerNodelet::Receive(const acmp_mapping::KeyframePointsConstPtr& keyframe) {
  if (keyframe->shard_index >= keyframe->shard_count) {
    return ReportDrop({"bad_keyframe", Concat("keyframe ", keyframe->number, ": shard_index = ", keyframe->shard_index,
                                              ", must be below shard_count = ", keyframe->shard_count)});
  }
  std::lock_guard<std::mutex> lock(mutex_);
  if (shard_count_ != 0 && keyframe->shard_count != shard_count_) {
    ReportDrop({"shard_count_mismatch",
                Concat("shard ", keyframe->shard_index, " counts ", keyframe->shard_count, " shards, another ",
                       shard_count_, ": ~shard_count must be the same everywhere")});
  }
  shard_count_ = keyframe->shard_count;
  Shard& shard = shards_[keyframe->shard_index];
  shard.last_received_s = last_progress_s_ = SteadySeconds();
  ++(keyframe->dropped.empty() ? shard.mapped : shard.dropped);
  if (!keyframe->dropped.empty()) {
    ReportDrop({keyframe->dropped, Concat("shard ", keyframe->shard_index, " dropped keyframe ", keyframe->number)});
  }
  Take(sequence_.Add(keyframe));
}

void MapMergerNodelet::Take(const KeyframeSequence::Result& result) {
  for (const Drop& drop : result.drops) ReportDrop(drop);
  for (const auto& keyframe : result.keyframes) {
    if (!keyframe->dropped.empty()) continue;
    try {
      AddToMap(*keyframe);
    } catch (const std::exception& error) {
      ReportDrop({"bad_keyframe",
                  Concat("keyframe ", keyframe->number, " of shard ", keyframe->shard_index, ": ", error.what())});
    }
  }
}

void MapMergerNodelet::AddToMap(const KeyframePoints& keyframe) {
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.matrix().topRows<3>() =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(keyframe.T_world_cam.data());
  CheckPose("T_world_cam", world_from_cam);
  const auto stamp_ns = static_cast<int64_t>(keyframe.header.stamp.toNSec());
  if (keyframe.number >= newest_number_) {
    // Between jumps keyframes get their numbers in the order of their stamps.
    if (stamp_ns < newest_stamp_ns_) {
      if (options_.on_time_jump == TimeJumpPolicy::kReset) {
        map_->Clear();
      } else {
        map_->StartRun();
      }
    }
    newest_number_ = keyframe.number;
    newest_stamp_ns_ = stamp_ns;
    world_frame_ = keyframe.header.frame_id;
    map_output_->SetHeader(keyframe.header.frame_id, stamp_ns);
  }
  map_->AddPoints(static_cast<int64_t>(keyframe.number), stamp_ns, world_from_cam, ToPointCloud(keyframe.points));
}

void MapMergerNodelet::HandleOptimizedPath(const nav_msgs::Path& path) {
  std::string world_frame;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    world_frame = world_frame_;
  }
  const auto on_doubt = [this](const Drop& doubt) {
    if (path_doubts_.Record(doubt, SteadySeconds())) {
      NODELET_WARN("%s: %s", doubt.reason.c_str(), doubt.message.c_str());
    }
  };
  ApplyOptimizedPath(
      path, world_frame,
      [this](const RigidTransform& received) { return WorldFromCamera(PathSemantics(poses_), received); },
      poses_.matcher.sync_tolerance_s, map_.get(), [this](const Drop& drop) { ReportDrop(drop); }, on_doubt);
}

void MapMergerNodelet::GiveUp() {
  std::lock_guard<std::mutex> lock(mutex_);
  Take(sequence_.GiveUp());
}

void MapMergerNodelet::HandlePeriod() {
  bool late = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    late = sequence_.held() > 0 && SteadySeconds() - last_progress_s_ > kShardTimeoutS;
  }
  if (late) GiveUp();
  try {
    map_output_->PublishIfDue(options_.map_publish_rate);
  } catch (const std::exception& error) {  // a thrown exception would end the whole manager
    ReportDrop({"map_error", Concat("the map was not published: ", error.what())});
  }
}

std::string MapMergerNodelet::Reset() {
  std::lock_guard<std::mutex> lock(mutex_);
  sequence_.Clear();
  map_->Clear();
  return "the map is empty";
}

void MapMergerNodelet::ReportDrop(const Drop& drop) {
  if (drops_.Record(drop, SteadySeconds())) NODELET_WARN("%s: %s", drop.reason.c_str(), drop.message.c_str());
}

void MapMergerNodelet::DescribeShards(DiagnosticStatusWrapper* status) {
  const double now_s = SteadySeconds();
  std::lock_guard<std::mutex> lock(mutex_);
  status->summary(DiagnosticStatus::OK, Concat("keyframes of ", shards_.size(), " shards"));
  if (shards_.empty()) {
    status->summary(DiagnosticStatus::WARN, Concat("nothing yet on ", subscriber_.getTopic(), " (",
                                                   subscriber_.getNumPublishers(), " publisher(s))"));
  }
  for (int index = 0; index < shard_count_; ++index) {
    const auto found = shards_.find(index);
    if (found == shards_.end()) {
      status->mergeSummary(DiagnosticStatus::WARN, Concat("nothing yet from shard ", index, " of ", shard_count_));
      continue;
    }
    const Shard& shard = found->second;
    status->add(Concat("shard ", index),
                Concat(shard.mapped, " keyframes mapped, ", shard.dropped, " dropped, the last ",
                       std::lround(now_s - shard.last_received_s), " s ago"));
  }
  status->add("keyframes that wait for an earlier one", sequence_.held());
  status->add("keyframes missing", sequence_.missing());
  for (const auto& [reason, entry] : drops_.entries()) {
    status->add("incidents: " + reason, Concat(entry.count, " (", entry.last_message, ")"));
    if (now_s - entry.last_time_s < kRecentS) {
      status->mergeSummary(DiagnosticStatus::WARN, Concat(reason, ": ", entry.last_message));
    }
  }
}

}  // namespace acmp

PLUGINLIB_EXPORT_CLASS(acmp::MapMergerNodelet, nodelet::Nodelet)
