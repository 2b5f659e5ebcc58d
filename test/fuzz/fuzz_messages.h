#pragma once

#include <algorithm>

#include <geometry_msgs/Pose.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>

#include "fuzz/fuzz_input.h"

/// Messages with any values. They are not deserialised from ROS's bytes: roscpp asks for as much memory as a length in
/// them says.
namespace acmp::fuzz {

inline void Fill(Bytes* bytes, std_msgs::Header* header) {
  header->stamp.sec = bytes->Take<uint32_t>();
  header->stamp.nsec = bytes->Take<uint32_t>();
  header->frame_id = bytes->TakeText();
}

inline void Fill(Bytes* bytes, geometry_msgs::Pose* pose) {
  for (double* value : {&pose->position.x, &pose->position.y, &pose->position.z, &pose->orientation.x,
                        &pose->orientation.y, &pose->orientation.z, &pose->orientation.w}) {
    *value = bytes->Take<double>();
  }
}

inline void Fill(Bytes* bytes, sensor_msgs::CameraInfo* info) {
  Fill(bytes, &info->header);
  info->width = bytes->Take<uint32_t>();
  info->height = bytes->Take<uint32_t>();
  info->distortion_model = bytes->TakeText();
  info->D = bytes->TakeVector<double>();
  for (double& value : info->K) value = bytes->Take<double>();
  for (double& value : info->P) value = bytes->Take<double>();
  for (uint32_t* value : {&info->binning_x, &info->binning_y, &info->roi.x_offset, &info->roi.y_offset,
                          &info->roi.width, &info->roi.height}) {
    *value = bytes->Take<uint32_t>();
  }
}

inline void Fill(Bytes* bytes, sensor_msgs::Image* image) {
  Fill(bytes, &image->header);
  image->width = bytes->Take<uint32_t>();
  image->height = bytes->Take<uint32_t>();
  image->encoding = bytes->TakeText();
  image->is_bigendian = bytes->Take<uint8_t>();
  image->step = bytes->Take<uint32_t>();
  image->data = bytes->TakeVector<uint8_t>();
}

inline void Fill(Bytes* bytes, sensor_msgs::CompressedImage* image) {
  Fill(bytes, &image->header);
  image->format = bytes->TakeText();
  image->data = bytes->TakeVector<uint8_t>();
}

inline void Fill(Bytes* bytes, sensor_msgs::PointCloud2* cloud) {
  Fill(bytes, &cloud->header);
  cloud->width = bytes->Take<uint32_t>();
  cloud->height = bytes->Take<uint32_t>();
  cloud->fields.resize(bytes->Take<uint8_t>() % 16);
  for (sensor_msgs::PointField& field : cloud->fields) {
    field.name = bytes->TakeText();
    field.offset = bytes->Take<uint32_t>();
    field.datatype = bytes->Take<uint8_t>();
    field.count = bytes->Take<uint32_t>();
  }
  cloud->is_bigendian = bytes->TakeBool();
  cloud->point_step = bytes->Take<uint32_t>();
  cloud->row_step = bytes->Take<uint32_t>();
  cloud->is_dense = bytes->TakeBool();
  cloud->data = bytes->TakeVector<uint8_t>();
}

}  // namespace acmp::fuzz
