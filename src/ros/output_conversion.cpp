#include "acmp_mapping/ros/output_conversion.h"

#include <cmath>
#include <cstring>
#include <iterator>
#include <limits>

#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/label_votes.h"
#include "acmp_mapping/map/map_writer.h"

namespace acmp {
namespace {

namespace encodings = sensor_msgs::image_encodings;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

sensor_msgs::ImagePtr MakeImageMessage(int width, int height, const std::string& encoding, size_t pixel_bytes,
                                       const std_msgs::Header& header) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header = header;
  message->width = static_cast<uint32_t>(width);
  message->height = static_cast<uint32_t>(height);
  message->encoding = encoding;
  message->step = static_cast<uint32_t>(width * pixel_bytes);
  message->data.resize(static_cast<size_t>(message->step) * message->height);
  return message;
}

template <class Pixel>
sensor_msgs::ImagePtr Copied(const Image<Pixel>& image, const std::string& encoding, const std_msgs::Header& header) {
  auto message = MakeImageMessage(image.width(), image.height(), encoding, sizeof(Pixel), header);
  std::memcpy(message->data.data(), image.data(), message->data.size());
  return message;
}

}  // namespace

sensor_msgs::ImagePtr ToDepthMessage(const DepthMap& depth, ImageView<const unsigned char> keep,
                                     const std_msgs::Header& header) {
  sensor_msgs::ImagePtr message = ToFloatMessage(depth, header);
  float* values = reinterpret_cast<float*>(message->data.data());
  for (int row = 0; row < depth.height(); ++row) {
    for (int col = 0; col < depth.width(); ++col, ++values) {
      if (*values == 0 || !keep(col, row)) *values = kNaN;
    }
  }
  return message;
}

sensor_msgs::ImagePtr ToDepthMillimetres(const sensor_msgs::Image& depth_32fc1) {
  sensor_msgs::ImagePtr message =
      MakeImageMessage(static_cast<int>(depth_32fc1.width), static_cast<int>(depth_32fc1.height), encodings::TYPE_16UC1,
                       sizeof(uint16_t), depth_32fc1.header);
  const float* metres = reinterpret_cast<const float*>(depth_32fc1.data.data());
  uint16_t* millimetres = reinterpret_cast<uint16_t*>(message->data.data());
  for (size_t i = 0; i < message->data.size() / sizeof(uint16_t); ++i) {
    const float rounded = std::round(metres[i] * 1000.0f);
    millimetres[i] = rounded > 0 && rounded <= 65535.0f ? static_cast<uint16_t>(rounded) : uint16_t{0};
  }
  return message;
}

sensor_msgs::ImagePtr ToFloatMessage(const Image<float>& map, const std_msgs::Header& header) {
  return Copied(map, encodings::TYPE_32FC1, header);
}

sensor_msgs::ImagePtr ToNormalMessage(const NormalMap& normal, ImageView<const unsigned char> keep,
                                      const std_msgs::Header& header) {
  static_assert(sizeof(Vec3f) == 3 * sizeof(float), "pixels of 32FC3");
  auto message = MakeImageMessage(normal.width(), normal.height(), encodings::TYPE_32FC3, sizeof(Vec3f), header);
  Vec3f* target = reinterpret_cast<Vec3f*>(message->data.data());
  for (int row = 0; row < normal.height(); ++row) {
    for (int col = 0; col < normal.width(); ++col) {
      const Vec3f& n = normal(col, row);
      const bool unknown = (n.x == 0 && n.y == 0 && n.z == 0) || !keep(col, row);
      *target++ = unknown ? Vec3f{kNaN, kNaN, kNaN} : n;
    }
  }
  return message;
}

sensor_msgs::ImagePtr ToColorMessage(const ColorImage& color, const std_msgs::Header& header) {
  static_assert(sizeof(Rgb) == 3, "pixels of rgb8");
  return Copied(color, encodings::RGB8, header);
}

sensor_msgs::ImagePtr ToMono8Message(const Image<unsigned char>& image, const std_msgs::Header& header) {
  return Copied(image, encodings::MONO8, header);
}

