#include "acmp_mapping/ros/map_output.h"

#include <array>
#include <filesystem>

#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/map/map_mesh.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/map/occupancy_map.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

/// roscpp takes more for a broken connection; 1 kB is left for the other fields.
constexpr size_t kMaxMessageBytes = 1000000000 - 1000;

template <class Message>
ros::Publisher AdvertiseLatched(ros::NodeHandle* nh, const char* name, PublishPace* pace) {
  const ros::SubscriberStatusCallback on_connect = [pace](const ros::SingleSubscriberPublisher&) { pace->Request(); };
  return nh->advertise<Message>(name, 1, on_connect, ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
}

struct SavedFormat {
  const char* name;
  const char* ending;
};

/// By number of the request's format.
constexpr std::array<SavedFormat, 5> kSavedFormats = {
    {{"PLY", ".ply"}, {"PCD", ".pcd"}, {"MESH_PLY", ".ply"}, {"MESH_OBJ", ".obj"}, {"OCTOMAP", ".bt"}}};

void CheckFormat(const std::filesystem::path& path, size_t format) {
  if (format >= kSavedFormats.size()) {
    throw InvalidInputError(
        Concat("format = ", format, ": must be 0 (PLY), 1 (PCD), 2 (MESH_PLY), 3 (MESH_OBJ) or 4 (OCTOMAP)"));
  }
  const SavedFormat& saved = kSavedFormats.at(format);
  std::string other;  // the format that the name is meant for
  for (size_t i = 0; i < kSavedFormats.size() && other.empty(); ++i) {
    if (LowerExtension(path) == kSavedFormats.at(i).ending) other = Concat("; or set format: ", i);
  }
  CheckEnding(path, saved.ending, Concat("format ", format, " (", saved.name, ")"), other);
}

}  // namespace

MapOutput::MapOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options)
    : map_(map),
      options_(options),
      points_(AdvertiseLatched<sensor_msgs::PointCloud2>(&nh, names::kMapPoints, &points_pace_)) {
  if (CanMapOccupancy()) {
    occupancy_ = AdvertiseLatched<nav_msgs::OccupancyGrid>(&nh, names::kOccupancy, &occupancy_pace_);
  }
}

void MapOutput::SetHeader(const std::string& world_frame, int64_t stamp_ns) {
  std::lock_guard<std::mutex> lock(header_mutex_);
  world_frame_ = world_frame;
  stamp_ns_ = stamp_ns;
}

std_msgs::Header MapOutput::Header() {
  std::lock_guard<std::mutex> lock(header_mutex_);
  std_msgs::Header header;
  header.frame_id = world_frame_;
  header.stamp.fromNSec(static_cast<uint64_t>(stamp_ns_));
  return header;
}

size_t MapOutput::Publish() {
  points_pace_.Begin(map_->version());
  const std_msgs::Header header = Header();
  if (header.frame_id.empty()) return 0;
  const PointCloud map = map_->WorldCloud();
  CheckCloudSize(map.size(), kMaxMessageBytes);
  points_.publish(ToCloudMessage(map, header));
  return map.size();
}

void MapOutput::PublishOccupancy() {
  const std_msgs::Header header = Header();
  occupancy_pace_.Begin(map_->version());
  const PlacedKeyframes map = map_->Placed();
  if (header.frame_id.empty() || map.keyframes.empty() || map.voxel_size == 0) return;
  const OccupancySlice slice =
      MakeOccupancyMap(map, 0)->Slice(options_.occupancy_min_height, options_.occupancy_max_height);
  occupancy_.publish(ToOccupancyGrid(slice, header));
}

void MapOutput::PublishIfDue() {
  const double rate = options_.map_publish_rate;
  const uint64_t version = map_->version();
  if (points_pace_.IsDue(rate, points_.getNumSubscribers(), version)) {
    Publish();
    points_pace_.End(rate);
  }
  if (occupancy_ && occupancy_pace_.IsDue(rate, occupancy_.getNumSubscribers(), version)) {
    PublishOccupancy();
    occupancy_pace_.End(rate);
  }
}

size_t MapOutput::SaveMesh(const std::filesystem::path& path, const SaveMap::Request& request,
                           size_t* keyframes) const {
  const MapMeshOptions mesh_options = {0, static_cast<size_t>(1e9 * DefaultMemoryLimitGb())};
  const TriangleMesh mesh = MakeMapMesh(*map_, mesh_options, keyframes);
  WriteMap(path, mesh, request.format == SaveMap::Request::MESH_PLY ? MeshFormat::kPly : MeshFormat::kObj);
  return mesh.vertices.size();
}

MapOutput::SaveMap::Response MapOutput::Save(const SaveMap::Request& request) const {
  using Request = SaveMap::Request;
  const std::filesystem::path path = MapPathBelow(options_.save_folder, request.path);
  CheckFormat(path, request.format);
  const bool replaces = std::filesystem::exists(path);
  size_t keyframes = 0, points = 0;
  const char* what = "points";
  switch (request.format) {
    case Request::PLY:
    case Request::PCD: {
      const PointCloud map = map_->WorldCloud(&keyframes);
      WriteMap(path, map, request.format == Request::PLY ? MapFormat::kPly : MapFormat::kPcd, request.binary);
      points = map.size();
      break;
    }
    case Request::MESH_PLY:
    case Request::MESH_OBJ:
      points = SaveMesh(path, request, &keyframes);
      what = "vertices of the mesh";
      break;
    default: {  // OCTOMAP
      CheckMapPath(path);
      const PlacedKeyframes map = map_->Placed();
      const auto occupancy = MakeOccupancyMap(map, 0);
      occupancy->Write(path);
      keyframes = map.keyframes.size();
      points = occupancy->nodes();
      what = "nodes of the octree";
    }
  }
  SaveMap::Response response;
  response.success = true;
  response.message = Concat("saved ", points, " ", what, " of ", keyframes, " keyframes to ", path.string(),
                            replaces ? kReplaced : "");
  response.points = points;
  response.keyframes = keyframes;
  return response;
}

}  // namespace acmp
