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

/// Of messages that a slow listener has not read, 6 MB each by default; then roscpp drops the oldest.
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
      const auto& [position, normal, color, confidence] = block.mesh.vertices[corner];
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
    : options_(options),
      map_output_(map_output),
      report_(std::move(report)),
      mesh_(map, options.mesh()),
      publisher_(nh.advertise<MarkerArray>(
          names::kMesh, kMeshQueue, [this](const ros::SingleSubscriberPublisher&) { is_new_listener_ = true; })) {}

void MeshOutput::PublishIfDue() {
  constexpr double kLoad = 4;  // making blocks again takes at most one part in 1 + kLoad of a core
  if (options_.mesh_rate <= 0) return;
  if (listeners() == 0) {
    if (std::exchange(is_listened_to_, false)) mesh_.Clear();
    return;
  }
  is_listened_to_ = true;
  if (std::exchange(is_new_listener_, false)) mesh_.TellAll();
  const double begun_s = SteadySeconds();
  const bool make_again = begun_s >= next_again_s_;
  if (begun_s < next_s_ || !mesh_.HasWork(make_again)) return;
  std_msgs::Header header = map_output_->Header();
  if (header.frame_id.empty()) header = header_;  // the map has been emptied, or gets its first header in a moment
  if (header.frame_id.empty()) return;
  const double coarser = mesh_.statistics().coarser;
  const MeshUpdate update = mesh_.Update(make_again);
  const LiveMeshStatistics now = mesh_.statistics();
  if (now.coarser > coarser) {
    report_(
        {"mesh_coarse", Concat("mesh: voxels are ", now.voxel_size, " wide in place of ", now.voxel_size / now.coarser,
                               ", which would take more than ~mesh_memory = ", options_.mesh_memory_gb, " GB")});
  }
  Publish(update, header);
  const double ended_s = SteadySeconds();
  next_s_ = begun_s + 1 / options_.mesh_rate;
  if (make_again) next_again_s_ = ended_s + kLoad * (ended_s - begun_s);
  std::lock_guard<std::mutex> lock(statistics_mutex_);
  statistics_ = now;
}

void MeshOutput::Publish(const MeshUpdate& update, std_msgs::Header header) {
  if (!update.anew && update.blocks.empty()) return;
  auto message = boost::make_shared<MarkerArray>();
  if (update.anew && !header_.frame_id.empty()) message->markers.push_back(MakeMarker(Marker::DELETEALL, 0, header_));
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
