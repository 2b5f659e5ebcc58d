#include "acmp_mapping/ros/output_publisher.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <utility>
#include <vector>

#include <acmp_mapping/KeyframeDepth.h>
#include <geometry_msgs/PoseStamped.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_eigen/tf2_eigen.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

constexpr uint32_t kQueue = 5;       ///< keyframes come at a few hertz; a slow listener loses old ones, not new ones
constexpr size_t kWaiting = 10;      ///< first keyframes that are kept for a map that is loaded a moment later
constexpr uint32_t kMapQueue = 200;  ///< the same for maps on other hosts, which notice what they lose

std_msgs::Header MakeHeader(int64_t stamp_ns, const std::string& frame_id) {
  std_msgs::Header header;
  header.stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
  header.frame_id = frame_id;
  return header;
}

const ReceivedFrame& Received(const FramePtr& frame) { return static_cast<const ReceivedFrame&>(*frame); }

double LatencyMs(const ReceivedFrame& frame) { return (SteadySeconds() - frame.origin->arrival_s) * 1e3; }

std_msgs::Header CameraHeader(const KeyframeOutput& output) {
  return MakeHeader(output.origin().stamp_ns, output.frame().frame_id());
}

// What is published of a keyframe.

sensor_msgs::CameraInfoPtr CameraInfoOf(const KeyframeOutput& output) {
  return ToCameraInfo(output.maps->frame->camera, CameraHeader(output));
}

sensor_msgs::ImagePtr DepthImageOf(const KeyframeOutput& output) {
  return ToDepthMessage(output.maps->depth, output.keep.View(), CameraHeader(output));
}

sensor_msgs::ImagePtr ColorImageOf(const KeyframeOutput& output) {
  return ToColorMessage(output.maps->frame->color, CameraHeader(output));
}

sensor_msgs::ImagePtr NormalImageOf(const KeyframeOutput& output) {
  return ToNormalMessage(output.maps->normal, output.keep.View(), CameraHeader(output));
}

/// Of the depth picture, from this confidence on; below it is dark, so that guesses do not look like surfaces.
constexpr float kFullBrightness = 0.5f;

sensor_msgs::ImagePtr DepthPictureOf(const KeyframeOutput& output) {
  DepthMap kept = output.maps->depth.Clone();
  for (size_t i = 0; i < kept.size(); ++i) {
    if (!output.keep.data()[i]) kept.data()[i] = 0;
  }
  ColorImage picture = DepthPicture(kept);
  for (size_t i = 0; i < picture.size(); ++i) {
    const float brightness = std::min(1.0f, output.maps->confidence.data()[i] / kFullBrightness);
    Rgb* color = &picture.data()[i];
    for (unsigned char* channel : {&color->r, &color->g, &color->b}) {
      *channel = static_cast<unsigned char>(std::lround(brightness * *channel));
    }
  }
  return ToColorMessage(picture, CameraHeader(output));
}

sensor_msgs::ImagePtr NormalPictureOf(const KeyframeOutput& output) {
  return ToColorMessage(NormalPicture(output.maps->normal), CameraHeader(output));
}

sensor_msgs::ImagePtr ConfidencePictureOf(const KeyframeOutput& output) {
  return ToColorMessage(ConfidencePicture(output.maps->confidence), CameraHeader(output));
}

/// 0 where the lens saw nothing.
sensor_msgs::ImagePtr ConfidenceImageOf(const KeyframeOutput& output) {
  sensor_msgs::ImagePtr message = ToFloatMessage(output.maps->confidence, CameraHeader(output));
  float* values = reinterpret_cast<float*>(message->data.data());
  for (const unsigned char keep : output.keep) {
    if (!keep) *values = 0;
    ++values;
  }
  return message;
}

