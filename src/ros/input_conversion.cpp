#include "acmp_mapping/ros/input_conversion.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <map>

#include <sensor_msgs/image_encodings.h>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/raw_image.h"
#include "acmp_mapping/geometry/lens_models.h"
#include "acmp_mapping/intake/pose_semantics.h"

namespace acmp {
namespace {

namespace encodings = sensor_msgs::image_encodings;

bool IsSphere(const sensor_msgs::CameraInfo& info) {
  const LensModel* model = FindLensModel(info.distortion_model);
  return model != nullptr && model->model == LensDistortion::Model::kEquirectangular;
}

LensDistortion ToDistortion(const sensor_msgs::CameraInfo& info) {
  const auto is_zero = [](double d) { return d == 0; };
  const LensModel* found = FindLensModel(info.distortion_model);
  const bool needs_none = found == nullptr || (found->model != LensDistortion::Model::kUnified && !IsSphere(info));
  if (needs_none && std::all_of(info.D.begin(), info.D.end(), is_zero)) return {};
  if (found == nullptr) {
    std::string known;
    for (const LensModel& model : LensModels()) known += Concat(known.empty() ? "" : ", ", model.name);
    throw InvalidInputError(Concat("camera_info distortion_model = \"", info.distortion_model, "\": must be one of ",
                                   known, "; of other lenses give the rectified images (rectified: true)"));
  }
  const auto zeros_from = [&](size_t index) {
    return std::all_of(info.D.begin() + static_cast<std::ptrdiff_t>(std::min(index, info.D.size())), info.D.end(),
                       is_zero);
  };
  // OpenCV has one list for both, and so have programs that write the name without a look at the number.
  const bool is_rational =
      found->model == LensDistortion::Model::kBrownConrady && info.D.size() >= 8 && !zeros_from(found->most);
  const LensModel& model = is_rational ? LensModelOf(LensDistortion::Model::kRational) : *found;
  for (const double d : info.D) {
    if (!std::isfinite(d)) throw InvalidInputError(Concat("camera_info D holds ", d, ": must be finite"));
  }
  if (info.D.size() < model.least) {
    throw InvalidInputError(
        Concat("camera_info D has ", info.D.size(), " coefficients: ", info.distortion_model, " has ", model.most));
  }
  const auto used = info.D.begin() + static_cast<std::ptrdiff_t>(std::min(info.D.size(), model.most));
  if (!zeros_from(model.most)) {
    throw InvalidInputError(Concat("camera_info D has ", info.D.size(), " coefficients, and those after the first ",
                                   model.most, " are not all 0: ", info.distortion_model, " has ", model.most,
                                   "; a lens with others (thin prism, tilt) needs rectified images (rectified: true)"));
  }
  LensDistortion distortion;
  distortion.model = model.model;
  distortion.coefficients.assign(info.D.begin(), used);
  distortion.coefficients.resize(model.most);
  return distortion;
}

/// Reads one coordinate of a PointCloud2.
struct CoordinateReader {
  uint32_t offset;
  bool is_double;

  CoordinateReader(const sensor_msgs::PointCloud2& cloud, const std::string& name) {
    for (const sensor_msgs::PointField& field : cloud.fields) {
      if (field.name != name) continue;
      is_double = field.datatype == sensor_msgs::PointField::FLOAT64;
      if (!is_double && field.datatype != sensor_msgs::PointField::FLOAT32) {
        throw InvalidInputError(Concat("sparse cloud field \"", name, "\" has datatype ", int{field.datatype},
                                       ": must be FLOAT32 (7) or FLOAT64 (8)"));
      }
      offset = field.offset;
      if (uint64_t{offset} + (is_double ? 8 : 4) > cloud.point_step) {
        throw InvalidInputError(Concat("sparse cloud field \"", name, "\" at offset ", offset,
                                       " lies beyond point_step = ", cloud.point_step));
      }
      return;
    }
    throw InvalidInputError(Concat("sparse cloud has no field \"", name, "\""));
  }

