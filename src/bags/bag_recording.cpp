#include "acmp_mapping/bags/bag_recording.h"

#include <cmath>

#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/geometry/lens_models.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/ros/bag_file.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"

namespace acmp {
namespace {

std_msgs::Header MakeHeader(int index, const std::string& frame, const RecordingOptions& options) {
  std_msgs::Header header;
  header.seq = static_cast<uint32_t>(index);
  header.stamp = StampOf(index, options);
  header.frame_id = frame;
  return header;
}

/// An image and what a frontend says of it.
struct RecordedImage {
  int index;  ///< which tells the stamp
  const ColorImage& pixels;
  PinholeCamera camera;  ///< of the pixels
  LensDistortion distortion;
  RigidTransform cam_from_world;
  const std::vector<Eigen::Vector3d>* landmarks_in_world;  ///< null: the frontend has none
  Mask mask = {};                                          ///< of the pixels; empty: none
  const Frame* right = nullptr;                            ///< of a second camera to the right; null: none
  const LabelImage* labels = nullptr;                      ///< of the pixels; null: none
};

class BagRecorder {
 public:
  BagRecorder(const RecordingOptions& options, const std::filesystem::path& bag_path)
      : options_((Validate(options), options)), writer_(bag_path) {}

  /// In the order in which a frontend would send it: the pose comes last, since it triggers the mapper.
  void Add(const RecordedImage& image) {
    const std_msgs::Header in_camera = MakeHeader(image.index, kCameraFrame, options_);
    const std_msgs::Header in_world = MakeHeader(image.index, kWorldFrame, options_);
    const ros::Time& stamp = in_camera.stamp;
    const geometry_msgs::PoseStamped pose = ToPoseStamped(image.cam_from_world, in_world);
    writer_.Write(kImageTopic, stamp, *ToColorMessage(image.pixels, in_camera));
    if (image.right) AddRight(image, stamp);
    if (!image.mask.empty()) writer_.Write(kMaskTopic, stamp, *ToMono8Message(image.mask, in_camera));
    if (image.labels) writer_.Write(kLabelTopic, stamp, *ToMono8Message(*image.labels, in_camera));
    writer_.Write(kCameraInfoTopic, stamp, ToCameraInfo(image.camera, image.distortion, in_camera));
    writer_.Write(kTfTopic, stamp, ToTf(pose, kCameraFrame));
    if (image.landmarks_in_world) {
      writer_.Write(kSparsePointsTopic, stamp, ToPointCloud2(*image.landmarks_in_world, in_world));
      summary_.landmarks += image.landmarks_in_world->size();
    }
    writer_.Write(kPoseTopic, stamp, pose);
    if (summary_.images++ == 0) first_ = stamp;
    summary_.masks += image.mask.empty() ? 0 : 1;
    summary_.duration_s = (stamp - first_).toSec();
  }

  RecordingSummary Finish() {
    writer_.Finish();
    return summary_;
  }

 private:
  /// As stereo calibration has a rectified pair.
  void AddRight(const RecordedImage& image, const ros::Time& stamp) {
    const std_msgs::Header header = MakeHeader(image.index, kRightCameraFrame, options_);
    const RigidTransform from_left = image.right->cam_from_world * image.cam_from_world.inverse();
    sensor_msgs::CameraInfo info = ToCameraInfo(image.right->camera, {}, header);
    info.P[3] = info.P[0] * from_left.translation().x();
    writer_.Write(kRightImageTopic, stamp, *ToColorMessage(image.right->color, header));
    writer_.Write(kRightCameraInfoTopic, stamp, info);
  }