/// In the frame of the capture's camera. Receivers of the topic put the points where the frontend's pose says that it
/// was: so that they come to lie where the pose does with which they were matched, they are moved.
sensor_msgs::PointCloud2Ptr ToPointsAtReceivedPose(const KeyframeOutput& output, const std_msgs::Header& header) {
  const KeyframeDepth& maps = *output.maps;
  if (!maps.refined_camera && output.frame().face.name.empty())
    return ToCloudMessage(output.points_in_camera(), header);
  RigidTransform received_from_matched = RigidTransform::Identity();
  if (maps.refined_camera) received_from_matched = maps.frame->cam_from_world * maps.cam_from_world.inverse();
  const Eigen::Isometry3f capture_from_points =
      (RigidTransform(output.frame().face.lens_from_face) * received_from_matched).cast<float>();
  PointCloud points = output.points_in_camera();
  for (SurfacePoint& point : points) {
    const Eigen::Vector3f position =
        capture_from_points * Eigen::Vector3f(point.position.x, point.position.y, point.position.z);
    const Eigen::Vector3f normal =
        capture_from_points.linear() * Eigen::Vector3f(point.normal.x, point.normal.y, point.normal.z);
    point.position = {position.x(), position.y(), position.z()};
    point.normal = {normal.x(), normal.y(), normal.z()};
  }
  return ToCloudMessage(points, header);
}

}  // namespace

OutputPublisher::OutputPublisher(ros::NodeHandle nh, std::string mapper, const IncidentLog* incidents,
                                 std::function<void(const RejectedInput&)> report)
    : mapper_(std::move(mapper)), incidents_(incidents), report_(std::move(report)), transport_(nh), nh_(nh) {
  Advertise("", &image_topics_[""]);
  points_ = nh.advertise<sensor_msgs::PointCloud2>(names::kPoints, kQueue);
  pose_ = nh.advertise<geometry_msgs::PoseStamped>(names::kKeyframePose, kQueue);
  keyframe_points_ = nh.advertise<acmp_mapping::KeyframePoints>(names::kKeyframePoints, kMapQueue);
  keyframe_depth_ = nh.advertise<acmp_mapping::KeyframeDepth>(names::kKeyframeDepth, kQueue);
}

void OutputPublisher::Advertise(const std::string& face, ImageTopics* topics) {
  constexpr bool kLatched = true;  // for who is not the first of its process: roscpp then gives what that one has got
  const std::string prefix = face.empty() ? "" : names::kFacePrefix + face + "/";
  topics->depth_fast = transport_.advertiseCamera(prefix + names::kDepthFast, kQueue);
  for (const auto& [name, make] :
       {std::pair<const char*, MakeImage>(names::kDepth, &DepthImageOf), {names::kColor, &ColorImageOf}}) {
    topics->refined.push_back({[this, face, topic = prefix + name, make = make]() -> ImagePublisher {
      const auto publisher = transport_.advertiseCamera(topic, kQueue, ForNewcomers(face, make), {},
                                                        ForNewcomers(face, &CameraInfoOf), {}, {}, kLatched);
      return {[publisher] { return publisher.getNumSubscribers(); },
              [publisher, make](const KeyframeOutput& o) { publisher.publish(make(o), CameraInfoOf(o)); }};
    }});
  }
  const auto add = [topics](const MakeImage& make, const auto& advertise) {
    topics->refined.push_back({[advertise, make]() -> ImagePublisher {
      const auto publisher = advertise();
      return {[publisher] { return publisher.getNumSubscribers(); },
              [publisher, make](const KeyframeOutput& o) { publisher.publish(make(o)); }};
    }});
  };
  const MakeImage make_millimetres = [](const KeyframeOutput& o) { return ToDepthMillimetres(*DepthImageOf(o)); };
  add(make_millimetres, [this, face, topic = prefix + names::kDepthMillimetres, make_millimetres] {
    return nh_.advertise<sensor_msgs::Image>(topic, kQueue, ForNewcomers(face, make_millimetres), {}, {}, kLatched);
  });
  const std::pair<const char*, MakeImage> others[] = {{names::kDepthPicture, &DepthPictureOf},
                                                      {names::kConfidence, &ConfidenceImageOf},
                                                      {names::kConfidencePicture, &ConfidencePictureOf},
                                                      {names::kNormal, &NormalImageOf},
                                                      {names::kNormalPicture, &NormalPictureOf}};
  for (const auto& [name, make] : others) {
    add(make, [this, face, topic = prefix + name, make = make] {
      return transport_.advertise(topic, kQueue, ForNewcomers(face, make), {}, {}, kLatched);
    });
  }
}