sensor_msgs::CameraInfoPtr ToCameraInfo(const PinholeCamera& camera, const std_msgs::Header& header) {
  auto info = boost::make_shared<sensor_msgs::CameraInfo>();
  info->header = header;
  info->width = static_cast<uint32_t>(camera.width);
  info->height = static_cast<uint32_t>(camera.height);
  info->distortion_model = "plumb_bob";
  info->D.assign(5, 0.0);
  info->K = {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
  info->R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info->P = {camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0};
  return info;
}

nav_msgs::OccupancyGridPtr ToOccupancyGrid(const OccupancySlice& slice, const std_msgs::Header& header) {
  auto message = boost::make_shared<nav_msgs::OccupancyGrid>();
  message->header = header;
  message->info.map_load_time = header.stamp;
  message->info.resolution = static_cast<float>(slice.resolution);
  message->info.width = static_cast<uint32_t>(slice.width);
  message->info.height = static_cast<uint32_t>(slice.height);
  message->info.origin.position.x = slice.origin_x;
  message->info.origin.position.y = slice.origin_y;
  message->info.origin.orientation.w = 1;
  message->data.reserve(slice.cells.size());
  for (const Occupancy cell : slice.cells) {
    message->data.push_back(cell == Occupancy::kOccupied ? 100 : cell == Occupancy::kFree ? 0 : -1);
  }
  return message;
}

void CheckCloudSize(size_t points, size_t point_bytes, size_t limit) {
  if (points <= limit / point_bytes) return;
  throw InvalidInputError(Concat(points, " points: a message holds at most ", limit / point_bytes, " (",
                                 limit / 1000000, " MB); raise ~voxel_size, or lower ~map_radius or ~max_keyframes"));
}

void FillCloud(const PointCloud& points, const std_msgs::Header& header, sensor_msgs::PointCloud2* message) {
  const bool labels = HasLabels(points);
  CheckCloudSize(points.size(), PackedPointBytes(labels), std::numeric_limits<uint32_t>::max());
  message->header = header;
  sensor_msgs::PointCloud2Modifier modifier(*message);
  constexpr auto kFloat = sensor_msgs::PointField::FLOAT32;
  modifier.setPointCloud2Fields(8, "x", 1, kFloat, "y", 1, kFloat, "z", 1, kFloat, "rgb", 1, kFloat, "normal_x", 1,
                                kFloat, "normal_y", 1, kFloat, "normal_z", 1, kFloat, "confidence", 1, kFloat);
  if (labels) {
    sensor_msgs::PointField& label = message->fields.emplace_back();
    label.name = kPackedLabel;
    label.offset = message->point_step;
    label.datatype = sensor_msgs::PointField::UINT32;
    label.count = 1;
    message->point_step = PackedPointBytes(true);
  }
  modifier.resize(points.size());
  message->is_dense = true;
  PackPoints(points.data(), points.size(), labels, message->data.data());
}

sensor_msgs::PointCloud2Ptr ToCloudMessage(const PointCloud& points, const std_msgs::Header& header) {
  auto message = boost::make_shared<sensor_msgs::PointCloud2>();
  FillCloud(points, header, message.get());
  return message;
}

PointCloud ToPointCloud(const sensor_msgs::PointCloud2& message) {
  constexpr size_t kFields = std::size(kPackedFields);
  const bool labels = message.fields.size() == kFields + 1;
  const size_t bytes = PackedPointBytes(labels);
  const auto fits = [&](size_t i) {
    const sensor_msgs::PointField& field = message.fields[i];
    return field.name == (i < kFields ? kPackedFields[i] : kPackedLabel) && field.offset == i * sizeof(float) &&
           field.datatype == (i < kFields ? sensor_msgs::PointField::FLOAT32 : sensor_msgs::PointField::UINT32);
  };
  bool known = (labels || message.fields.size() == kFields) && message.point_step == bytes && !message.is_bigendian;
  for (size_t i = 0; known && i < message.fields.size(); ++i) known = fits(i);
  const size_t count = static_cast<size_t>(message.width) * message.height;
  if (!known || message.data.size() != count * bytes) {
    throw InvalidInputError(Concat("cloud with ", message.fields.size(), " fields, ", message.point_step,
                                   " bytes per point and ", message.data.size(), " bytes for ", count,
                                   " points: must be as this package's topic points has it"));
  }
  return UnpackPoints(message.data.data(), count, labels);
}

}  // namespace acmp
