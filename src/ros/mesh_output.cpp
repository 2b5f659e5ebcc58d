#include "acmp_mapping/ros/mesh_output.h"

#include <utility>

#include <visualization_msgs/MarkerArray.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using visualization_msgs::Marker;
using visualization_msgs::MarkerArray;

/// Of messages that a slow listener has not read, 6 MB each by default; then roscpp drops the oldest
/// (MeshOutput::HasWork).
constexpr uint32_t kMeshQueue = 20;

Marker MakeMarker(int action, int id, const std_msgs::Header& header) {
  Marker marker;
  marker.header = header;
  marker.ns = names::kMesh;
  marker.id = id;
  marker.action = action;
  marker.type = Marker::TRIANGLE_LIST;
  marker.pose.orientation.w = 1;
  marker.scale.x = marker.scale.y = marker.scale.z = 1;
  marker.color.a = 1;
  return marker;
}

Marker ToMarker(const MeshUpdate::Block& block, const std_msgs::Header& header) {
  const bool is_gone = block.mesh.triangles.empty();
  Marker marker = MakeMarker(is_gone ? Marker::DELETE : Marker::ADD, block.number, header);
  marker.points.reserve(3 * block.mesh.triangles.size());
  marker.colors.reserve(3 * block.mesh.triangles.size());
  for (const auto& triangle : block.mesh.triangles) {
    for (uint32_t corner : triangle) {
      const auto& [position, normal, color, label, confidence] = block.mesh.vertices[corner];
      geometry_msgs::Point point;
      point.x = position.x, point.y = position.y, point.z = position.z;
      marker.points.push_back(point);
      std_msgs::ColorRGBA rgba;
      rgba.r = static_cast<float>(color.r) / 255, rgba.g = static_cast<float>(color.g) / 255;
      rgba.b = static_cast<float>(color.b) / 255, rgba.a = 1;
      marker.colors.push_back(rgba);
    }
  }
  return marker;
}

}  // namespace

MeshOutput::MeshOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options, MapOutput* map_output,
                       std::function<void(const RejectedInput&)> report)
    : options_(options), map_output_(map_output), report_(std::move(report)), mesh_(map, options.mesh()) {
  if (options.mesh_rate <= 0) return;
  publisher_ = nh.advertise<MarkerArray>(names::kMesh, kMeshQueue,
                                         [this](const ros::SingleSubscriberPublisher&) { is_new_listener_ = true; });
}

bool MeshOutput::HasWork(bool make_again) {
  constexpr size_t kRepeatedBlocks = 4;
  if (mesh_.HasWork(make_again)) return true;
  if (mesh_.HasWork() || !MayRepeat()) return false;
  if (deleted_once_ && !deletes_) {
    deletes_ = true;
    mesh_.TellAll();
    return true;
  }
  return mesh_.Repeat(kRepeatedBlocks);
}

bool MeshOutput::MayRepeat() {
  constexpr double kRepeatRate = 1;  // Hz
  if (!repeat_pace_.IsTime()) return false;
  repeat_pace_.Begin();
  repeat_pace_.End(kRepeatRate);
  return true;
}

void MeshOutput::PublishIfDue() {
  if (listeners() == 0) {
    if (std::exchange(is_listened_to_, false)) mesh_.Clear();
    return;
  }
  is_listened_to_ = true;
  if (!pace_.IsTime()) return;
  const std_msgs::Header header = map_output_->Header();
  if (header.frame_id.empty()) return PublishNothing();
  if (std::exchange(is_new_listener_, false)) mesh_.TellAll();
  const bool make_again = again_pace_.IsTime();
  if (!HasWork(make_again)) return;
  constexpr double kMaxShare = 1;  // of the time; mesh_time bounds it
  pace_.Begin();
  if (make_again) again_pace_.Begin();
  const double coarser = mesh_.statistics().coarser;
  try {
    Publish(mesh_.Update(make_again), header);
  } catch (...) {  // what counts as told may not be
    mesh_.Clear();
    pace_.End(options_.mesh_rate, kMaxShare);
    throw;
  }
  pace_.End(options_.mesh_rate, kMaxShare);
  if (make_again) again_pace_.End(options_.mesh_rate);
  const LiveMeshStatistics now = mesh_.statistics();
  if (now.coarser > coarser) {
    report_(
        {"mesh_coarse", Concat("mesh: voxels are ", now.voxel_size, " wide in place of ", now.voxel_size / now.coarser,
                               ", which would take more than ~mesh_memory = ", options_.mesh_memory_gb, " GB")});
  }
  std::lock_guard<std::mutex> lock(statistics_mutex_);
  statistics_ = now;
}

void MeshOutput::PublishNothing() {
  if (header_.frame_id.empty() || (deleted_once_ && !MayRepeat())) return;
  auto message = boost::make_shared<MarkerArray>();
  message->markers.push_back(MakeMarker(Marker::DELETEALL, 0, header_));
  publisher_.publish(message);
  if (deleted_once_) header_ = {};
  deleted_once_ = !deleted_once_;
  mesh_.Clear();
  std::lock_guard<std::mutex> lock(statistics_mutex_);
  statistics_ = mesh_.statistics();
}

void MeshOutput::Publish(const MeshUpdate& update, std_msgs::Header header) {
  if (!update.anew && update.blocks.empty()) return;
  auto message = boost::make_shared<MarkerArray>();
  const bool deletes = (update.anew && !header_.frame_id.empty()) || deletes_;
  if (deletes) {
    message->markers.push_back(MakeMarker(Marker::DELETEALL, 0, header_));
    deleted_once_ = !std::exchange(deletes_, false);
  }
  if (!update.blocks.empty()) {
    map_output_->EnterLocalFrame(update.origin, &header);
    header_ = header;
  }
  for (const MeshUpdate::Block& block : update.blocks) message->markers.push_back(ToMarker(block, header));
  if (!message->markers.empty()) publisher_.publish(message);
}

LiveMeshStatistics MeshOutput::statistics() const {
  std::lock_guard<std::mutex> lock(statistics_mutex_);
  return statistics_;
}

}  // namespace acmp
