#include "acmp_mapping/ros/occupancy_output.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

#include <acmp_mapping/DistanceChange.h>
#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using acmp_mapping::DistanceChange;
using acmp_mapping::GetDistances;

constexpr double kDistanceRate = 5;  ///< Hz at most
constexpr uint32_t kChangeQueue = 100;

/// Of the mapper, if it has any in the map.
const PlacedKeyframe& NewestOf(const PlacedKeyframes& map, const std::string& mapper) {
  return *std::max_element(map.keyframes.begin(), map.keyframes.end(), [&](const auto& a, const auto& b) {
    const bool is_a = a.key.mapper == mapper, is_b = b.key.mapper == mapper;
    return is_a != is_b ? is_b : a.stamp_ns < b.stamp_ns;
  });
}

geometry_msgs::Point ToPointMessage(const Eigen::Vector3d& p) {
  geometry_msgs::Point message;
  message.x = p.x(), message.y = p.y(), message.z = p.z();
  return message;
}

/// The known voxels' distances in a plane through the camera.
sensor_msgs::PointCloud2Ptr ToSlice(const DistanceGrid& grid, const RigidTransform& world_from_cam,
                                    const std_msgs::Header& header) {
  int up = 0;  // the world's axis that is most upright in the image
  world_from_cam.linear().col(1).cwiseAbs().maxCoeff(&up);
  VoxelBox plane = grid.box;
  const auto axis = static_cast<size_t>(up);
  const auto layer = static_cast<int>(std::floor(world_from_cam.translation()[up] / grid.resolution));
  plane.low[axis] = plane.high[axis] = std::clamp(layer, plane.low[axis], plane.high[axis]);
  std::vector<VoxelIndex> known;
  VoxelIndex v;
  for (v[2] = plane.low[2]; v[2] <= plane.high[2]; ++v[2]) {
    for (v[1] = plane.low[1]; v[1] <= plane.high[1]; ++v[1]) {
      for (v[0] = plane.low[0]; v[0] <= plane.high[0]; ++v[0]) {
        if (grid.OccupancyAt(grid.CellOf(v)) != Occupancy::kUnknown) known.push_back(v);
      }
    }
  }
  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  sensor_msgs::PointCloud2Modifier fields(*cloud);
  constexpr auto kFloat = sensor_msgs::PointField::FLOAT32;
  fields.setPointCloud2Fields(4, "x", 1, kFloat, "y", 1, kFloat, "z", 1, kFloat, "distance", 1, kFloat);
  if (known.empty()) return cloud;  // which an iterator cannot be made of
  fields.resize(known.size());
  sensor_msgs::PointCloud2Iterator<float> point(*cloud, "x");
  for (const VoxelIndex& voxel : known) {
    for (int i = 0; i < 3; ++i) {
      point[i] = static_cast<float>((voxel[static_cast<size_t>(i)] + 0.5) * grid.resolution);
    }
    point[3] = grid.DistanceAt(grid.CellOf(voxel));
    ++point;
  }
  return cloud;
}

}  // namespace

OccupancyOutput::OccupancyOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options,
                                 MapOutput* map_output, std::function<void(const RejectedInput&)> report)
    : map_(map),
      options_(options),
      map_output_(map_output),
      report_(std::move(report)),
      occupancy_(map_output->LimitsOfOccupancy()),
      field_(options.distance_to_unknown, options.memory_limit_bytes() / 2),
      grid_(AdvertiseLatched<nav_msgs::OccupancyGrid>(&nh, names::kOccupancy, &grid_pace_)),
      slice_(AdvertiseLatched<sensor_msgs::PointCloud2>(&nh, names::kDistanceSlice, &distance_pace_)),
      change_(nh.advertise<DistanceChange>(names::kDistanceChange, kChangeQueue)) {}

void OccupancyOutput::Set(Distances distances) {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    distances_ = std::move(distances);
  }
  made_.notify_all();
}

