#include "acmp_mapping/ros/map_output.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <iomanip>
#include <iterator>
#include <utility>

#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_eigen/tf2_eigen.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
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

/// Of a file with local coordinates; empty where these are the world's. @param holder what has no larger ones
std::string DescribeOrigin(const Eigen::Vector3d& origin, const char* holder) {
  if (origin.isZero(0)) return "";
  return Concat("; its coordinates are those of the world less (", std::setprecision(15), origin.x(), ", ", origin.y(),
                ", ", origin.z(), "), as ", holder, " holds none that large");
}

std::string DescribeLeftOut(const ColmapFolder& written) {
  std::string text;
  if (written.without_image > 0) {
    text +=
        Concat("; ", written.without_image, " keyframes have no image and are left out (~keep_images of the mappers, ",
               "and \"images kept\" in /diagnostics)");
  }
  if (written.without_points > 0) text += Concat("; ", written.without_points, " without points are left out");
  return text;
}

}  // namespace

std::string LocalFrame(const std::string& world_frame, const Eigen::Vector3d& origin) {
  return Concat(world_frame, "_map_origin_", std::setprecision(15), origin.x(), "_", origin.y(), "_", origin.z());
}

MapOutput::MapOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options,
                     std::function<void(const RejectedInput&)> report)
    : map_(map),
      options_(options),
      report_(std::move(report)),
      points_(AdvertiseLatched<sensor_msgs::PointCloud2>(&nh, names::kMapPoints, &points_pace_)),
      occupancy_(AdvertiseLatched<nav_msgs::OccupancyGrid>(&nh, names::kOccupancy, &occupancy_pace_)) {}

void MapOutput::SetHeader(const std::string& world_frame, int64_t stamp_ns) {
  std::lock_guard<std::mutex> lock(header_mutex_);
  header_.frame_id = world_frame;
  header_.stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
}

std_msgs::Header MapOutput::Header() {
  std::lock_guard<std::mutex> lock(header_mutex_);
  return header_;
}

template <class Message>
void MapOutput::PublishOf(uint64_t emptied, const ros::Publisher& publisher, const Message& message) {
  std::lock_guard<std::mutex> lock(publish_mutex_);
  if (emptied_ == emptied) publisher.publish(message);
}

size_t MapOutput::Publish() {
  const uint64_t emptied = emptied_;
  const uint64_t version = map_->version();
  std_msgs::Header header = Header();
  points_pace_.Begin(header.frame_id.empty() ? 0 : version);  // what is in the map gets its header in a moment
  if (header.frame_id.empty()) return 0;
  const MapCloud map = map_->WorldCloud();
  CheckCloudSize(map.points.size(), kMaxMessageBytes);
  EnterLocalFrame(map.origin, &header);
  PublishOf(emptied, points_, ToCloudMessage(map.points, header));
  return map.points.size();
}

void MapOutput::PublishNothing() {
  std::lock_guard<std::mutex> lock(publish_mutex_);
  ++emptied_;
  const std_msgs::Header header = Header();
  SetHeader("", 0);
  if (header.frame_id.empty()) return;
  points_.publish(ToCloudMessage({}, header));
  if (occupancy_) occupancy_.publish(ToOccupancyGrid({}, header));
}

void MapOutput::EnterLocalFrame(const Eigen::Vector3d& origin, std_msgs::Header* header) {
  if (origin.isZero(0)) return;
  geometry_msgs::TransformStamped transform = tf2::eigenToTransform(Eigen::Isometry3d(Eigen::Translation3d(origin)));
  transform.header = *header;
  header->frame_id = LocalFrame(header->frame_id, origin);
  transform.child_frame_id = header->frame_id;
  std::lock_guard<std::mutex> lock(local_frame_mutex_);
  if (std::exchange(local_frame_name_, header->frame_id) == header->frame_id) return;
  if (!local_frame_) local_frame_ = std::make_unique<tf2_ros::StaticTransformBroadcaster>();
  local_frame_->sendTransform(transform);
}

