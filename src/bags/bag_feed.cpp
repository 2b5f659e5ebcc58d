#include "bag_feed.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <limits>
#include <memory>

#include <rosbag/view.h>

#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/ros/checked_messages.h"

namespace acmp {
namespace {

constexpr int64_t kBetweenViewsNs = 200000000;  ///< of images that are matched: a camera moves by some cm
// Images that are matched, at most: rows of them, since where poses look alike at the start those of others tell.
constexpr size_t kViewsInARow = 12, kRows = 4;

class BagFeed {
 public:
  BagFeed(const BagTopics& topics, const NodeOptions& options, const TransformSource& transforms)
      : topics_(topics),
        options_(options),
        intake_(options, 0, transforms),
        row_s_(topics.Find(topics.chosen.image).duration_s / kRows) {
    run_.images_of_poses = std::make_unique<ReadingCheck>(kRows * kViewsInARow);
    intake_.set_clouds_expected(!topics.chosen.sparse_points.empty());
    intake_.set_companion_expected(kMaskStream, !topics.chosen.mask.empty());
    run_.source_images.resize(topics.chosen.source_images.size());
    for (size_t i = 0; i < run_.source_images.size(); ++i) intake_.set_companion_expected(kSourceStream + i, true);
    if (!options.calibration_file.empty()) TakeInfo(ReadCalibrationFile(options.calibration_file));
  }

  IntakeRun Run(const rosbag::Bag& bag) {
    const TopicChoice& chosen = topics_.chosen;
    std::vector<std::string> topics = {chosen.image, chosen.pose, chosen.sparse_points, chosen.mask};
    if (options_.calibration_file.empty()) topics.push_back(chosen.camera_info);
    for (const auto* more : {&chosen.source_images, &chosen.source_camera_infos}) {
      topics.insert(topics.end(), more->begin(), more->end());
    }
    for (const rosbag::MessageInstance& record : rosbag::View(bag, rosbag::TopicQuery(topics))) {
      ReadMessage(record);
      Take(intake_.Take(record.getTime().toSec()));
    }
    Take(intake_.TakeAll());
    const std::string wait = intake_.DescribeWait(std::numeric_limits<double>::infinity());
    if (!wait.empty() && run_.infos.size() > 0) run_.warnings.push_back("images wait: " + wait);
    run_.share_in_front = intake_.share_in_front();
    run_.semantics = intake_.pose_semantics();
    return std::move(run_);
  }

 private:
  /// use(message) for a record of this type; nothing of another type.
  template <class Message, class Use>
  void With(const rosbag::MessageInstance& record, Stream* stream, const Use& use) {
    if (record.getDataType() != ros::message_traits::DataType<Message>::value()) return;
    try {
      const boost::shared_ptr<Message> message = InstantiateChecked<Message>(record);
      if (!message) {
        throw InvalidInputError(
            Concat("recorded with another definition of ", record.getDataType(), "; convert it with: rosbag fix"));
      }
      use(message);
    } catch (const InvalidInputError& error) {
      if (stream->refused++ == 0) stream->refusal = error.what();
    }
  }