void OccupancyOutput::PublishIfDue() {
  const bool distances_wanted = IsAskedFor() || DistanceListeners() > 0;
  if (!distances_wanted && field_.grid()) {
    field_.Clear();
    Set({});
  }
  if (!distances_wanted && grid_.getNumSubscribers() == 0) occupancy_.Clear();
  if (map_output_->Header().frame_id.empty()) return PublishEmpty("the map is empty: there are no distances");
  const uint64_t version = map_->version();
  const bool grid =
      is_requested_.exchange(false) || grid_pace_.IsDue(options_.map_publish_rate, grid_.getNumSubscribers(), version);
  const bool is_new = distances_wanted && !field_.grid();  // whoever asked waits
  const bool distances =
      is_new ? distance_pace_.IsTime()
             : distances_wanted && distance_pace_.IsDue(kDistanceRate, DistanceListeners() + 1, version);
  if (!grid && !distances) return;
  if (grid) grid_pace_.Begin(version);
  if (distances) distance_pace_.Begin(version);
  try {
    Update(grid, distances);
  } catch (const std::exception& error) {
    if (distances) {
      field_.Clear();  // it may have missed changes
      Set({nullptr, {}, error.what()});
    }
    try {
      map_output_->CheckStopped();
      report_({"map_error", Concat(grid_.getTopic(), " or distances were not published: ", error.what())});
    } catch (const ProcessingError&) {  // it is the end
    }
  }
  if (grid) grid_pace_.End(options_.map_publish_rate);
  if (distances) distance_pace_.End(kDistanceRate);
}

void OccupancyOutput::PublishEmpty(const std::string& failure) {
  PublishNoDistances(failure);
  occupancy_.Clear();
  if (!grid_header_.frame_id.empty()) grid_.publish(ToOccupancyGrid({}, std::exchange(grid_header_, {})));
}

void OccupancyOutput::PublishNoDistances(const std::string& failure) {
  field_.Clear();
  Set({nullptr, {}, IsAskedFor() ? failure : ""});
  if (distance_header_.frame_id.empty()) return;
  auto slice = boost::make_shared<sensor_msgs::PointCloud2>();
  auto change = boost::make_shared<DistanceChange>();
  slice->header = change->header = std::exchange(distance_header_, {});
  change->all = true;
  slice_.publish(slice);
  change_.publish(change);
}

void OccupancyOutput::Update(bool publish_grid, bool publish_distances) {
  const uint64_t version = map_->version();
  const std_msgs::Header header = map_output_->Header();
  const PlacedKeyframes map = map_->Placed();
  LiveOccupancy::Change change = occupancy_.Update(map);
  // What the field has not seen, as only the grid was published.
  missed_.anew = missed_.anew || change.anew || !field_.grid();
  if (missed_.anew) {
    missed_.changed.clear();
  } else {
    missed_.changed.insert(missed_.changed.end(), change.changed.begin(), change.changed.end());
  }
  if (!occupancy_.map() || header.frame_id.empty()) {
    return PublishEmpty("the map has no points yet: there are no distances");
  }
  const std::string coarse = map_output_->DescribeCoarse(*occupancy_.map(), map.voxel_size);
  if (!coarse.empty()) report_({"occupancy_coarse", "occupancy: " + coarse});
  if (publish_distances) PublishDistances(map, std::exchange(missed_, {}), version, header);
  if (publish_grid) PublishGrid(map, header);
}

void OccupancyOutput::PublishGrid(const PlacedKeyframes& map, const std_msgs::Header& header) {
  grid_header_ = header;
  if (!options_.z_up && !ZPointsUp(map.keyframes)) {
    report_(
        {"occupancy_not_upright",
         Concat("occupancy is empty: by the cameras z of \"", header.frame_id,
                "\" does not point up (frontends of one camera without an IMU have a world whose z points forward). "
                "Set ~z_up if it does, and cameras are mounted on their side")});
    return grid_.publish(ToOccupancyGrid({}, header));
  }
  OccupancySlice slice = occupancy_.map()->Slice(options_.occupancy_min_height - map.origin.z(),
                                                 options_.occupancy_max_height - map.origin.z());
  slice.origin_x += map.origin.x();
  slice.origin_y += map.origin.y();
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
  grid_.publish(ToOccupancyGrid(slice, header));
}