void MapOutput::PublishOccupancy() {
  const uint64_t emptied = emptied_;
  const uint64_t version = map_->version();
  const std_msgs::Header header = Header();
  occupancy_pace_.Begin(header.frame_id.empty() ? 0 : version);
  const PlacedKeyframes map = map_->Placed();
  if (header.frame_id.empty() || map.keyframes.empty() || map.voxel_size == 0) return;
  if (!options_.z_up && !ZPointsUp(map.keyframes)) {
    report_(
        {"occupancy_not_upright",
         Concat("occupancy is empty: by the cameras z of \"", header.frame_id,
                "\" does not point up (frontends of one camera without an IMU have a world whose z points forward). "
                "Set ~z_up if it does, and cameras are mounted on their side")});
    return PublishOf(emptied, occupancy_, ToOccupancyGrid({}, header));
  }
  std::string coarse;
  OccupancySlice slice =
      MakeOccupancy(map, &coarse)
          ->Slice(options_.occupancy_min_height - map.origin.z(), options_.occupancy_max_height - map.origin.z());
  slice.origin_x += map.origin.x();
  slice.origin_y += map.origin.y();
  CheckStopped();
  if (!coarse.empty()) report_({"occupancy_coarse", "occupancy: " + coarse});
  constexpr size_t kSomeKeyframes = 3;
  if (slice.cells.empty() && map.keyframes.size() >= kSomeKeyframes) {
    const auto height = [&](const PlacedKeyframe& keyframe) {
      return keyframe.world_from_cam.translation().z() + map.origin.z();
    };
    const auto [lowest, highest] =
        std::minmax_element(map.keyframes.begin(), map.keyframes.end(),
                            [&](const auto& a, const auto& b) { return height(a) < height(b); });
    report_({"occupancy_empty",
             Concat("occupancy has no cells: nothing of the map lies between z = ", options_.occupancy_min_height,
                    " and ", options_.occupancy_max_height, " of \"", header.frame_id,
                    "\" (~occupancy_min_height, ~occupancy_max_height), where cameras are at z = ", height(*lowest),
                    " to ", height(*highest), ": z must point up, and the floor be at 0")});
  }
  PublishOf(emptied, occupancy_, ToOccupancyGrid(slice, header));
}

std::unique_ptr<OccupancyMap> MapOutput::MakeOccupancy(const PlacedKeyframes& map, std::string* coarse) const {
  OccupancyLimits limits;
  limits.max_bytes = options_.memory_limit_bytes();
  limits.check = [this] { CheckStopped(); };
  auto occupancy = MakeOccupancyMap(map, 0, limits);
  const double wanted = kOccupancyVoxels * map.voxel_size;
  if (occupancy->resolution() > wanted) {
    *coarse =
        Concat("cells are ", occupancy->resolution(), " wide in place of ", wanted,
               ": the scene is too wide or its depths too large for them (~memory_limit = ", options_.memory_limit_gb,
               ", ", limits.max_ray_voxels / 1000000,
               " million cells on all rays, 32000 from the origin); raise ~voxel_size, or lower ~map_radius");
  }
  return occupancy;
}

void MapOutput::CheckStopped() const {
  if (stopping_) throw ProcessingError("the map server is shutting down");
}

void MapOutput::PublishPaced(const ros::Publisher& publisher, PublishPace* pace, const std::function<void()>& publish) {
  const double rate = options_.map_publish_rate;
  if (stopping_ || !pace->IsDue(rate, publisher.getNumSubscribers(), map_->version())) return;
  try {
    publish();
  } catch (const std::exception& error) {
    if (!stopping_) report_({"map_error", Concat(publisher.getTopic(), " was not published: ", error.what())});
  }
  pace->End(rate);
}

void MapOutput::PublishIfDue() {
  PublishPaced(points_, &points_pace_, [this] { Publish(); });
}

void MapOutput::PublishOccupancyIfDue() {
  if (occupancy_) PublishPaced(occupancy_, &occupancy_pace_, [this] { PublishOccupancy(); });
}

