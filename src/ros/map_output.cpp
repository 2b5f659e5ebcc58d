#include "acmp_mapping/ros/map_output.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <iomanip>
#include <iterator>
#include <utility>

#include <sensor_msgs/PointCloud2.h>
#include <tf2_eigen/tf2_eigen.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/label_votes.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

/// roscpp takes more for a broken connection; 1 kB is left for the other fields.
constexpr size_t kMaxMessageBytes = 1000000000 - 1000;

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

using acmp_mapping::SaveMap;

/// A map to be saved, and where.
struct SaveJob {
  const SaveMap::Request& request;
  const std::filesystem::path path;
  const MapStore& map;
  const MapOutput& output;
  const size_t memory_limit;  ///< bytes
};

/// What was saved.
struct Written {
  size_t points = 0, keyframes = 0;
  std::string note = {};  ///< for the end of the answer
};

Written WriteCloud(const SaveJob& job) {
  const MapCloud map = job.map.WorldCloud();
  if (!map.points.empty()) ClaimMapFile(job.path);
  const bool is_ply = job.request.format == SaveMap::Request::PLY;
  WriteMap(job.path, map, is_ply ? MapFormat::kPly : MapFormat::kPcd, job.request.binary);
  return {map.points.size(), map.keyframes};
}

Written WriteMesh(const SaveJob& job) {
  const MapMesh map = MakeMapMesh(job.map, {0, job.memory_limit, [&job] { job.output.CheckStopped(); }});
  ClaimMapFile(job.path);
  WriteMap(job.path, map, MeshFormatOf(job.path));
  return {map.mesh.vertices.size(), map.keyframes};
}

Written WriteOctomap(const SaveJob& job) {
  CheckMapPath(job.path);
  const PlacedKeyframes map = job.map.Placed();
  const auto occupancy = MakeOccupancyMap(map, 0, job.output.LimitsOfOccupancy());
  ClaimMapFile(job.path);
  const size_t nodes = occupancy->Write(job.path);
  const std::string coarse = job.output.DescribeCoarse(*occupancy, map.voxel_size);
  const std::string note = Concat(coarse.empty() ? "" : "; ", coarse);
  return {nodes, map.keyframes.size(), note + DescribeOrigin(map.origin, "OctoMap")};  // 16-bit keys
}

Written WriteColmap(const SaveJob& job) {
  const PlacedKeyframes map = job.map.Placed();
  const ColmapFolder written = WriteColmapFolder(job.path, map, [&job] { job.output.CheckStopped(); });
  return {written.points, written.images, DescribeLeftOut(written) + DescribeOrigin(map.origin, "splats")};
}

constexpr char kVertices[] = "vertices of the mesh";
const struct FileFormat {
  uint8_t number;
  const char* name;
  const char* ending;
  const char* what;  ///< is counted
  Written (*write)(const SaveJob& job);
} kFileFormats[] = {{SaveMap::Request::PLY, "PLY", ".ply", "points", &WriteCloud},
                    {SaveMap::Request::PCD, "PCD", ".pcd", "points", &WriteCloud},
                    {SaveMap::Request::MESH_PLY, "MESH_PLY", ".ply", kVertices, &WriteMesh},
                    {SaveMap::Request::MESH_OBJ, "MESH_OBJ", ".obj", kVertices, &WriteMesh},
                    {SaveMap::Request::OCTOMAP, "OCTOMAP", ".bt", "nodes of the octree", &WriteOctomap},
                    {SaveMap::Request::COLMAP, "COLMAP", ".colmap", "points", &WriteColmap}};

}  // namespace

std::string LocalFrame(const std::string& world_frame, const Eigen::Vector3d& origin) {
  return Concat(world_frame, "_map_origin_", std::setprecision(15), origin.x(), "_", origin.y(), "_", origin.z());
}

MapOutput::MapOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options,
                     std::function<void(const RejectedInput&)> report)
    : map_(map),
      options_(options),
      report_(std::move(report)),
      label_table_(options.label_file),
      points_(AdvertiseLatched<sensor_msgs::PointCloud2>(&nh, names::kMapPoints, &points_pace_)),
      labels_(AdvertiseLatched<sensor_msgs::PointCloud2>(&nh, names::kMapLabels, &points_pace_)) {}

