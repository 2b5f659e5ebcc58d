#pragma once

#include <nav_msgs/OccupancyGrid.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/map/occupancy_map.h"

/// From the library's types to ROS messages; no master is needed.
namespace acmp {

/// 32FC1 (REP 118); unknown pixels and those with keep = 0 become NaN, "unknown" (REP 117).
sensor_msgs::ImagePtr ToDepthMessage(const DepthMap& depth, ImageView<const unsigned char> keep,
                                     const std_msgs::Header& header);
/// 16UC1 in millimetres; unknown and beyond 65.535 m become 0 (REP 118).
sensor_msgs::ImagePtr ToDepthMillimetres(const sensor_msgs::Image& depth_32fc1);
sensor_msgs::ImagePtr ToFloatMessage(const Image<float>& map, const std_msgs::Header& header);  ///< 32FC1
/// 32FC3; unknown pixels and those with keep = 0 become NaN.
sensor_msgs::ImagePtr ToNormalMessage(const NormalMap& normal, ImageView<const unsigned char> keep,
                                      const std_msgs::Header& header);
sensor_msgs::ImagePtr ToColorMessage(const ColorImage& color, const std_msgs::Header& header);  ///< rgb8
/// A mask (0 = ignore) or labels (0 = unknown).
sensor_msgs::ImagePtr ToMono8Message(const Image<unsigned char>& image, const std_msgs::Header& header);
sensor_msgs::CameraInfoPtr ToCameraInfo(const PinholeCamera& camera, const std_msgs::Header& header);

/// 0 free, 100 occupied, -1 unknown (nav_msgs), in the plane z = 0 of the header's frame.
nav_msgs::OccupancyGridPtr ToOccupancyGrid(const OccupancySlice& slice, const std_msgs::Header& header);

/// Throws InvalidInputError when a message of so many points would have more bytes than `limit`.
void CheckCloudSize(size_t points, size_t point_bytes, size_t limit);

/// x y z rgb normal_x normal_y normal_z confidence, and where points have labels label; unordered. Throws
/// InvalidInputError above 4 GB, which the message's sizes cannot express.
void FillCloud(const PointCloud& points, const std_msgs::Header& header, sensor_msgs::PointCloud2* message);
sensor_msgs::PointCloud2Ptr ToCloudMessage(const PointCloud& points, const std_msgs::Header& header);
/// Back again, without a change. Throws InvalidInputError for a message of any other layout.
PointCloud ToPointCloud(const sensor_msgs::PointCloud2& message);

}  // namespace acmp
