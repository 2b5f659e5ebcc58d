#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/PointCloud2.h>

#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/image/label.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/ros/image_decoder.h"

/// From ROS messages to the library's types; no master is needed. Throws InvalidInputError naming the value that cannot
/// be used.
namespace acmp {

constexpr bool kBigEndianHost = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;

/// What a camera_info says about the image as it is sent.
struct CameraCalibration {
  PinholeCamera camera;  ///< of the image as sent: binning and region of interest already applied
  LensDistortion distortion;
  std::string frame_id;
  double field_of_view = 0;  ///< of Lens
  std::string note = {};     ///< what was assumed; empty: nothing

  Lens MakeLens() const { return {camera, distortion, field_of_view}; }
};
using CalibrationPtr = std::shared_ptr<const CameraCalibration>;

bool operator==(const CameraCalibration& a, const CameraCalibration& b);

/// Calls a function that reads a file, of 1 MB at most. Throws InvalidInputError that names parameter and path: where
/// there is no such file, and with what the function throws.
void ReadSmallFile(const char* parameter, const std::string& path, const std::function<void()>& read);

/// Reads what camera_calibration writes, YAML or INI, and YAML of a CameraInfo message, as `rostopic echo` prints it,
/// under any name. Throws InvalidInputError if the file cannot be read, naming what a YAML file lacks, or
/// the size that a matrix has and must have, and where ToCalibration refuses its camera. All messages name the file.
/// @param rectified of ToCalibration
sensor_msgs::CameraInfo ReadCalibrationFile(const std::string& path, bool rectified = false);

/// The mask of an image. Throws InvalidInputError for an encoding other than mono8, or too few bytes.
ImageSample ToMaskSample(const sensor_msgs::ImageConstPtr& message);
/// What it says of the image's pixels. Throws InvalidInputError where it has another size than the camera's images.
Mask DecodeMask(const EncodedImage& mask, const PinholeCamera& camera);

/// The labels of an image. Throws InvalidInputError for an encoding other than 8UC1, mono8, 16UC1 and mono16, or too
/// few bytes.
ImageSample ToLabelSample(const sensor_msgs::ImageConstPtr& message);
/// Throws InvalidInputError for another size than that of the camera's images, and for a label above kMaxLabel.
LabelImage DecodeLabels(const EncodedImage& labels, const PinholeCamera& camera);

/// Depth from outside of an image, at any size. Throws InvalidInputError for an encoding other than 32FC1 (z in the
/// world's unit) and 16UC1 or mono16 (thousandths), for a side of 0 or more than 32767 px, and for too few bytes.
ImageSample ToPriorDepthSample(const sensor_msgs::ImageConstPtr& message);
/// z at its own size; 0 where it is not positive and finite. Throws InvalidInputError where no pixel has a depth.
DepthMap DecodePriorDepth(const EncodedImage& depth);

/// Camera and distortion of the image as sent: binning and region of interest are applied, plumb_bob,
/// rational_polynomial, equidistant, mei (D: xi k1 k2 p1 p2) and equirectangular (the size alone tells all) are known,
/// also by other names; more coefficients than these have must be 0. A plumb_bob of 8 is a rational_polynomial.
/// `rectified`: the image is undistorted already, P holds and D does not.
/// @param field_of_view deg, of Lens; 0: as far as the image goes
CameraCalibration ToCalibration(const sensor_msgs::CameraInfo& info, bool rectified, double field_of_view = 0);

/// x, y, z as float32 or float64; not-finite and exactly zero points are counted and left out.
SparseCloud ToSparseCloud(const sensor_msgs::PointCloud2& cloud);
/// `points` alone: what some frontends put in the channels does not keep to the message's rules.
SparseCloud ToSparseCloud(const sensor_msgs::PointCloud& cloud);

/// Not finite, or a quaternion off unit length by more than 1e-3, is refused.
RigidTransform ToTransform(const geometry_msgs::Pose& pose);
RigidTransform ToTransform(const geometry_msgs::Transform& transform);
PoseSample ToPoseSample(const std_msgs::Header& header, const std::string& child_frame,
                        const geometry_msgs::Pose& pose);
PoseSample ToPoseSample(const std_msgs::Header& header, const std::string& child_frame,
                        const geometry_msgs::Transform& pose);

/// "/map" and "map" name one frame.
std::string StripLeadingSlash(const std::string& frame_id);

int64_t ToStampNs(const ros::Time& stamp);

}  // namespace acmp
