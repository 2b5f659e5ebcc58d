#include "acmp_mapping/ros/input_sources.h"

#include <atomic>
#include <chrono>
#include <utility>

#include <geometry_msgs/PoseStamped.h>
#include <image_transport/image_transport.h>
#include <sensor_msgs/PointCloud2.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

constexpr uint32_t kImageQueue = 30;
constexpr uint32_t kCameraInfoQueue = 5;
constexpr uint32_t kPoseQueue = 100;
constexpr uint32_t kCloudQueue = 10;

/// Counts arrivals; read by diagnostics from another thread.
class Arrivals {
 public:
  void Count() {
    ++received_;
    last_s_ = SteadySeconds();
  }
  InputStatus ToStatus(std::string topic, uint32_t publishers) const {
    return {std::move(topic), publishers, received_, last_s_};
  }

 private:
  std::atomic<uint64_t> received_{0};
  std::atomic<double> last_s_{SteadySeconds()};
};

/// A plain subscription. `handle` may throw InvalidInputError; it becomes a drop with the given reason.
template <class Message>
class TopicSource : public InputSource {
 public:
  using ConstPtr = typename Message::ConstPtr;

  TopicSource(ros::NodeHandle nh, const std::string& topic, uint32_t queue, std::string reason,
              std::function<void(const ConstPtr&)> handle, DropHandler on_drop)
      : reason_(std::move(reason)), handle_(std::move(handle)), on_drop_(std::move(on_drop)) {
    const boost::function<void(const ConstPtr&)> callback = [this](const ConstPtr& message) { Receive(message); };
    subscriber_ = nh.subscribe<Message>(topic, queue, callback);
  }

  InputStatus status() const override {
    return arrivals_.ToStatus(subscriber_.getTopic(), subscriber_.getNumPublishers());
  }

 private:
  void Receive(const ConstPtr& message) {
    arrivals_.Count();
    try {
      handle_(message);
    } catch (const std::exception& error) {  // one that leaves a callback would end the whole manager
      on_drop_({reason_, Concat(subscriber_.getTopic(), ": ", error.what())});
    }
  }

  std::string reason_;
  std::function<void(const ConstPtr&)> handle_;
  DropHandler on_drop_;
  Arrivals arrivals_;
  ros::Subscriber subscriber_;
};

class RawImageSource : public InputSource {
 public:
  RawImageSource(const ros::NodeHandle& nh, uint32_t queue,
                 std::function<void(const sensor_msgs::ImageConstPtr&)> handle)
      : transport_(nh), handle_(std::move(handle)) {
    const boost::function<void(const sensor_msgs::ImageConstPtr&)> callback =
        [this](const sensor_msgs::ImageConstPtr& message) {
          arrivals_.Count();
          handle_(message);
        };
    subscriber_ = transport_.subscribe(names::kImage, queue, callback, ros::VoidPtr(),
                                       image_transport::TransportHints("raw", ros::TransportHints(), nh));
  }

  InputStatus status() const override {
    return arrivals_.ToStatus(subscriber_.getTopic(), subscriber_.getNumPublishers());
  }

 private:
  image_transport::ImageTransport transport_;
  std::function<void(const sensor_msgs::ImageConstPtr&)> handle_;
  Arrivals arrivals_;
  image_transport::Subscriber subscriber_;
};

/// "image/compressed" if that name is remapped, else beside the image as image_transport's publishers put it.
std::string CompressedTopic(const ros::NodeHandle& nh) {
  const std::string name = std::string(names::kImage) + "/" + names::kCompressedSuffix;
  if (nh.resolveName(name, true) != nh.resolveName(name, false)) return nh.resolveName(name);
  return nh.resolveName(names::kImage) + "/" + names::kCompressedSuffix;
}

}  // namespace

std::unique_ptr<InputSource> MakeImageSource(const ros::NodeHandle& nh, const NodeOptions& options,
                                             const std::function<void(std::shared_ptr<const EncodedImage>)>& on_image,
                                             DropHandler on_drop) {
  // With overload: block the images of a recording wait here, all of them (0: no limit).
  const uint32_t queue = options.overload == OverloadPolicy::kBlock ? 0 : kImageQueue;
  if (options.image_transport == ImageTransport::kRaw) {
    return std::make_unique<RawImageSource>(nh, queue, [on_image](const sensor_msgs::ImageConstPtr& message) {
      on_image(std::make_shared<const EncodedImage>(EncodedImage{message, nullptr}));
    });
  }
  const auto handle = [on_image](const sensor_msgs::CompressedImageConstPtr& message) {
    on_image(std::make_shared<const EncodedImage>(EncodedImage{nullptr, message}));
  };
  return std::make_unique<TopicSource<sensor_msgs::CompressedImage>>(nh, CompressedTopic(nh), queue, "bad_image",
                                                                     handle, std::move(on_drop));
}

std::unique_ptr<InputSource> MakeCameraInfoSource(const ros::NodeHandle& nh,
                                                  const std::function<void(const sensor_msgs::CameraInfo&)>& on_info,
                                                  DropHandler on_drop) {
  const auto handle = [on_info](const sensor_msgs::CameraInfoConstPtr& message) { on_info(*message); };
  return std::make_unique<TopicSource<sensor_msgs::CameraInfo>>(nh, names::kCameraInfo, kCameraInfoQueue,
                                                                "bad_camera_info", handle, std::move(on_drop));
}

std::unique_ptr<InputSource> MakePoseSource(const ros::NodeHandle& nh, const NodeOptions& options,
                                            const std::function<void(PoseSample)>& on_pose, DropHandler on_drop) {
  const PoseSemantics semantics = options.pose;
  const auto handle = [on_pose, semantics](const geometry_msgs::PoseStampedConstPtr& message) {
    const geometry_msgs::Point& position = message->pose.position;
    const geometry_msgs::Quaternion& orientation = message->pose.orientation;
    try {
      const RigidTransform received =
          CheckedTransform(Eigen::Quaterniond(orientation.w, orientation.x, orientation.y, orientation.z),
                           Eigen::Vector3d(position.x, position.y, position.z));
      on_pose({ToStampNs(message->header.stamp), StripLeadingSlash(message->header.frame_id),
               WorldFromCamera(semantics, received)});
    } catch (const InvalidInputError& error) {
      throw InvalidInputError(Concat("pose ", FormatStamp(ToStampNs(message->header.stamp)), ": ", error.what()));
    }
  };
  const uint32_t queue = options.overload == OverloadPolicy::kBlock ? 0 : kPoseQueue;
  return std::make_unique<TopicSource<geometry_msgs::PoseStamped>>(nh, names::kPose, queue, "bad_pose", handle,
                                                                   std::move(on_drop));
}

std::unique_ptr<InputSource> MakeCloudSource(const ros::NodeHandle& nh, const NodeOptions& options,
                                             const std::function<void(SparseCloudPtr)>& on_cloud, DropHandler on_drop) {
  const auto handle = [on_cloud](const sensor_msgs::PointCloud2ConstPtr& message) {
    on_cloud(std::make_shared<const SparseCloud>(ToSparseCloud(*message)));
  };
  const uint32_t queue = options.overload == OverloadPolicy::kBlock ? 0 : kCloudQueue;
  return std::make_unique<TopicSource<sensor_msgs::PointCloud2>>(nh, names::kSparsePoints, queue, "bad_sparse_points",
                                                                 handle, std::move(on_drop));
}

double SteadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace acmp
