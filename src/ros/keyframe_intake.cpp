#include "acmp_mapping/ros/keyframe_intake.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {
namespace {

// tf and rviz refuse empty names.
constexpr char kNamelessCamera[] = "camera_optical";
constexpr char kNamelessWorld[] = "world";

constexpr double kLongPoseWaitS = 3;  ///< late poses come within a second

/// Median depth of the points in front of the camera; 0 when there are none. A sample of a whole map is enough.
double MedianDepth(const std::vector<Eigen::Vector3d>& points_in_world, const RigidTransform& world_from_cam) {
  constexpr size_t kSample = 2000;
  const RigidTransform cam_from_world = world_from_cam.inverse();
  const size_t step = 1 + points_in_world.size() / kSample;
  std::vector<double> depths;
  for (size_t i = 0; i < points_in_world.size(); i += step) {
    const double depth = (cam_from_world * points_in_world[i]).z();
    if (depth > 0) depths.push_back(depth);
  }
  return depths.empty() ? 0 : Median(std::move(depths));
}

}  // namespace

KeyframeIntake::KeyframeIntake(const NodeOptions& options, double fallback_depth, const TransformSource& transforms)
    : options_(options),
      transforms_(transforms),
      matcher_(options.matcher),
      sources_(options, transforms),
      resolver_(options.pose, options.extrinsic_inverted, transforms.find_latest, PathChild(options)),
      fallback_depth_(fallback_depth) {}

void KeyframeIntake::AddImage(std::shared_ptr<const EncodedImage> image, double arrival_s) {
  const int64_t stamp_ns = ToStampNs(image->header().stamp);
  image_frame_ = StripLeadingSlash(image->header().frame_id);
  matcher_.AddImage({stamp_ns, std::move(image), arrival_s});
}

void KeyframeIntake::AddCameraInfo(const sensor_msgs::CameraInfo& info) {
  try {
    calibrations_.Add(info, options_);
  } catch (const InvalidInputError&) {
    UpdateObstacle();  // images wait from now on
    throw;
  }
  UpdateObstacle();
}

void KeyframeIntake::AddPose(PoseSample pose) {
  child_frame_ = pose.child_frame;
  matcher_.AddPose(std::move(pose));
}

void KeyframeIntake::AddKeyframe(const acmp_mapping::KeyframeConstPtr& keyframe, double arrival_s) {
  // Everything is converted before anything is taken: a keyframe is used as a whole or not at all.
  PoseSample pose = ToPoseSample(keyframe->header, keyframe->child_frame_id, keyframe->pose);
  SparseCloudPtr cloud;
  if (keyframe->points.width > 0 && keyframe->points.height > 0) {
    SparseCloud sparse = ToSparseCloud(keyframe->points);
    sparse.stamp_ns = pose.stamp_ns;
    cloud = std::make_shared<const SparseCloud>(std::move(sparse));
  }
  // Parts of the message share its life.
  EncodedImage image;
  if (keyframe->image.data.empty()) {
    image.compressed = sensor_msgs::CompressedImageConstPtr(keyframe, &keyframe->compressed_image);
  } else {
    image.raw = sensor_msgs::ImageConstPtr(keyframe, &keyframe->image);
  }
  if (options_.calibration_file.empty()) AddCameraInfo(keyframe->camera_info);
  image_frame_ = StripLeadingSlash(image.header().frame_id);
  if (cloud) AddCloud(std::move(cloud));
  const int64_t stamp_ns = pose.stamp_ns;
  AddPose(std::move(pose));
  matcher_.AddImage({stamp_ns, std::make_shared<const EncodedImage>(std::move(image)), arrival_s});
}

std::string KeyframeIntake::CameraFrame() const {
  if (!options_.camera_frame.empty()) return options_.camera_frame;
  const CalibrationPtr& calibration = calibrations_.last().calibration;
  return image_frame_.empty() && calibration ? calibration->frame_id : image_frame_;
}