  double Read(const uint8_t* point) const {
    if (is_double) {
      double value;
      std::memcpy(&value, point + offset, sizeof(value));
      return value;
    }
    float value;
    std::memcpy(&value, point + offset, sizeof(value));
    return value;
  }
};

SparseCloud EmptyCloud(const std_msgs::Header& header) {
  SparseCloud sparse;
  sparse.stamp_ns = ToStampNs(header.stamp);
  sparse.frame_id = StripLeadingSlash(header.frame_id);
  return sparse;
}

void AddPoint(const Eigen::Vector3d& point, SparseCloud* sparse) {
  if (!point.allFinite()) {
    ++sparse->not_finite;
  } else if (point.isZero(0)) {
    ++sparse->zero;
  } else {
    sparse->points.push_back(point);
  }
}

void CheckBytes(const std::string& name, const sensor_msgs::Image& image, uint64_t pixel_bytes) {
  const uint64_t row_bytes = image.width * pixel_bytes, needed = uint64_t{image.height} * image.step;
  if (image.step >= row_bytes && image.data.size() >= needed) return;
  throw InvalidInputError(Concat(name, " of ", image.width, "x", image.height, " pixels, step ", image.step, ", with ",
                                 image.data.size(), " bytes: needs ", needed, ", and a step of ", row_bytes));
}

/// A number of the message, with its bytes the other way round if `swap`.
template <class T>
T ReadAs(const uint8_t* from, bool swap) {
  uint8_t bytes[sizeof(T)];
  std::copy_n(from, sizeof(T), bytes);
  if (swap) std::reverse(bytes, bytes + sizeof(T));
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

/// What belongs to an image and is one itself. Throws InvalidInputError for another encoding than these, with their
/// bytes per pixel, and for what CheckImageSides and CheckBytes refuse.
ImageSample ToSample(const sensor_msgs::ImageConstPtr& message, const char* what,
                     const std::map<std::string, uint64_t>& known, const char* expected) {
  const sensor_msgs::Image& image = *message;
  const std::string name = Concat(what, " ", FormatStamp(ToStampNs(image.header.stamp)));
  const auto encoding = known.find(image.encoding);
  if (encoding == known.end()) {
    throw InvalidInputError(Concat(name, ": encoding \"", image.encoding, "\": must be ", expected));
  }
  CheckImageSides(name, image.width, image.height);
  CheckBytes(name, image, encoding->second);
  return {ToStampNs(image.header.stamp), std::make_shared<const EncodedImage>(EncodedImage{message, nullptr})};
}

/// @param what "mask"
void CheckSizeOf(const char* what, const sensor_msgs::Image& image, const PinholeCamera& camera) {
  if (image.width == static_cast<uint32_t>(camera.width) && image.height == static_cast<uint32_t>(camera.height))
    return;
  throw InvalidInputError(Concat(what, " ", FormatStamp(ToStampNs(image.header.stamp)), " of ", image.width, "x",
                                 image.height, ": must have the image's size, ", camera.width, "x", camera.height));
}

/// @param pose Pose or Transform
template <class Pose>
PoseSample MakePoseSample(const std_msgs::Header& header, const std::string& child_frame, const Pose& pose) {
  try {
    const std::string frame = StripLeadingSlash(header.frame_id), child = StripLeadingSlash(child_frame);
    return {ToStampNs(header.stamp), frame, ToTransform(pose), child == frame ? "" : child};
  } catch (const InvalidInputError& error) {
    throw InvalidInputError(Concat("pose ", FormatStamp(ToStampNs(header.stamp)), ": ", error.what()));
  }
}

}  // namespace

ImageSample ToMaskSample(const sensor_msgs::ImageConstPtr& message) {
  return ToSample(message, "mask", {{encodings::MONO8, 1}, {encodings::TYPE_8UC1, 1}},
                  "mono8, where 0 means to ignore the pixel");
}

ImageSample ToLabelSample(const sensor_msgs::ImageConstPtr& message) {
  return ToSample(
      message, "labels",
      {{encodings::MONO8, 1}, {encodings::TYPE_8UC1, 1}, {encodings::MONO16, 2}, {encodings::TYPE_16UC1, 2}},
      "8UC1, mono8, 16UC1 or mono16, where 0 means unknown");
}

Mask DecodeMask(const EncodedImage& encoded, const PinholeCamera& camera) {
  const sensor_msgs::Image& image = *encoded.raw;
  CheckSizeOf("mask", image, camera);
  Mask mask(camera.width, camera.height);
  for (int row = 0; row < mask.height(); ++row) {
    std::copy_n(image.data.data() + static_cast<size_t>(row) * image.step, mask.width(), &mask(0, row));
  }
  return mask;
}

LabelImage DecodeLabels(const EncodedImage& encoded, const PinholeCamera& camera) {
  const sensor_msgs::Image& image = *encoded.raw;
  CheckSizeOf("labels", image, camera);
  const bool wide = image.encoding == encodings::MONO16 || image.encoding == encodings::TYPE_16UC1;
  const bool swap = (image.is_bigendian != 0) != kBigEndianHost;
  LabelImage labels(camera.width, camera.height);
  for (int row = 0; row < labels.height(); ++row) {
    const uint8_t* from = image.data.data() + static_cast<size_t>(row) * image.step;
    for (int col = 0; col < labels.width(); ++col) {
      const int label = wide ? ReadAs<uint16_t>(from + col * sizeof(uint16_t), swap) : from[col];
      if (label > kMaxLabel) {
        throw InvalidInputError(Concat("labels ", FormatStamp(ToStampNs(image.header.stamp)), ": pixel (", col, ", ",
                                       row, ") has ", label, ": must be at most ", kMaxLabel));
      }
      labels(col, row) = static_cast<Label>(label);
    }
  }
  return labels;
}

ImageSample ToPriorDepthSample(const sensor_msgs::ImageConstPtr& message) {
  return ToSample(message, "prior depth",
                  {{encodings::TYPE_32FC1, 4}, {encodings::TYPE_16UC1, 2}, {encodings::MONO16, 2}},
                  "32FC1 (in the world's unit) or 16UC1 (thousandths of it)");
}

DepthMap DecodePriorDepth(const EncodedImage& encoded) {
  const sensor_msgs::Image& image = *encoded.raw;
  const bool is_float = image.encoding == encodings::TYPE_32FC1;
  const bool swap = (image.is_bigendian != 0) != kBigEndianHost;
  DepthMap depth(static_cast<int>(image.width), static_cast<int>(image.height));
  bool has_depth = false;
  for (int row = 0; row < depth.height(); ++row) {
    const uint8_t* from = image.data.data() + static_cast<size_t>(row) * image.step;
    for (int col = 0; col < depth.width(); ++col) {
      const float z = is_float ? ReadAs<float>(from + col * sizeof(float), swap)
                               : static_cast<float>(ReadAs<uint16_t>(from + col * sizeof(uint16_t), swap)) / 1000.0f;
      if (!(z > 0 && std::isfinite(z))) continue;
      depth(col, row) = z;
      has_depth = true;
    }
  }
  if (!has_depth) {
    throw InvalidInputError(
        Concat("prior depth ", FormatStamp(ToStampNs(image.header.stamp)), ": no pixel has a positive, finite depth"));
  }
  return depth;
}

bool operator==(const CameraCalibration& a, const CameraCalibration& b) {
  return a.camera == b.camera && a.distortion == b.distortion && a.frame_id == b.frame_id &&
         a.field_of_view == b.field_of_view;
}

CameraCalibration ToCalibration(const sensor_msgs::CameraInfo& info, bool rectified, double field_of_view) {
  // K and P are row-major; P's left 3x3 block is the K of the rectified image.
  double fx = rectified ? info.P[0] : info.K[0];
  double fy = rectified ? info.P[5] : info.K[4];
  double cx = rectified ? info.P[2] : info.K[2];
  double cy = rectified ? info.P[6] : info.K[5];
  if (!rectified && IsSphere(info)) {
    fx = fy = info.width / (360 * kRadPerDeg<double>);
    cx = 0.5 * info.width - 0.5;
    cy = 0.5 * info.height - 0.5;
  }
  const char* matrix = rectified ? "P" : "K";
  if (!(fx > 0) || !std::isfinite(fx)) {
    throw InvalidInputError(Concat("camera_info ", matrix, "[0] = ", fx, ": must be > 0 (is the camera calibrated?)"));
  }
  if (!(fy > 0) || !std::isfinite(fy)) {
    throw InvalidInputError(Concat("camera_info ", matrix, rectified ? "[5] = " : "[4] = ", fy, ": must be > 0"));
  }
  const int64_t binning_x = std::max(info.binning_x, 1u);
  const int64_t binning_y = std::max(info.binning_y, 1u);
  const bool cropped = info.roi.width > 0 && info.roi.height > 0;
  const int64_t full_width = cropped ? info.roi.width : info.width;
  const int64_t full_height = cropped ? info.roi.height : info.height;
  if (cropped && (info.roi.x_offset + full_width > info.width || info.roi.y_offset + full_height > info.height)) {
    throw InvalidInputError(Concat("camera_info roi ", info.roi.width, "x", info.roi.height, " at (", info.roi.x_offset,
                                   ", ", info.roi.y_offset, "): must lie in ", info.width, "x", info.height));
  }
  const int64_t width = full_width / binning_x, height = full_height / binning_y;
  CheckImageSides(
      Concat("camera_info of ", full_width, "x", full_height, " pixels with binning ", binning_x, " and ", binning_y),
      static_cast<uint32_t>(width), static_cast<uint32_t>(height));
  CameraCalibration calibration;
  // A binned pixel u covers the full pixels b u .. b u + b - 1, hence the half pixels.
  calibration.camera.width = static_cast<int>(width);
  calibration.camera.height = static_cast<int>(height);
  calibration.camera.fx = fx / binning_x;
  calibration.camera.fy = fy / binning_y;
  calibration.camera.cx = (cx - (cropped ? info.roi.x_offset : 0) + 0.5) / binning_x - 0.5;
  calibration.camera.cy = (cy - (cropped ? info.roi.y_offset : 0) + 0.5) / binning_y - 0.5;
  CheckCamera("camera_info", calibration.camera);
  if (!rectified) {
    calibration.distortion = ToDistortion(info);
    const LensModel* named = FindLensModel(info.distortion_model);
    const LensModel& taken = LensModelOf(calibration.distortion.model);
    if (named && named->model == LensDistortion::Model::kBrownConrady &&
        taken.model == LensDistortion::Model::kRational) {
      calibration.note =
          Concat(info.distortion_model, " with ", info.D.size(), " coefficients is taken for ", taken.name);
    }
  }
  calibration.field_of_view = field_of_view;
  CheckLens("camera_info", calibration.camera, calibration.distortion, field_of_view);
  calibration.frame_id = StripLeadingSlash(info.header.frame_id);
  return calibration;
}

SparseCloud ToSparseCloud(const sensor_msgs::PointCloud& cloud) {
  SparseCloud sparse = EmptyCloud(cloud.header);
  sparse.points.reserve(cloud.points.size());
  for (const geometry_msgs::Point32& point : cloud.points) AddPoint({point.x, point.y, point.z}, &sparse);
  return sparse;
}

SparseCloud ToSparseCloud(const sensor_msgs::PointCloud2& cloud) {
  const CoordinateReader x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
  if (cloud.is_bigendian) throw InvalidInputError("sparse cloud is_bigendian = true: must be little-endian");
  const size_t row_bytes = static_cast<size_t>(cloud.width) * cloud.point_step;
  const size_t needed = cloud.height == 0 ? 0 : (cloud.height - 1) * static_cast<size_t>(cloud.row_step) + row_bytes;
  if (cloud.data.size() < needed || (cloud.height > 1 && cloud.row_step < row_bytes)) {
    throw InvalidInputError(Concat("sparse cloud of ", cloud.width, "x", cloud.height, " points with ",
                                   cloud.data.size(), " bytes: needs ", needed));
  }
  SparseCloud sparse = EmptyCloud(cloud.header);
  if (cloud.width == 0) return sparse;  // of any height, which is up to 2^32 then
  sparse.points.reserve(static_cast<size_t>(cloud.width) * cloud.height);
  for (size_t row = 0; row < cloud.height; ++row) {
    for (size_t col = 0; col < cloud.width; ++col) {
      const uint8_t* bytes = cloud.data.data() + row * cloud.row_step + col * cloud.point_step;
      AddPoint({x.Read(bytes), y.Read(bytes), z.Read(bytes)}, &sparse);
    }
  }
  return sparse;
}

RigidTransform ToTransform(const geometry_msgs::Pose& pose) {
  const geometry_msgs::Quaternion& q = pose.orientation;
  return CheckedTransform(Eigen::Quaterniond(q.w, q.x, q.y, q.z),
                          Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z));
}

RigidTransform ToTransform(const geometry_msgs::Transform& transform) {
  const geometry_msgs::Quaternion& q = transform.rotation;
  const geometry_msgs::Vector3& t = transform.translation;
  return CheckedTransform(Eigen::Quaterniond(q.w, q.x, q.y, q.z), Eigen::Vector3d(t.x, t.y, t.z));
}

PoseSample ToPoseSample(const std_msgs::Header& header, const std::string& child_frame,
                        const geometry_msgs::Pose& pose) {
  return MakePoseSample(header, child_frame, pose);
}

PoseSample ToPoseSample(const std_msgs::Header& header, const std::string& child_frame,
                        const geometry_msgs::Transform& pose) {
  return MakePoseSample(header, child_frame, pose);
}

std::string StripLeadingSlash(const std::string& frame_id) {
  return !frame_id.empty() && frame_id.front() == '/' ? frame_id.substr(1) : frame_id;
}

int64_t ToStampNs(const ros::Time& stamp) {
  constexpr uint32_t kNsPerSecond = 1000000000;
  if (stamp.nsec >=
      kNsPerSecond) {  // no sum of both would be the same stamp again, and the largest seconds none at all
    throw InvalidInputError(
        Concat("stamp of ", stamp.sec, " s and ", stamp.nsec, " ns: the nanoseconds must be below ", kNsPerSecond));
  }
  return static_cast<int64_t>(stamp.toNSec());
}

}  // namespace acmp
