// A PointCloud2 as sparse points and as points of a keyframe.

#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(point_cloud) {
  using namespace acmp;
  fuzz::Bytes bytes(data, size);
  sensor_msgs::PointCloud2 cloud;
  fuzz::Fill(&bytes, &cloud);
  fuzz::MayRefuse([&] { ToSparseCloud(cloud); });
  fuzz::MayRefuse([&] { ToPointCloud(cloud); });
  return 0;
}