void KeyframeIntake::UpdateObstacle() {
  resolver_.Update(options_.body_frame.empty() ? child_frame_ : options_.body_frame, CameraFrame());
  std::optional<RejectedInput> obstacle;
  if (!calibrations_.last().calibration) {
    obstacle = RejectedInput{"no_camera_info", "no usable camera_info has been received"};
  } else if (!resolver_.ready()) {
    obstacle = RejectedInput{"no_extrinsic", resolver_.DescribeMissing()};
  }
  matcher_.set_obstacle(obstacle);
}

void KeyframeIntake::Prepare() {
  UpdateObstacle();
  LookUpPoses();
}

void KeyframeIntake::LookUpPoses() {
  if (options_.pose_source != kTfPoses || !transforms_.find_pose) return;
  const bool body = options_.pose.child == PoseSemantics::Child::kBody;
  const std::string child = body ? options_.body_frame : CameraFrame();
  for (const int64_t stamp_ns : matcher_.UnposedStamps()) {
    if (child.empty()) {
      matcher_.SetPoseProblem(stamp_ns, "the images have no frame_id: set ~camera_frame");
      continue;
    }
    auto found = transforms_.find_pose(options_.world_frame, child, stamp_ns);
    if (auto* pose = std::get_if<PoseSample>(&found)) {
      AddPose(std::move(*pose));
    } else {
      matcher_.SetPoseProblem(stamp_ns, std::get<std::string>(found));
    }
  }
}

std::vector<IntakeEvent> KeyframeIntake::Take(double now_s) {
  Prepare();
  return Convert(matcher_.Take(now_s));
}

std::vector<IntakeEvent> KeyframeIntake::TakeAll() {
  Prepare();
  std::vector<IntakeEvent> events = Convert(matcher_.TakeAll());
  UseStarting(&events);
  return events;
}

void KeyframeIntake::Clear() {
  matcher_.Clear("reset");
  RejectStarting("reset", "the frontend was starting", &forgotten_);
  StartOver();
  convention_check_ = ConventionCheck();
}

void KeyframeIntake::StartOver() {
  world_.Reset();
  scene_depth_ = 0;
}

std::vector<IntakeEvent> KeyframeIntake::Convert(std::vector<MatchEvent> matched) {
  std::vector<IntakeEvent> events = std::exchange(forgotten_, {});
  if (auto notice = resolver_.TakeNotice()) events.emplace_back(Notice{false, std::move(*notice)});
  for (MatchEvent& event : matched) {
    if (auto* match = std::get_if<MatchedInput>(&event)) {
      Convert(*match, &events);
    } else if (auto* drop = std::get_if<RejectedInput>(&event)) {
      events.emplace_back(std::move(*drop));
    } else {
      UseStarting(&events);
      StartOver();
      events.emplace_back(std::get<TimeJump>(event));
    }
  }
  return events;
}

std::string KeyframeIntake::DescribeDoubt() const {
  if (options_.pose.child == PoseSemantics::Child::kBody) {
    return "; or T_body_cam is wrong, or its inverse (~extrinsic_inverted, for the topic extrinsic)";
  }
  const std::string camera = CameraFrame();
  if (child_frame_.empty() || camera.empty() || child_frame_ == camera) return "";
  return Concat("; the poses are those of \"", child_frame_, "\" (child_frame_id), the images of \"", camera,
                "\", and poses are read as those of the camera: if the first is another frame, set ~pose_child: body, "
                "which takes T_body_cam from tf or the parameter");
}

std::string KeyframeIntake::DescribeWait(double now_s) const {
  if (!starting_.empty()) return "the frontend starts, and its points have not settled";
  if (matcher_.waiting_images() == 0) return "";
  if (matcher_.obstacle()) return matcher_.obstacle()->message;
  const auto wait = matcher_.longest_pose_wait();
  return wait && !matched_ && now_s - wait->arrival_s > kLongPoseWaitS ? wait->message : "";
}