MapOutput::Written MapOutput::WriteCloud(const std::filesystem::path& path, const SaveMap::Request& request) const {
  const MapCloud map = map_->WorldCloud();
  if (!map.points.empty()) ClaimMapFile(path);
  WriteMap(path, map, request.format == SaveMap::Request::PLY ? MapFormat::kPly : MapFormat::kPcd, request.binary);
  return {map.points.size(), map.keyframes, ""};
}

MapOutput::Written MapOutput::WriteMesh(const std::filesystem::path& path, const SaveMap::Request& /*request*/) const {
  const MapMesh map = MakeMapMesh(*map_, {0, options_.memory_limit_bytes(), [this] { CheckStopped(); }});
  ClaimMapFile(path);
  WriteMap(path, map, MeshFormatOf(path));
  return {map.mesh.vertices.size(), map.keyframes, ""};
}

MapOutput::Written MapOutput::WriteOctomap(const std::filesystem::path& path, const SaveMap::Request&) const {
  CheckMapPath(path);
  const PlacedKeyframes map = map_->Placed();
  std::string coarse;
  const auto occupancy = MakeOccupancy(map, &coarse);
  ClaimMapFile(path);
  occupancy->Write(path);
  const std::string note = Concat(coarse.empty() ? "" : "; ", coarse);
  return {occupancy->nodes(), map.keyframes.size(), note + DescribeOrigin(map.origin, "OctoMap")};  // 16-bit keys
}

MapOutput::Written MapOutput::WriteColmap(const std::filesystem::path& path, const SaveMap::Request&) const {
  const PlacedKeyframes map = map_->Placed();
  const ColmapFolder written = WriteColmapFolder(path, map, [this] { CheckStopped(); });
  return {written.points, written.images, DescribeLeftOut(written) + DescribeOrigin(map.origin, "splats")};
}

MapOutput::SaveMap::Response MapOutput::Save(const SaveMap::Request& request) const {
  using Request = SaveMap::Request;
  constexpr const char* kVertices = "vertices of the mesh";
  static const struct Format {
    uint8_t number;
    const char* name;
    const char* ending;
    const char* what;  ///< is counted
    Written (MapOutput::*write)(const std::filesystem::path&, const Request&) const;
  } formats[] = {{Request::PLY, "PLY", ".ply", "points", &MapOutput::WriteCloud},
                 {Request::PCD, "PCD", ".pcd", "points", &MapOutput::WriteCloud},
                 {Request::MESH_PLY, "MESH_PLY", ".ply", kVertices, &MapOutput::WriteMesh},
                 {Request::MESH_OBJ, "MESH_OBJ", ".obj", kVertices, &MapOutput::WriteMesh},
                 {Request::OCTOMAP, "OCTOMAP", ".bt", "nodes of the octree", &MapOutput::WriteOctomap},
                 {Request::COLMAP, "COLMAP", ".colmap", "points", &MapOutput::WriteColmap}};
  const auto format = std::find_if(std::begin(formats), std::end(formats),
                                   [&](const Format& known) { return known.number == request.format; });
  if (format == std::end(formats)) {
    std::string known;
    for (const Format& other : formats) known += Concat(known.empty() ? "" : ", ", int{other.number}, " ", other.name);
    throw InvalidInputError(Concat("format = ", int{request.format}, ": must be one of ", known));
  }
  const std::filesystem::path path = MapPathBelow(options_.save_folder, request.path, format->ending);
  const char* replaced = std::filesystem::is_directory(path) ? ", in place of the folder of that name"
                         : std::filesystem::exists(path)     ? kReplaced
                                                             : "";
  const Written written = (this->*format->write)(path, request);
  SaveMap::Response response;
  response.success = true;
  response.message = Concat("saved ", written.points, " ", format->what, " of ", written.keyframes, " keyframes to ",
                            path.string(), replaced, written.note);
  response.points = written.points;
  response.keyframes = written.keyframes;
  return response;
}

}  // namespace acmp