void OutputPublisher::ForgetNewest() {
  UpdateStatus([this](OutputStatus* /*status*/) { newest_.clear(); });
  const double end_s = SteadySeconds() + 1;
  for (auto& [face, topics] : image_topics_) {
    for (RefinedTopic& topic : topics.refined) {
      if (!std::exchange(topic.has_published, false)) continue;
      const uint32_t listeners = topic.publisher.listeners();
      topic.publisher = {};  // roscpp forgets what it holds only with the publisher
      topic.publisher = topic.advertise();
      while (topic.publisher.listeners() < listeners && SteadySeconds() < end_s) ros::WallDuration(0.005).sleep();
    }
  }
}

OutputPublisher::ImageTopics& OutputPublisher::TopicsOf(const ReceivedFrame& frame) {
  const auto [found, is_new] = image_topics_.try_emplace(frame.face.name);
  if (is_new) {
    Advertise(frame.face.name, &found->second);
    if (!face_frames_) face_frames_ = std::make_unique<tf2_ros::StaticTransformBroadcaster>();
    geometry_msgs::TransformStamped face = tf2::eigenToTransform(RigidTransform(frame.face.lens_from_face));
    face.header = MakeHeader(frame.origin->stamp_ns, frame.origin->camera_frame);
    face.child_frame_id = frame.frame_id();
    face_frames_->sendTransform(face);
  }
  return found->second;
}

DenseMapper::Callbacks OutputPublisher::MakeCallbacks() {
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [this](const KeyframeDepthPtr& maps) { HandleFast(maps); };
  callbacks.on_refined = [this](const KeyframeDepthPtr& maps) { HandleRefined(maps); };
  // For the map: each keyframe's depth and points are published once.
  callbacks.on_refined_again = [this](const KeyframeDepthPtr& maps) {
    Publish(maps, [this](const KeyframeOutput& output) { PublishKeyframePoints(output, true); });
    UpdateStatus([&](OutputStatus* status) { status->refined_again += Received(maps->frame).is_first() ? 1 : 0; });
  };
  // Better points for the map: none.
  callbacks.on_withdrawn = [this](const KeyframeDepthPtr& maps, const std::string& message) {
    Publish(maps, [this](const KeyframeOutput& output) { PublishKeyframePoints(output, true); });
    UpdateStatus([&](OutputStatus* status) { status->withdrawn += Received(maps->frame).is_first() ? 1 : 0; });
    Report({"withdrawn", Concat(Received(maps->frame).name(), " leaves the map: ", message)});
  };
  callbacks.on_drop = [this](const KeyframeDrop& drop) { HandleDrop(drop); };
  callbacks.on_problem = [this](const std::string& reason, const std::string& message) { Report({reason, message}); };
  return callbacks;
}

void OutputPublisher::Report(const RejectedInput& rejected) const {
  if (!stopping_) report_(rejected);
}

OutputStatus OutputPublisher::status() const {
  const std::lock_guard<std::mutex> lock(status_mutex_);
  return status_;
}

template <class PublishOutput>
void OutputPublisher::Publish(const KeyframeDepthPtr& maps, const PublishOutput& publish) {
  if (stopping_) return;
  try {
    publish(MakeKeyframeOutput(maps, min_depth_confidence_));
  } catch (const std::exception& error) {
    Report({"publish_error", Concat(Received(maps->frame).name(), ": ", error.what())});
  }
}

void OutputPublisher::HandleFast(const KeyframeDepthPtr& maps) {
  const ReceivedFrame& frame = Received(maps->frame);
  if (frame.is_first()) reading_check_.Add(frame);
  Publish(maps, [&](const KeyframeOutput& output) {
    if (frame.is_first()) PublishPose(*frame.origin);
    const ImageTopics& topics = TopicsOf(frame);
    if (topics.depth_fast.getNumSubscribers() > 0) {
      topics.depth_fast.publish(DepthImageOf(output), CameraInfoOf(output));
    }
  });
  if (!frame.is_first()) return;
  UpdateStatus([&](OutputStatus* status) {
    ++status->fast;
    status->fast_latency.Add(LatencyMs(frame));
  });
}