void KeyframeIntake::Convert(const MatchedInput& match, std::vector<IntakeEvent>* events) {
  matched_ = true;
  if (!calibrations_.last().calibration) {  // it was matched before the camera_info that cannot be used came
    return events->push_back(RejectedInput{
        "no_camera_info", Concat("image ", FormatStamp(match.image.stamp_ns), ": no usable camera_info"), true});
  }
  KeyframeInput input;
  input.stamp_ns = match.image.stamp_ns;
  input.arrival_s = match.image.arrival_s;
  input.image = match.image.image;
  input.mask = match.companions[kMaskStream];
  input.prior_depth = match.companions[kPriorDepthStream];
  input.labels = match.companions[kLabelStream];
  const CalibrationHistory::Entry& calibrated = calibrations_.At(input.stamp_ns);
  input.calibration = calibrated.calibration;
  input.camera_frame = options_.camera_frame;
  if (input.camera_frame.empty()) input.camera_frame = StripLeadingSlash(match.image.image->header().frame_id);
  if (input.camera_frame.empty()) input.camera_frame = input.calibration->frame_id;
  if (input.camera_frame.empty()) input.camera_frame = kNamelessCamera;
  input.world_frame = options_.world_frame.empty() ? match.pose.world_frame : options_.world_frame;
  if (input.world_frame.empty()) input.world_frame = kNamelessWorld;
  if (!options_.world_frame.empty()) TellReplacedFrame(match.pose.world_frame, events);
  input.world_from_cam = resolver_.WorldFromCamera(match.pose.received);
  for (size_t camera = 0; camera < sources_.size(); ++camera) {
    const auto& image = match.companions[kSourceStream + camera];
    if (!image) continue;
    auto placed = sources_.Place(camera, image, calibrated.info, input.camera_frame);
    if (auto* source = std::get_if<SourceImage>(&placed)) input.source_images.push_back(std::move(*source));
    if (auto* rejected = std::get_if<RejectedInput>(&placed)) events->emplace_back(std::move(*rejected));
  }
  if (auto notice = sources_.TakeNotice()) events->emplace_back(std::move(*notice));
  input.landmarks_in_world = PlaceCloud(match, input, events);
  input.path = MakePathConvention();
  if (options_.world_frame.empty()) input.path_frame = input.world_frame;  // else it replaces the frames of all inputs

  CheckWorld(std::move(input), match.cloud && match.cloud->points.empty(), events);
}

void KeyframeIntake::TellReplacedFrame(const std::string& frame, std::vector<IntakeEvent>* events) {
  if (frame.empty() || frame == options_.world_frame || frame == replaced_frame_) return;
  replaced_frame_ = frame;
  events->emplace_back(
      Notice{false, Concat("poses are in \"", frame, "\", and everything is published in \"", options_.world_frame,
                           "\" (~world_frame) without any transform between them: right where both are the same frame, "
                           "else leave ~world_frame empty")});
}

void KeyframeIntake::CheckWorld(KeyframeInput input, bool has_empty_cloud, std::vector<IntakeEvent>* events) {
  using Verdict = WorldTracker::Verdict;
  const double depth = MedianDepth(input.landmarks_in_world, input.world_from_cam);
  if (depth > 0) scene_depth_ = depth;
  input.scene_depth = scene_depth_ > 0 ? scene_depth_ : fallback_depth_;
  const WorldTracker::Judgement judgement = world_.Add({input.stamp_ns, input.world_from_cam, input.calibration->camera,
                                                        input.landmarks_in_world, has_empty_cloud, input.scene_depth});
  switch (judgement.verdict) {
    case Verdict::kNotInitialised:
      starting_.push_back(std::move(input));
      return RejectStarting("not_initialised", judgement.reason, events);
    case Verdict::kNotSettled:
      RejectStarting("not_settled", judgement.reason, events);
      break;
    case Verdict::kNewWorld:
      events->emplace_back(NewWorld{
          Concat("from image ", FormatStamp(input.stamp_ns),
                 " on the frontend's world is another one, and a new part of the map begins: ", judgement.reason)});
      break;
    case Verdict::kUse:
    case Verdict::kWait:
      break;
  }
  starting_.push_back(std::move(input));
  if (judgement.verdict == Verdict::kUse) UseStarting(events);
}

