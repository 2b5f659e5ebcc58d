#pragma once

#include <pcl/pcl_macros.h>
#include <pcl/point_types.h>
#include <pcl/register_point_struct.h>

namespace acmp {

/// A point of the topics points and map_points and of the PCD files, for programs that use PCL: all that
/// pcl::PointXYZRGBNormal has, and the confidence.
struct EIGEN_ALIGN16 MapPoint {
  PCL_ADD_POINT4D;   ///< x, y, z: in the message's frame
  PCL_ADD_NORMAL4D;  ///< normal_x, normal_y, normal_z: of unit length
  union {
    struct {
      PCL_ADD_UNION_RGB;
      float confidence;  ///< 0..1
    };
    float data_c[4];
  };
  PCL_MAKE_ALIGNED_OPERATOR_NEW
};

}  // namespace acmp

POINT_CLOUD_REGISTER_POINT_STRUCT(acmp::MapPoint,
                                  (float, x, x)(float, y, y)(float, z, z)(float, rgb, rgb)(float, normal_x, normal_x)(
                                      float, normal_y, normal_y)(float, normal_z, normal_z)(float, confidence,
                                                                                            confidence))
