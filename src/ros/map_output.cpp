#include "acmp_mapping/ros/map_output.h"

#include <algorithm>
#include <filesystem>

#include <sensor_msgs/PointCloud2.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

/// roscpp takes more for a broken connection; 1 kB is left for the other fields.
constexpr size_t kMaxMessageBytes = 1000000000 - 1000;
constexpr double kMapLoad = 4;  ///< building maps takes at most one part in 1 + kMapLoad of a core

}  // namespace

MapOutput::MapOutput(ros::NodeHandle nh, const MapStore* map, const std::string& save_folder)
    : map_(map), save_folder_(save_folder) {
  const ros::SubscriberStatusCallback on_connect = [this](const ros::SingleSubscriberPublisher&) { requested_ = true; };
  publisher_ = nh.advertise<sensor_msgs::PointCloud2>(names::kMapPoints, 1, on_connect, ros::SubscriberStatusCallback(),
                                                      ros::VoidConstPtr(), true);
}

void MapOutput::SetHeader(const std::string& world_frame, int64_t stamp_ns) {
  std::lock_guard<std::mutex> lock(header_mutex_);
  world_frame_ = world_frame;
  stamp_ns_ = stamp_ns;
}

size_t MapOutput::Publish() {
  std_msgs::Header header;
  {
    std::lock_guard<std::mutex> lock(header_mutex_);
    header.frame_id = world_frame_;
    header.stamp.fromNSec(static_cast<uint64_t>(stamp_ns_));
  }
  if (header.frame_id.empty()) return 0;
  requested_ = false;
  published_version_ = map_->version();
  const PointCloud map = map_->WorldCloud();
  CheckCloudSize(map.size(), kMaxMessageBytes);
  publisher_.publish(ToCloudMessage(map, header));
  return map.size();
}

void MapOutput::PublishIfDue(double max_rate) {
  const double now_s = SteadySeconds();
  if (max_rate <= 0 || now_s < next_publish_s_ || publisher_.getNumSubscribers() == 0) return;
  if (map_->version() == published_version_ && !requested_) return;
  Publish();
  next_publish_s_ = now_s + std::max(1 / max_rate, (1 + kMapLoad) * (SteadySeconds() - now_s));
}

acmp_mapping::SaveMap::Response MapOutput::Save(const acmp_mapping::SaveMap::Request& request) const {
  using acmp_mapping::SaveMap;
  if (request.format != SaveMap::Request::PLY && request.format != SaveMap::Request::PCD) {
    throw InvalidInputError(Concat("format = ", int{request.format}, ": must be 0 (PLY) or 1 (PCD)"));
  }
  const std::filesystem::path path = MapPathBelow(save_folder_, request.path);
  size_t keyframes = 0;
  const PointCloud map = map_->WorldCloud(&keyframes);
  const MapFormat format = request.format == SaveMap::Request::PLY ? MapFormat::kPly : MapFormat::kPcd;
  WriteMap(path, map, format, request.binary);
  SaveMap::Response response;
  response.success = true;
  response.message = Concat("saved ", map.size(), " points of ", keyframes, " keyframes to ", path.string());
  response.points = map.size();
  response.keyframes = keyframes;
  return response;
}

}  // namespace acmp