void OutputPublisher::HandleRefined(const KeyframeDepthPtr& maps) {
  const ReceivedFrame& frame = Received(maps->frame);
  // First: what is published says how many images are still under way.
  UpdateStatus([&](OutputStatus* status) {
    if (frame.is_first()) status->CountRefined(*maps);
    newest_[frame.face.name] = maps;
  });
  Publish(maps, [&](const KeyframeOutput& output) {
    PublishRefined(output);
    if (!frame.is_first()) return;  // a ceiling may have no points, image after image
    std::string without_points;
    UpdateStatus([&](OutputStatus* status) {
      status->CountPoints(output);
      without_points = status->DescribeRunWithoutPoints();
    });
    if (!without_points.empty()) Report({"no_points", Concat(frame.name(), ": ", without_points)});
  });
  if (!maps->prior_depth_rejection.empty()) {
    Report(
        {"unused_prior_depth", Concat(frame.name(), ": its prior depth is not used: ", maps->prior_depth_rejection)});
  }
  if (frame.is_first()) UpdateStatus([&](OutputStatus* status) { status->refined_latency.Add(LatencyMs(frame)); });
}

void OutputPublisher::HandleDrop(const KeyframeDrop& drop) {
  const ReceivedFrame& frame = Received(drop.frame);
  if (!drop.had_fast && frame.is_first()) reading_check_.Add(frame);
  Report({drop.reason, Concat(frame.name(), drop.had_fast ? " (refinement only): " : ": ", drop.message),
          frame.is_first()});
}

void OutputPublisher::PublishRefined(const KeyframeOutput& output) {
  for (RefinedTopic& topic : TopicsOf(output.frame()).refined) {
    if (topic.publisher.listeners() == 0) continue;
    topic.publisher.publish(output);
    topic.has_published = true;
  }
  if (points_.getNumSubscribers() > 0) {
    const std_msgs::Header header = MakeHeader(output.origin().stamp_ns, output.origin().camera_frame);
    points_.publish(ToPointsAtReceivedPose(output, header));
  }
  PublishKeyframeDepth(output);
  PublishKeyframePoints(output, false);
}

void OutputPublisher::PublishKeyframePoints(const KeyframeOutput& output, bool replaces) {
  const bool is_first_map_to_come = points_sent_ == 0;
  if (maps() == 0 && (!is_first_map_to_come || waiting_.size() >= kWaiting)) return;
  waiting_.push_back(ToKeyframePoints(output, mapper_, replaces));
  const uint64_t images = images_, finished = status().refined + incidents_->images() + passed_over_;
  waiting_.back()->images_under_way = images > finished ? images - finished : 0;  // the numbers are not of one moment
  if (maps() == 0) return;
  for (acmp_mapping::KeyframePointsPtr& message : std::exchange(waiting_, {})) {
    message->count = ++points_sent_;
    keyframe_points_.publish(message);
  }
}

void OutputPublisher::PublishPose(const CaptureOrigin& origin) {
  if (pose_.getNumSubscribers() == 0) return;
  auto pose = boost::make_shared<geometry_msgs::PoseStamped>();
  pose->header = MakeHeader(origin.stamp_ns, origin.world_frame);
  pose->pose = tf2::toMsg(origin.world_from_cam);
  pose_.publish(pose);
}

void OutputPublisher::PublishKeyframeDepth(const KeyframeOutput& output) {
  if (keyframe_depth_.getNumSubscribers() == 0) return;
  const KeyframeDepth& maps = *output.maps;
  auto message = boost::make_shared<acmp_mapping::KeyframeDepth>();
  message->header = MakeHeader(output.origin().stamp_ns, output.origin().world_frame);
  message->pose = tf2::toMsg(output.frame().world_from_cam());
  message->refined_pose = tf2::toMsg(maps.cam_from_world.inverse());
  constexpr float kNotMeasured = std::numeric_limits<float>::quiet_NaN();
  message->epipolar_residual = maps.pose_fit.matches > 0 ? static_cast<float>(maps.pose_fit.median_px) : kNotMeasured;
  for (const GapFit& fit : maps.pose_fit.by_gap) {
    std::vector<float>& by_gap = message->epipolar_residual_by_gap;
    by_gap.resize(static_cast<size_t>(std::ilogb(fit.gap)) + 1, kNotMeasured);
    by_gap.back() = static_cast<float>(fit.median_px);
  }
  message->camera_info = *CameraInfoOf(output);
  message->depth = *DepthImageOf(output);
  message->confidence = *ConfidenceImageOf(output);
  message->normal = *NormalImageOf(output);
  message->depth_min = maps.range.min;
  message->depth_max = maps.range.max;
  keyframe_depth_.publish(message);
}

}  // namespace acmp