void OccupancyOutput::PublishDistances(const PlacedKeyframes& map, const LiveOccupancy::Change& change,
                                       uint64_t version, const std_msgs::Header& header) {
  const PlacedKeyframe& newest = NewestOf(map, mapper_);
  mapper_ = newest.key.mapper;
  const auto before = field_.grid();
  const VoxelBox region = field_.Update(occupancy_, change, newest.world_from_cam.translation(), version);
  const auto grid = field_.grid();
  if (!grid) return PublishNoDistances("nothing of the map is known: there are no distances");
  distance_header_ = header;
  Set({grid, header, ""});
  if (grid->cropped()) {
    report_({"distance_cropped",
             Concat("distances are kept in a box of ", grid->size(0), " x ", grid->size(1), " x ", grid->size(2),
                    " voxels of ", grid->resolution, " about the newest camera of ", mapper_,
                    ": the whole map takes more than half of ", "~memory_limit = ", options_.memory_limit_gb,
                    " GB; raise it or ~voxel_size, or lower ~map_radius")});
  }
  if (slice_.getNumSubscribers() > 0) {
    std_msgs::Header local = header;
    map_output_->EnterLocalFrame(map.origin, &local);
    slice_.publish(ToSlice(*grid, newest.world_from_cam, local));
  }
  auto message = boost::make_shared<DistanceChange>();
  message->header = header;
  message->version = version;
  message->previous_version = before ? before->version : 0;
  message->all = !before || before->box.low != grid->box.low || before->box.high != grid->box.high ||
                 before->resolution != grid->resolution || before->origin != grid->origin;
  if (!region.empty()) {
    const auto corner = [&](const VoxelIndex& voxel, double side) {
      const Eigen::Vector3d index = Eigen::Vector3d(voxel[0], voxel[1], voxel[2]).array() + side;
      return ToPointMessage(map.origin + grid->resolution * index);
    };
    message->low = corner(region.low, 0);
    message->high = corner(region.high, 1);
  }
  change_.publish(message);
}

GetDistances::Response OccupancyOutput::Answer(const GetDistances::Request& request) {
  if (request.points.size() > kMaxPoints) {
    throw InvalidInputError(Concat(request.points.size(), " points: at most ", kMaxPoints, " in a call"));
  }
  for (size_t i = 0; i < request.points.size(); ++i) {
    const geometry_msgs::Point& p = request.points[i];
    if (std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)) continue;
    throw InvalidInputError(
        Concat("points[", i, "] = (", p.x, ", ", p.y, ", ", p.z, "): must be finite; none was looked at"));
  }
  const bool is_first = !IsAskedFor();
  asked_until_s_ = SteadySeconds() + kAskedForS;
  Distances distances;
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (is_first && !distances_.grid) distances_.failure.clear();  // of an earlier call
    while (!distances_.grid && distances_.failure.empty()) {
      map_output_->CheckStopped();
      asked_until_s_ = SteadySeconds() + kAskedForS;
      made_.wait_for(lock, std::chrono::milliseconds(100));
    }
    distances = distances_;
    if (!distances.grid) distances_.failure.clear();  // the next call tries again
  }
  if (!distances.grid) throw InvalidInputError(distances.failure);
  const DistanceGrid& grid = *distances.grid;
  GetDistances::Response response;
  response.header = distances.header;
  response.version = grid.version;
  response.resolution = static_cast<float>(grid.resolution);
  response.max_distance = static_cast<float>(grid.max_distance());
  response.distance.reserve(request.points.size());
  response.gradient.resize(request.points.size());
  response.occupancy.reserve(request.points.size());
  for (size_t i = 0; i < request.points.size(); ++i) {
    const geometry_msgs::Point& p = request.points[i];
    const PointDistance at = grid.At(Eigen::Vector3d(p.x, p.y, p.z) - grid.origin);
    response.distance.push_back(at.distance);
    geometry_msgs::Vector3& gradient = response.gradient[i];
    gradient.x = at.gradient.x(), gradient.y = at.gradient.y(), gradient.z = at.gradient.z();
    response.occupancy.push_back(static_cast<uint8_t>(at.occupancy));
  }
  return response;
}

}  // namespace acmp
