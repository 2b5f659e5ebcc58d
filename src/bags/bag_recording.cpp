#include "acmp_mapping/bags/bag_recording.h"

#include <cmath>
#include <fstream>
#include <iterator>

#include <nav_msgs/Path.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/masks.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/ros/bag_writer.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "bag_messages.h"

namespace acmp {
namespace {

std_msgs::Header MakeHeader(int index, const std::string& frame, const RecordingOptions& options) {
  std_msgs::Header header;
  header.seq = static_cast<uint32_t>(index);
  header.stamp = StampOf(index, options);
  header.frame_id = frame;
  return header;
}

/// All that belongs to one image but its pixels, in the order in which a frontend would send it: the pose comes last,
/// since it triggers the mapper.
void WriteGeometry(BagWriter& writer, int index, const PinholeCamera& camera, const LensDistortion& distortion,
                   const RigidTransform& cam_from_world, const std::vector<Eigen::Vector3d>* landmarks,
                   const RecordingOptions& options) {
  const std_msgs::Header in_camera = MakeHeader(index, options.camera_frame, options);
  const std_msgs::Header in_world = MakeHeader(index, options.world_frame, options);
  const ros::Time& stamp = in_camera.stamp;
  const geometry_msgs::PoseStamped pose = ToPoseStamped(cam_from_world, in_world);
  writer.Write(kCameraInfoTopic, stamp, ToCameraInfo(camera, distortion, in_camera));
  writer.Write(kTfTopic, stamp, ToTf(pose, options.camera_frame));
  if (landmarks != nullptr) writer.Write(kSparsePointsTopic, stamp, ToPointCloud2(*landmarks, in_world));
  writer.Write(kPoseTopic, stamp, pose);
}

/// The poses after the loop closure of all images before it, with their stamps.
nav_msgs::Path MakeOptimizedPath(const SlamRun& slam, const RecordingOptions& options) {
  nav_msgs::Path path;
  path.header = MakeHeader(static_cast<int>(slam.loop_closure), options.world_frame, options);
  for (size_t i = static_cast<size_t>(slam.errors.start); i < slam.loop_closure; ++i) {
    const std_msgs::Header header = MakeHeader(static_cast<int>(i), options.world_frame, options);
    path.poses.push_back(ToPoseStamped(slam.corrected[i].inverse(Eigen::Isometry), header));
  }
  return path;
}

std::string ReadFileBytes(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file || bytes.empty()) throw InvalidInputError(Concat("cannot read ", path));
  return bytes;
}

/// Writes the mask of an image, if it has one, at the size at which the image is in the bag.
void WriteMask(BagWriter& writer, const SceneImage& image, int index, const PinholeCamera& recorded,
               const RecordingOptions& options) {
  if (image.mask.empty()) return;
  const Mask stored = ReadMask(image.mask, {image.camera.width, image.camera.height});
  const std_msgs::Header header = MakeHeader(index, options.camera_frame, options);
  writer.Write(kMaskTopic, header.stamp, ToMaskMessage(ResizeMask(stored, recorded.width, recorded.height), header));
}

/// Writes the pixels and returns the camera that belongs to them.
PinholeCamera WriteSceneImage(BagWriter& writer, const Scene& scene, int index, const RecordingOptions& options) {
  const SceneImage& image = scene.images[index];
  const std_msgs::Header header = MakeHeader(index, options.camera_frame, options);
  ColorImage pixels = LoadImage(scene, index);  // decoded in either case: a truncated file must not get into the bag
  if (options.compressed) {
    writer.Write(std::string(kImageTopic) + "/compressed", header.stamp,
                 ToCompressedMessage(ReadFileBytes(image.path), header));
    return image.camera;
  }
  int width = image.camera.width;
  int height = image.camera.height;
  LimitSize(options.max_image_size, &width, &height);
  if (width != image.camera.width || height != image.camera.height) pixels = Resize(pixels, width, height);
  writer.Write(kImageTopic, header.stamp, *ToColorMessage(pixels, header));
  return image.camera.Resized(width, height);
}

}  // namespace