  void ReadMessage(const rosbag::MessageInstance& record) {
    const TopicChoice& chosen = topics_.chosen;
    const std::string& topic = record.getTopic();
    const auto take_pose = [this](const auto& message) { TakePose(ToPoseSample(*message)); };
    const auto take_cloud = [this](const auto& message) { TakeCloud(ToSparseCloud(*message)); };
    for (size_t i = 0; i < chosen.source_images.size(); ++i) {
      if (topic == chosen.source_camera_infos[i]) {
        With<sensor_msgs::CameraInfo>(record, &run_.source_images[i],
                                      [&](const auto& info) { intake_.AddSourceCameraInfo(i, *info); });
      }
      if (topic != chosen.source_images[i]) continue;
      WithImage(record, &run_.source_images[i], [&](const EncodedImage& image) {
        DecodeRgb(image);
        intake_.AddCompanion(kSourceStream + i, {Count(image.header(), &run_.source_images[i]),
                                                 std::make_shared<const EncodedImage>(image)});
      });
    }
    if (topic == chosen.image) {
      WithImage(record, &run_.images, [&](const EncodedImage& image) {
        const cv::Mat rgb = DecodeRgb(image);  // as the mapper does it later
        run_.encoding = image.raw ? image.raw->encoding : image.compressed->format;
        run_.sizes.insert({rgb.cols, rgb.rows});
        Count(image.header(), &run_.images);
        intake_.AddImage(std::make_shared<const EncodedImage>(image));
      });
    } else if (topic == chosen.mask) {
      With<sensor_msgs::Image>(record, &run_.masks, [&](const auto& mask) { TakeMask(mask); });
    } else if (topic == chosen.camera_info) {
      With<sensor_msgs::CameraInfo>(record, &run_.infos, [&](const auto& info) { TakeInfo(*info); });
    } else if (topic == chosen.pose) {
      With<geometry_msgs::PoseStamped>(record, &run_.poses, take_pose);
      With<geometry_msgs::PoseWithCovarianceStamped>(record, &run_.poses, take_pose);
      With<nav_msgs::Odometry>(record, &run_.poses, take_pose);
      With<geometry_msgs::TransformStamped>(record, &run_.poses, take_pose);
    } else if (topic == chosen.sparse_points) {
      With<sensor_msgs::PointCloud2>(record, &run_.clouds, take_cloud);
      With<sensor_msgs::PointCloud>(record, &run_.clouds, take_cloud);
    }
  }

  void Count(int64_t stamp_ns, const std::string& frame, Stream* stream) {
    stream->stamps_ns.push_back(stamp_ns);
    stream->frame = StripLeadingSlash(frame);
  }
  /// Returns the stamp.
  int64_t Count(const std_msgs::Header& header, Stream* stream) {
    const int64_t stamp_ns = ToStampNs(header.stamp);
    Count(stamp_ns, header.frame_id, stream);
    return stamp_ns;
  }

  template <class Use>
  void WithImage(const rosbag::MessageInstance& record, Stream* stream, const Use& use) {
    const std::string& topic = record.getTopic();
    With<sensor_msgs::Image>(record, stream, [&](const auto& raw) { use(EncodedImage{raw, nullptr, topic}); });
    With<sensor_msgs::CompressedImage>(record, stream, [&](const auto& file) {
      use(EncodedImage{nullptr, file, topic});
    });
  }

  void TakeInfo(const sensor_msgs::CameraInfo& info) {
    intake_.AddCameraInfo(info);
    run_.calibration = ToCalibration(info, options_.rectified);
    run_.names_a_model = !info.distortion_model.empty() || !info.D.empty();
    Count(info.header, &run_.infos);
  }

  void TakePose(PoseSample pose) {
    const Eigen::Vector3d position = pose.received.translation();
    if (run_.poses.used() > 0) run_.path += (position - last_position_).norm();
    last_position_ = position;
    run_.child_frame = pose.child_frame;
    Count(pose.stamp_ns, pose.world_frame, &run_.poses);
    intake_.AddPose(std::move(pose));
  }

  void TakeCloud(SparseCloud cloud) {
    Count(cloud.stamp_ns, cloud.frame_id, &run_.clouds);
    intake_.AddCloud(std::make_shared<const SparseCloud>(std::move(cloud)));
  }

  void TakeMask(const sensor_msgs::ImageConstPtr& message) {
    ImageSample mask = ToMaskSample(message);
    if (run_.calibration) DecodeMask(*mask.image, run_.calibration->camera);  // as the mapper does it later
    Count(message->header, &run_.masks);
    intake_.AddCompanion(kMaskStream, std::move(mask));
  }