void KeyframeIntake::RejectStarting(const std::string& reason, const std::string& message,
                                    std::vector<IntakeEvent>* events) {
  for (const KeyframeInput& input : std::exchange(starting_, {})) {
    events->emplace_back(RejectedInput{reason, Concat("image ", FormatStamp(input.stamp_ns), ": ", message), true});
  }
}

void KeyframeIntake::UseStarting(std::vector<IntakeEvent>* events) {
  for (KeyframeInput& input : std::exchange(starting_, {})) events->emplace_back(std::move(input));
}

PathConvention KeyframeIntake::MakePathConvention() const {
  // A double resolves 119 ns of today's stamps, and some frontends cut them to microseconds.
  constexpr int64_t kLeastToleranceNs = 1000;
  PathConvention path;
  path.maps_world_to_child = options_.pose.direction == PoseSemantics::Direction::kCamFromWorld;
  path.child_from_cam = resolver_.PathChildFromCamera();
  path.tolerance_ns = std::max<int64_t>(kLeastToleranceNs, std::llround(options_.matcher.sync_tolerance_s * 1e9));
  return path;
}

std::vector<Eigen::Vector3d> KeyframeIntake::PlaceCloud(const MatchedInput& match, const KeyframeInput& input,
                                                        std::vector<IntakeEvent>* events) {
  if (!match.cloud) return {};
  const SparseCloud& cloud = *match.cloud;
  const std::string at = Concat("sparse cloud ", FormatStamp(cloud.stamp_ns));
  if (cloud.points.empty()) {
    events->emplace_back(RejectedInput{"sparse_empty", Concat(at, ": 0 usable points (", cloud.not_finite,
                                                              " not finite, ", cloud.zero, " exactly zero)")});
    return {};
  }
  const std::optional<bool> in_camera = IsInCamera(match, input, events);
  if (!in_camera) return {};
  if (*in_camera && !match.cloud_pose) {
    events->emplace_back(
        RejectedInput{"sparse_without_pose", Concat(at,
                                                    " is in the camera's frame, and there is no pose at its "
                                                    "stamp")});
    return {};
  }
  const PoseSample& cloud_pose = match.cloud_pose ? *match.cloud_pose : match.pose;
  // A wide camera sees points of any reading.
  if (input.calibration->MakeLens().FieldOfView() <= kWideFieldOfView) {
    if (auto warning = convention_check_.Add(resolver_.semantics(), cloud_pose.received, cloud, *in_camera,
                                             input.calibration->camera)) {
      events->emplace_back(Notice{true, std::move(*warning)});
    }
  }
  std::vector<Eigen::Vector3d> points = cloud.points;
  if (!*in_camera) return points;
  const RigidTransform world_from_cloud = resolver_.WorldFromCamera(cloud_pose.received);
  for (Eigen::Vector3d& point : points) point = world_from_cloud * point;
  return points;
}

std::optional<bool> KeyframeIntake::IsInCamera(const MatchedInput& match, const KeyframeInput& input,
                                               std::vector<IntakeEvent>* events) const {
  if (options_.sparse_frame != SparseFrame::kAuto) return options_.sparse_frame == SparseFrame::kCamera;
  const SparseCloud& cloud = *match.cloud;
  if (cloud.frame_id.empty() || cloud.frame_id == match.pose.world_frame || cloud.frame_id == input.world_frame) {
    return false;
  }
  if (cloud.frame_id == input.camera_frame || cloud.frame_id == input.calibration->frame_id) return true;
  events->emplace_back(RejectedInput{
      "sparse_frame_unknown", Concat("sparse cloud ", FormatStamp(cloud.stamp_ns), ": its frame \"", cloud.frame_id,
                                     "\" is neither the world \"", input.world_frame, "\" nor the camera \"",
                                     input.camera_frame, "\"; set ~sparse_frame to world or camera")});
  return std::nullopt;
}

}  // namespace acmp