void Validate(const RecordingOptions& options) {
  CheckRange("rate", options.rate_hz, 0.001, 1000.0);
  CheckRange("start time", options.start_time_s, uint32_t{1}, uint32_t{4000000000});
  CheckRange("max image size", options.max_image_size, 0, 1 << 16);
  if (options.compressed && options.max_image_size > 0) {
    throw InvalidInputError("compressed images are passed through as they are: max image size must be 0");
  }
  if (options.world_frame.empty()) throw InvalidInputError("world frame is empty");
  if (options.camera_frame.empty()) throw InvalidInputError("camera frame is empty");
}

ros::Time StampOf(int index, const RecordingOptions& options) {
  const auto offset_ns = static_cast<uint64_t>(std::llround(1e9 * index / options.rate_hz));
  const uint64_t stamp_s = options.start_time_s + offset_ns / 1000000000u;
  CheckRange("stamp in seconds", stamp_s, uint64_t{1}, uint64_t{4294967295});  // ROS 1 stores 32 bits
  return ros::Time(static_cast<uint32_t>(stamp_s), static_cast<uint32_t>(offset_ns % 1000000000u));
}

RecordingSummary RecordScene(const Scene& scene, const std::vector<int>& indices, const RecordingOptions& options,
                             const std::filesystem::path& bag_path) {
  Validate(options);
  BagWriter writer(bag_path);
  RecordingSummary summary;
  for (const int index : indices) {
    const SceneImage& image = scene.images.at(index);
    const std::vector<Eigen::Vector3d> landmarks = LandmarksOf(scene, image);
    const PinholeCamera camera = WriteSceneImage(writer, scene, index, options);
    WriteMask(writer, image, index, camera, options);
    summary.masks += image.mask.empty() ? 0 : 1;
    WriteGeometry(writer, index, camera, image.distortion, image.cam_from_world,
                  scene.landmarks_in_world.empty() ? nullptr : &landmarks, options);
    ++summary.images;
    summary.landmarks += landmarks.size();
  }
  if (!indices.empty()) {
    summary.duration_s = (StampOf(indices.back(), options) - StampOf(indices.front(), options)).toSec();
  }
  writer.Finish();
  return summary;
}

RecordingSummary RecordSynthetic(const std::vector<SyntheticView>& views, const RecordingOptions& options,
                                 const std::filesystem::path& bag_path, const SlamRun* slam) {
  Validate(options);
  if (slam != nullptr && slam->outputs.size() != views.size()) {
    throw InvalidInputError(
        Concat("the simulated frontend saw ", slam->outputs.size(), " of ", views.size(), " images"));
  }
  if (options.compressed || options.max_image_size > 0) {
    throw InvalidInputError("a synthetic scene is recorded uncompressed and at its own size");
  }
  BagWriter writer(bag_path);
  RecordingSummary summary;
  for (size_t i = 0; i < views.size(); ++i) {
    const int index = static_cast<int>(i);
    const Frame& frame = views[i].frame;
    const std_msgs::Header header = MakeHeader(index, options.camera_frame, options);
    writer.Write(kImageTopic, header.stamp, *ToColorMessage(frame.color, header));
    if (slam != nullptr && i == slam->loop_closure) {
      writer.Write(kOptimizedPathTopic, header.stamp, MakeOptimizedPath(*slam, options));
    }
    const SlamOutput exact = {frame.cam_from_world, frame.landmarks_in_world};
    const SlamOutput& output = slam != nullptr ? slam->outputs[i] : exact;
    WriteGeometry(writer, index, frame.camera, {}, output.cam_from_world, &output.landmarks_in_world, options);
    ++summary.images;
    summary.landmarks += output.landmarks_in_world.size();
    summary.duration_s = (header.stamp - StampOf(0, options)).toSec();
  }
  writer.Finish();
  return summary;
}

}  // namespace acmp