  const RecordingOptions options_;
  BagWriter writer_;
  RecordingSummary summary_;
  ros::Time first_;
};

}  // namespace

void Validate(const RecordingOptions& options) {
  CheckRange("rate", options.rate_hz, 0.001, 1000.0);
  CheckRange("max image size", options.max_image_size, 0, 1 << 16);
}

ros::Time StampOf(int index, const RecordingOptions& options) {
  const auto offset_ns = static_cast<uint64_t>(std::llround(1e9 * index / options.rate_hz));
  const uint64_t stamp_s = kStartTime_s + offset_ns / 1000000000u;
  CheckRange("stamp in seconds", stamp_s, uint64_t{1}, uint64_t{4294967295});  // ROS 1 stores 32 bits
  return ros::Time(static_cast<uint32_t>(stamp_s), static_cast<uint32_t>(offset_ns % 1000000000u));
}

RecordingSummary RecordScene(const Scene& scene, const std::vector<int>& indices, const RecordingOptions& options,
                             const std::filesystem::path& bag_path) {
  BagRecorder recorder(options, bag_path);
  for (const int index : indices) {
    const SceneImage& image = scene.images.at(index);
    const std::vector<Eigen::Vector3d> landmarks = LandmarksOf(scene, image);
    int width = image.camera.width;
    int height = image.camera.height;
    LimitSize(options.max_image_size, &width, &height);
    ColorImage pixels = LoadImage(scene, index);
    if (width != image.camera.width || height != image.camera.height) pixels = Resize(pixels, width, height);
    Mask mask;
    if (!image.mask.empty()) {
      mask = ResizeMask(ReadMask(image.mask, {image.camera.width, image.camera.height}), width, height);
    }
    recorder.Add({index, pixels, image.camera.Resized(width, height), image.distortion, image.cam_from_world,
                  scene.landmarks_in_world.empty() ? nullptr : &landmarks, std::move(mask)});
  }
  return recorder.Finish();
}

RecordingSummary RecordSynthetic(const std::vector<SyntheticView>& views, const RecordingOptions& options,
                                 const std::filesystem::path& bag_path) {
  if (options.max_image_size > 0) throw InvalidInputError("a synthetic scene is recorded at its own size");
  BagRecorder recorder(options, bag_path);
  for (size_t i = 0; i < views.size(); ++i) {
    const Frame& frame = views[i].frame;
    const Frame* right = views[i].right ? &*views[i].right : nullptr;
    recorder.Add({static_cast<int>(i),
                  frame.color,
                  frame.camera,
                  {},
                  frame.cam_from_world,
                  &frame.landmarks_in_world,
                  {},
                  right,
                  options.labels ? &views[i].true_labels : nullptr});
  }
  return recorder.Finish();
}

sensor_msgs::CameraInfo ToCameraInfo(const PinholeCamera& camera, const LensDistortion& distortion,
                                     const std_msgs::Header& header) {
  const LensModel& model = LensModelOf(distortion.model);
  if (distortion.coefficients.size() > model.most) {
    throw InvalidInputError(
        Concat(distortion.coefficients.size(), " distortion coefficients: ", model.name, " has at most ", model.most));
  }
  sensor_msgs::CameraInfo message = *ToCameraInfo(camera, header);
  message.distortion_model = model.name;
  message.D = distortion.coefficients;
  message.D.resize(model.most, 0.0);
  return message;
}

geometry_msgs::PoseStamped ToPoseStamped(const RigidTransform& cam_from_world, const std_msgs::Header& header) {
  geometry_msgs::PoseStamped message;
  message.header = header;
  message.pose = tf2::toMsg(RigidTransform(cam_from_world.inverse()));
  return message;
}

tf2_msgs::TFMessage ToTf(const geometry_msgs::PoseStamped& world_from_cam, const std::string& camera_frame) {
  RigidTransform pose;
  tf2::fromMsg(world_from_cam.pose, pose);
  geometry_msgs::TransformStamped transform = tf2::eigenToTransform(pose);
  transform.header = world_from_cam.header;
  transform.child_frame_id = camera_frame;
  tf2_msgs::TFMessage message;
  message.transforms.push_back(transform);
  return message;
}

sensor_msgs::PointCloud2 ToPointCloud2(const std::vector<Eigen::Vector3d>& points, const std_msgs::Header& header) {
  sensor_msgs::PointCloud2 message;
  message.header = header;
  message.height = 1;
  message.is_dense = true;
  sensor_msgs::PointCloud2Modifier modifier(message);
  modifier.setPointCloud2Fields(3, "x", 1, sensor_msgs::PointField::FLOAT32, "y", 1, sensor_msgs::PointField::FLOAT32,
                                "z", 1, sensor_msgs::PointField::FLOAT32);
  modifier.resize(points.size());
  if (points.empty()) return message;  // the iterator would take the address of the first byte
  sensor_msgs::PointCloud2Iterator<float> value(message, "x");
  for (const Eigen::Vector3d& point : points) {
    for (int axis = 0; axis < 3; ++axis) value[axis] = static_cast<float>(point[axis]);
    ++value;
  }
  return message;
}

}  // namespace acmp