void MapOutput::SetHeader(const std::string& world_frame, int64_t stamp_ns) {
  std::lock_guard<std::mutex> lock(header_mutex_);
  header_.frame_id = world_frame;
  header_.stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
}

std_msgs::Header MapOutput::Header() {
  std::lock_guard<std::mutex> lock(header_mutex_);
  return header_;
}

size_t MapOutput::Publish() {
  const uint64_t emptied = emptied_;
  const uint64_t version = map_->version();
  std_msgs::Header header = Header();
  points_pace_.Begin(header.frame_id.empty() ? 0 : version);  // what is in the map gets its header in a moment
  if (header.frame_id.empty()) return 0;
  MapCloud map = map_->WorldCloud();
  const size_t points = map.points.size();
  CheckCloudSize(points, PackedPointBytes(HasLabels(map.points)), kMaxMessageBytes);
  EnterLocalFrame(map.origin, &header);
  const sensor_msgs::PointCloud2Ptr message = ToCloudMessage(map.points, header);
  sensor_msgs::PointCloud2Ptr labels;
  if (labels_.getNumSubscribers() > 0) labels = ToCloudMessage(label_table_.Colored(std::move(map.points)), header);
  std::lock_guard<std::mutex> lock(publish_mutex_);
  if (emptied_ != emptied) return points;
  points_.publish(message);
  if (labels) labels_.publish(labels);
  return points;
}

void MapOutput::PublishNothing() {
  std::lock_guard<std::mutex> lock(publish_mutex_);
  ++emptied_;
  const std_msgs::Header header = Header();
  SetHeader("", 0);
  if (header.frame_id.empty()) return;
  for (ros::Publisher* topic : {&points_, &labels_}) topic->publish(ToCloudMessage({}, header));
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

OccupancyLimits MapOutput::LimitsOfOccupancy() const {
  OccupancyLimits limits;
  limits.max_bytes = options_.memory_limit_bytes();
  limits.passable = label_table_.PassableLabels();
  limits.check = [this] { CheckStopped(); };
  return limits;
}

std::string MapOutput::DescribeCoarse(const OccupancyMap& occupancy, double voxel_size) const {
  const double wanted = kOccupancyVoxels * voxel_size;
  if (occupancy.resolution() <= wanted) return "";
  return Concat("cells are ", occupancy.resolution(), " wide in place of ", wanted,
                ": the scene is too wide for them (~memory_limit = ", options_.memory_limit_gb,
                ", 32000 cells from the origin); raise ~voxel_size, or lower ~map_radius");
}

void MapOutput::CheckStopped() const {
  if (stopping_) throw ProcessingError("the map server is shutting down");
}

void MapOutput::PublishIfDue() {
  const double rate = options_.map_publish_rate;
  if (stopping_ ||
      !points_pace_.IsDue(rate, points_.getNumSubscribers() + labels_.getNumSubscribers(), map_->version()))
    return;
  try {
    Publish();
  } catch (const std::exception& error) {
    if (!stopping_) report_({"map_error", Concat(points_.getTopic(), " was not published: ", error.what())});
  }
  points_pace_.End(rate);
}

SaveMap::Response MapOutput::Save(const SaveMap::Request& request) const {
  const auto* const format = std::find_if(std::begin(kFileFormats), std::end(kFileFormats),
                                          [&](const FileFormat& known) { return known.number == request.format; });
  if (format == std::end(kFileFormats)) {
    std::string known;
    for (const FileFormat& other : kFileFormats)
      known += Concat(known.empty() ? "" : ", ", int{other.number}, " ", other.name);
    throw InvalidInputError(Concat("format = ", int{request.format}, ": must be one of ", known));
  }
  const std::filesystem::path path = MapPathBelow(options_.save_folder, request.path, format->ending);
  const char* replaced = std::filesystem::is_directory(path) ? ", in place of the folder of that name"
                         : std::filesystem::exists(path)     ? kReplaced
                                                             : "";
  const Written written = format->write({request, path, *map_, *this, options_.memory_limit_bytes()});
  SaveMap::Response response;
  response.success = true;
  response.message = Concat("saved ", written.points, " ", format->what, " of ", written.keyframes, " keyframes to ",
                            path.string(), replaced, written.note);
  response.points = written.points;
  response.keyframes = written.keyframes;
  return response;
}

}  // namespace acmp