  void Take(std::vector<IntakeEvent> events) {
    for (IntakeEvent& event : events) {
      if (const auto* keyframe = std::get_if<KeyframeInput>(&event)) TakeKeyframe(*keyframe);
      if (const auto* world = std::get_if<NewWorld>(&event)) run_.warnings.push_back(world->text);
      if (const auto* notice = std::get_if<Notice>(&event)) {
        if (notice->warning) run_.convention_warnings.push_back(notice->text);
        if (notice->text.rfind("source camera", 0) == 0) run_.source_places = notice->text;
      }
      run_.time_jumps += std::holds_alternative<TimeJump>(event);
      if (const auto* rejected = std::get_if<RejectedInput>(&event)) {
        IntakeRun::Rejection& rejection = run_.rejections[rejected->reason];
        if (rejection.count++ == 0) rejection.first = rejected->message;
        run_.posed += rejected->ends_image && rejected->reason != "no_pose";
      }
    }
  }

  void TakeKeyframe(const KeyframeInput& keyframe) {
    ++run_.keyframes;
    ++run_.posed;
    run_.masked += keyframe.mask != nullptr;
    for (const SourceImage& source : keyframe.source_images) ++run_.with_source[source.image->topic];
    TakeView(keyframe);
    const auto range = DepthRangeFromLandmarks(keyframe.landmarks_in_world, keyframe.calibration->camera,
                                               keyframe.world_from_cam.inverse());
    if (!range) return;
    if (!run_.range) run_.range = range;
    run_.range->min = std::min(run_.range->min, range->min);
    run_.range->max = std::max(run_.range->max, range->max);
  }

  /// For matches between images, where its turn has come.
  void TakeView(const KeyframeInput& keyframe) {
    constexpr int kSize = 640;  // px
    if (!first_ns_) first_ns_ = keyframe.stamp_ns;
    if (view_ns_ && std::llabs(keyframe.stamp_ns - *view_ns_) < kBetweenViewsNs) return;
    view_ns_ = keyframe.stamp_ns;
    const double since_start_s = std::max(0.0, static_cast<double>(keyframe.stamp_ns - *first_ns_) * 1e-9);
    const size_t row = row_s_ > 0 ? static_cast<size_t>(std::min(since_start_s / row_s_, kRows - 1.0)) : 0;
    if (views_[row]++ >= kViewsInARow) return;
    const RigidTransform cam_from_world = keyframe.world_from_cam.inverse();
    const auto frame_of = [&](const EncodedImage& image, const CalibrationPtr& calibration,
                              const RigidTransform& pose) {
      RectifiedCamera& camera = cameras_[image.topic];
      if (camera.calibration != calibration) {
        camera.calibration = calibration;
        const Lens lens = calibration->MakeLens();
        camera.rectifier.emplace(lens, FacesOf(lens).front());
      }
      const PinholeFace& face = camera.rectifier->face();
      return MakeFrame(0, 0, camera.rectifier->Rectify(DecodeRgb(image)), face.camera,
                       RigidTransform(face.lens_from_face.transpose()) * pose, keyframe.landmarks_in_world, kSize);
    };
    try {
      const Frame frame = frame_of(*keyframe.image, keyframe.calibration, cam_from_world);
      run_.images_of_poses->Add(frame);
      for (const SourceImage& source : keyframe.source_images) {
        run_.rigs[source.image->topic].Add(
            frame, frame_of(*source.image, source.calibration, source.source_from_cam * cam_from_world));
      }
    } catch (const InvalidInputError&) {  // of another size than its camera's, which is told
    }
  }

  const BagTopics& topics_;
  const NodeOptions& options_;
  KeyframeIntake intake_;
  IntakeRun run_;
  Eigen::Vector3d last_position_ = Eigen::Vector3d::Zero();
  const double row_s_;  ///< of the recording, from which a row of images is matched
  std::array<size_t, kRows> views_ = {};
  std::optional<int64_t> first_ns_, view_ns_;  ///< of keyframes: the first; the last that might be matched
  struct RectifiedCamera {
    CalibrationPtr calibration;
    std::optional<Rectifier> rectifier;  ///< of that
  };
  std::map<std::string, RectifiedCamera> cameras_;  ///< by topic
};

}  // namespace

IntakeRun FeedBag(const rosbag::Bag& bag, const BagTopics& topics, const NodeOptions& options,
                  const TransformSource& transforms) {
  return BagFeed(topics, options, transforms).Run(bag);
}

}  // namespace acmp
