#include "ros/scene_player.h"

#include <cmath>

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/pipeline/presets.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/recorder.h"

namespace acmp::test {

ViewMessages MakeMessages(const SyntheticView& view, const ros::Time& stamp) {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = kCameraFrame;
  ViewMessages messages;
  messages.image = *ToColorMessage(view.frame.color, header);
  messages.camera_info = *ToCameraInfo(view.frame.camera, header);
  messages.pose.header.stamp = stamp;
  messages.pose.header.frame_id = kWorldFrame;
  messages.pose.pose = tf2::toMsg(view.frame.cam_from_world.inverse());
  std::vector<Eigen::Vector3f> points;
  for (const Eigen::Vector3d& landmark : view.frame.landmarks_in_world) points.push_back(landmark.cast<float>());
  messages.sparse_points = MakeCloud(points, kWorldFrame, stamp);
  return messages;
}

sensor_msgs::PointCloud2 MakeCloud(const std::vector<Eigen::Vector3f>& points, const std::string& frame_id,
                                   const ros::Time& stamp) {
  sensor_msgs::PointCloud2 cloud;
  cloud.header.stamp = stamp;
  cloud.header.frame_id = frame_id;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  modifier.resize(points.size());
  if (points.empty()) return cloud;  // the iterator would take the address of the first byte
  sensor_msgs::PointCloud2Iterator<float> x(cloud, "x");
  for (const Eigen::Vector3f& point : points) {
    x[0] = point.x();
    x[1] = point.y();
    x[2] = point.z();
    ++x;
  }
  return cloud;
}

ros::Time StampOf(size_t index, uint32_t start_s) {
  return ros::Time(start_s + static_cast<uint32_t>(index / 10), static_cast<uint32_t>(index % 10) * 100000000u);
}

FramePtr MakeExpectedFrame(int64_t id, const ViewMessages& messages) {
  const auto image = boost::make_shared<const sensor_msgs::Image>(messages.image);
  const CameraCalibration calibration = ToCalibration(messages.camera_info, false);
  const RigidTransform world_from_cam = ToTransform(messages.pose.pose);
  Rectifier rectifier(calibration.MakeLens());
  ColorImage rectified = rectifier.Rectify(ImageDecoder().Decode({image, nullptr}));
  return std::make_shared<const Frame>(
      MakeFrame(id, messages.image.header.stamp.toSec(), std::move(rectified), calibration.camera,
                world_from_cam.inverse(), ToSparseCloud(messages.sparse_points).points, {}, rectifier.RectifyMask({})));
}

void SetStamp(const ros::Time& stamp, ViewMessages* messages) {
  messages->image.header.stamp = messages->camera_info.header.stamp = stamp;
  messages->pose.header.stamp = messages->sparse_points.header.stamp = stamp;
}

PipelineMaps MapWithoutRos(const std::vector<ViewMessages>& messages, const std::string& preset) {
  PipelineMaps made;
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [&](const KeyframeDepthPtr& maps) { made.fast[maps->frame->id] = maps; };
  callbacks.on_refined = [&](const KeyframeDepthPtr& maps) { made.refined[maps->frame->id] = maps; };
  const DepthEngineBackend backend = MakeDepthEngine(Device::kCpu);
  DenseMapperOptions options;
  options.pipeline = MakePreset(preset);
  DenseMapper mapper(backend.engine.get(), options, callbacks);
  for (size_t i = 0; i < messages.size(); ++i) {
    mapper.AddKeyframe(MakeExpectedFrame(static_cast<int64_t>(i), messages[i]));
  }
  made.fast_before_flush = made.fast.size();
  mapper.Flush();
  return made;
}

int CountDifferent(const sensor_msgs::Image& message, const Image<float>& map) {
  EXPECT_EQ(message.width, static_cast<uint32_t>(map.width()));
  EXPECT_EQ(message.height, static_cast<uint32_t>(map.height()));
  const auto* values = reinterpret_cast<const float*>(message.data.data());
  int different = 0;
  for (size_t i = 0; i < map.size(); ++i) different += (std::isnan(values[i]) ? 0 : values[i]) != map.data()[i];
  return different;
}

bool ScenePlayer::WaitForMapper() const {
  return WaitUntil([this] {
    return image.getNumSubscribers() > 0 && camera_info.getNumSubscribers() > 0 && pose.getNumSubscribers() > 0 &&
           sparse_points.getNumSubscribers() > 0;
  });
}

void ScenePlayer::Publish(const ViewMessages& messages) const {
  camera_info.publish(messages.camera_info);
  sparse_points.publish(messages.sparse_points);
  image.publish(messages.image);
  pose.publish(messages.pose);
}

}  // namespace acmp::test
