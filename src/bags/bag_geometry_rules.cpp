#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>

#include "bag_rules.h"

namespace acmp {
namespace {

constexpr double kMaxQuaternionError = 1e-3;  // the mapper's own bound
constexpr size_t kFewestKeyframes = 3;        // one reference and two source views

bool IsFinite(const PoseRecord& pose) { return pose.translation.allFinite() && pose.quaternion.allFinite(); }

bool IsUnit(const PoseRecord& pose) { return std::abs(pose.quaternion.norm() - 1) <= kMaxQuaternionError; }

Eigen::Isometry3d ToIsometry(const PoseRecord& pose) {
  Eigen::Isometry3d isometry = Eigen::Isometry3d::Identity();
  isometry.linear() = Eigen::Quaterniond(pose.quaternion.normalized()).toRotationMatrix();
  isometry.translation() = pose.translation;
  return isometry;
}

template <class Records>
std::vector<ros::Time> Stamps(const Records& records) {
  std::vector<ros::Time> stamps;
  stamps.reserve(records.size());
  for (const auto& record : records) stamps.push_back(record.stamp);
  return stamps;
}

size_t CountWithin(const std::vector<double>& gaps, double tolerance_s) {
  return std::count_if(gaps.begin(), gaps.end(), [=](double gap) { return gap <= tolerance_s; });
}

double Quantile(std::vector<double> values, double q) {
  const auto nth = values.begin() + static_cast<ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

std::string GapHistogram(const std::vector<double>& gaps) {
  struct Bin {
    const char* name;
    double upper_s;
  };
  constexpr std::array<Bin, 6> kBins = {Bin{"equal", 0},    {"to 1 us", 1e-6},
                                        {"to 1 ms", 1e-3},  {"to 10 ms", 1e-2},
                                        {"to 100 ms", 0.1}, {"more", std::numeric_limits<double>::infinity()}};
  std::string text;
  size_t below = 0;
  for (const Bin& bin : kBins) {
    const size_t within = CountWithin(gaps, bin.upper_s);
    if (within > below) text += Concat(text.empty() ? "" : ", ", bin.name, ": ", within - below);
    below = within;
  }
  return text;
}

void CheckPoseStamps(const BagContents& contents, const BagCheckOptions& options, Findings& findings) {
  std::vector<ros::Time> image_stamps = Stamps(contents.images);
  std::vector<ros::Time> pose_stamps = Stamps(contents.poses);
  std::sort(image_stamps.begin(), image_stamps.end());
  std::sort(pose_stamps.begin(), pose_stamps.end());
  const std::vector<double> image_gaps = NearestGaps(image_stamps, pose_stamps);
  const std::vector<double> pose_gaps = NearestGaps(pose_stamps, image_stamps);
  const size_t matched = CountWithin(image_gaps, options.sync_tolerance_s);
  const double image_share = static_cast<double>(matched) / static_cast<double>(image_gaps.size());
  const double pose_share =
      static_cast<double>(CountWithin(pose_gaps, options.sync_tolerance_s)) / static_cast<double>(pose_gaps.size());
  // Poses of keyframes only, or of every IMU sample: what counts is the sparser of the two.
  const std::vector<double>& gaps = image_gaps.size() <= pose_gaps.size() ? image_gaps : pose_gaps;
  findings.Ok("stamp gaps between poses and images: ", GapHistogram(gaps));
  constexpr double kMostMatched = 0.9;
  if (matched >= kFewestKeyframes && std::max(image_share, pose_share) >= kMostMatched) {
    findings.Ok(matched, " images have a pose within ", options.sync_tolerance_s, " s (", Percent(image_share),
                " of the images, ", Percent(pose_share), " of the poses)");
    return;
  }
  const double needed_s = Quantile(gaps, 0.95);
  constexpr double kLargestSensible_s = 0.05;  // a hand-held camera moves visibly in that time
  const std::string advice = needed_s <= kLargestSensible_s
                                 ? Concat("; set ~sync_tolerance to ", 1.1 * needed_s)
                                 : "; poses and images do not have the same clock, or most poses are missing";
  const std::string sentence = Concat("only ", matched, " images have a pose within ", options.sync_tolerance_s, " s");
  if (matched >= kFewestKeyframes || needed_s <= kLargestSensible_s) {
    findings.Warn(sentence, advice);
  } else {
    findings.Error(sentence, advice);
  }
}

void CheckMotion(const std::vector<PoseRecord>& poses, const std::string& topic, Findings& findings) {
  size_t identical = 0;
  double path = 0;
  for (size_t i = 1; i < poses.size(); ++i) {
    const double step = (poses[i].translation - poses[i - 1].translation).norm();
    if (!std::isfinite(step)) continue;
    path += step;
    if (step == 0) ++identical;
  }
  if (poses.size() > 1 && path == 0) {
    findings.Error("poses ", topic, ": all at the same position; without a baseline there is no depth");
  } else if (identical > 0) {
    findings.Warn("poses ", topic, ": ", identical, " of ", poses.size(), " repeat the position of the pose before");
  }
  findings.Ok("poses ", topic, ": ", poses.size(), ", path length ", path, " (units of the poses), frame \"",
              poses.front().frame, "\"");
}

/// How a pose and a cloud may be meant.
struct Convention {
  const char* name;
  bool cam_world;
  bool flu;
};

constexpr std::array<Convention, 4> kConventions = {
    Convention{"pose_is: T_world_cam, pose_child: camera_optical", false, false},
    {"pose_is: T_cam_world, pose_child: camera_optical", true, false},
    {"pose_is: T_world_cam, pose_child: camera_flu", false, true},
    {"pose_is: T_cam_world, pose_child: camera_flu", true, true}};

/// Shares of the sampled points.
struct View {
  size_t points = 0;
  size_t in_front = 0;
  size_t in_image = 0;

  double FrontShare() const { return points == 0 ? 0 : static_cast<double>(in_front) / static_cast<double>(points); }
  double ImageShare() const { return points == 0 ? 0 : static_cast<double>(in_image) / static_cast<double>(points); }
};

bool InImage(const Eigen::Vector3d& point, const CameraInfoRecord& camera) {
  const double u = camera.fx * point.x() / point.z() + camera.cx;
  const double v = camera.fy * point.y() / point.z() + camera.cy;
  return u >= 0 && v >= 0 && u < camera.width && v < camera.height;
}

void Add(const CloudRecord& cloud, const Eigen::Isometry3d& cam_from_cloud, bool flu,
         const std::optional<CameraInfoRecord>& camera, View& view) {
  for (const Eigen::Vector3f& sample : cloud.sample) {
    Eigen::Vector3d point = cam_from_cloud * sample.cast<double>();
    if (flu) point = Eigen::Vector3d(-point.y(), -point.z(), point.x());
    ++view.points;
    if (point.z() <= 0) continue;
    ++view.in_front;
    if (camera && InImage(point, *camera)) ++view.in_image;
  }
}

const PoseRecord* NearestPose(const std::vector<PoseRecord>& poses, const ros::Time& stamp, double tolerance_s) {
  const PoseRecord* nearest = nullptr;
  double best = tolerance_s;
  for (const PoseRecord& pose : poses) {
    const double gap = std::abs((pose.stamp - stamp).toSec());
    if (gap > best || !IsFinite(pose) || !IsUnit(pose)) continue;
    best = gap;
    nearest = &pose;
  }
  return nearest;
}

std::optional<CameraInfoRecord> UsableCamera(const BagContents& contents) {
  if (contents.camera_infos.empty()) return std::nullopt;
  const CameraInfoRecord& camera = contents.camera_infos.front();
  const bool usable = camera.fx > 0 && camera.fy > 0 && std::isfinite(camera.cx + camera.cy) && !camera.resized;
  return usable ? std::make_optional(camera) : std::nullopt;
}

/// Which of the possible readings of the poses puts the points before the camera.
void CheckConventions(const BagContents& contents, const BagCheckOptions& options, Findings& findings) {
  const std::optional<CameraInfoRecord> camera = UsableCamera(contents);
  std::array<View, kConventions.size()> views;
  for (const CloudRecord& cloud : contents.clouds) {
    const PoseRecord* pose = NearestPose(contents.poses, cloud.stamp, options.sparse_tolerance_s);
    if (pose == nullptr) continue;
    for (size_t i = 0; i < kConventions.size(); ++i) {
      const Eigen::Isometry3d recorded = ToIsometry(*pose);
      Add(cloud, kConventions[i].cam_world ? recorded : recorded.inverse(), kConventions[i].flu, camera, views[i]);
    }
  }
  if (views[0].points == 0) return;
  const auto score = [&](size_t i) { return camera ? views[i].ImageShare() : views[i].FrontShare(); };
  size_t configured = 0;
  size_t best = 0;
  for (size_t i = 0; i < kConventions.size(); ++i) {
    const Convention& convention = kConventions[i];
    if (convention.cam_world == options.pose_is_cam_world && convention.flu == options.pose_child_is_flu)
      configured = i;
    if (score(i) > score(best)) best = i;
    findings.Ok("with ", convention.name, ": ", Percent(views[i].FrontShare()), " of the points in front",
                camera ? Concat(", ", Percent(views[i].ImageShare()), " in the image") : "");
  }
  constexpr double kPlausibleFront = 0.5;
  constexpr double kClearlyBetter = 1.5;
  if (views[best].FrontShare() < kPlausibleFront) {
    findings.Warn(
        "with no reading of the poses do most points lie in front of the camera: are they poses of the camera "
        "(pose_child: body needs ~T_body_cam), and the points in their frame (~sparse_frame)?");
  } else if (score(best) > kClearlyBetter * score(configured)) {
    findings.Warn("the points fit the poses much better with ", kConventions[best].name, ": set these");
  }
}

void CheckCloudStamps(const BagContents& contents, const BagCheckOptions& options, Findings& findings) {
  if (contents.images.empty()) return;
  std::vector<ros::Time> image_stamps = Stamps(contents.images);
  std::sort(image_stamps.begin(), image_stamps.end());
  const std::vector<double> gaps = NearestGaps(Stamps(contents.clouds), image_stamps);
  const size_t far = gaps.size() - CountWithin(gaps, options.sparse_tolerance_s);
  if (far > 0) {
    findings.Warn("sparse points ", contents.chosen.sparse_points, ": ", far, " of ", gaps.size(), " are more than ",
                  options.sparse_tolerance_s, " s from any image (largest gap ", Quantile(gaps, 1.0),
                  " s); the mapper then takes the last ones before: have them carry their image's stamp");
  }
}

/// Points already in the camera's frame need no pose.
void CheckCloudsInCamera(const BagContents& contents, Findings& findings) {
  View view;
  for (const CloudRecord& cloud : contents.clouds) {
    Add(cloud, Eigen::Isometry3d::Identity(), false, UsableCamera(contents), view);
  }
  findings.Ok("points are in the camera's frame (sparse_frame: auto takes them so): ", Percent(view.FrontShare()),
              " in front");
  if (view.FrontShare() < 0.5) findings.Warn("most points lie behind the camera: set ~sparse_frame: world");
}

void CheckPointCounts(const BagContents& contents, Findings& findings) {
  const std::string& topic = contents.chosen.sparse_points;
  size_t empty = 0;
  size_t points = 0;
  size_t not_finite = 0;
  size_t all_zero = 0;
  for (const CloudRecord& cloud : contents.clouds) {
    if (!cloud.problem.empty()) {
      findings.Error("sparse points ", topic, ": ", cloud.problem);
      return;
    }
    empty += cloud.points == 0 ? 1 : 0;
    points += cloud.points;
    not_finite += cloud.not_finite;
    all_zero += cloud.all_zero;
  }
  const double total = std::max<double>(1, static_cast<double>(points));
  if (empty > 0) findings.Warn("sparse points ", topic, ": ", empty, " of ", contents.clouds.size(), " are empty");
  if (not_finite > 0) {
    findings.Warn("sparse points ", topic, ": ", Percent(static_cast<double>(not_finite) / total),
                  " of the points are not finite; the mapper leaves them out");
  }
  if (all_zero > 0) {
    findings.Warn("sparse points ", topic, ": ", Percent(static_cast<double>(all_zero) / total),
                  " of the points are (0, 0, 0); the mapper leaves them out");
  }
  if (not_finite + all_zero == points)
    findings.Warn("sparse points ", topic, ": none is usable; set ~depth_min and ~depth_max");
  findings.Ok("sparse points ", topic, ": ", contents.clouds.size(), " clouds, ", points / contents.clouds.size(),
              " points each on average, frame \"", contents.clouds.front().frame, "\"");
}

const std::string& TypeOf(const BagContents& contents, const std::string& topic) {
  static const std::string none;
  for (const BagTopic& candidate : contents.topics) {
    if (candidate.name == topic) return candidate.type;
  }
  return none;
}

/// Which parameters make the mapper take these poses.
void CheckPoseType(const BagContents& contents, const std::string& topic, Findings& findings) {
  const std::string& type = TypeOf(contents, contents.chosen.pose);
  if (contents.chosen.pose.empty()) {
    return findings.Ok("poses are transforms (", topic,
                       "): set ~pose_source: tf, ~world_frame and, if the images have no "
                       "frame_id, ~camera_frame");
  }
  const std::array<std::pair<const char*, const char*>, 4> sources = {
      {{"geometry_msgs/PoseStamped", "pose"},
       {"geometry_msgs/PoseWithCovarianceStamped", "pose_cov"},
       {"nav_msgs/Odometry", "odom"},
       {"geometry_msgs/TransformStamped", "transform"}}};
  for (const auto& [known, source] : sources) {
    if (type == known) {
      findings.Ok("poses ", topic, " are ", type, ": ~pose_source: ", source, ", and ", source, ":=", topic);
    }
  }
}

}  // namespace

void CheckPoses(const BagContents& contents, const BagCheckOptions& options, Findings& findings) {
  const std::vector<PoseRecord>& poses = contents.poses;
  const std::string topic = contents.chosen.pose.empty() ? "tf " + contents.pose_from_tf : contents.chosen.pose;
  if (poses.empty()) {
    findings.Error(
        "no poses: neither a PoseStamped, PoseWithCovarianceStamped, Odometry or TransformStamped topic nor a "
        "transform tree that reaches the images' frame");
    return;
  }
  CheckPoseType(contents, topic, findings);
  const auto finite = static_cast<size_t>(std::count_if(poses.begin(), poses.end(), IsFinite));
  const auto unit = static_cast<size_t>(
      std::count_if(poses.begin(), poses.end(), [](const PoseRecord& pose) { return IsFinite(pose) && IsUnit(pose); }));
  if (finite < poses.size()) {
    findings.Warn("poses ", topic, ": ", poses.size() - finite, " of ", poses.size(), " are not finite; refused");
  }
  if (unit < finite) {
    findings.Warn("poses ", topic, ": ", finite - unit, " of ", poses.size(),
                  " quaternions are off unit length by more than ", kMaxQuaternionError, "; refused");
  }
  if (unit < kFewestKeyframes) findings.Error("poses ", topic, ": only ", unit, " are usable, at least 3 needed");
  CheckMotion(poses, topic, findings);
  if (!contents.images.empty()) CheckPoseStamps(contents, options, findings);
}

void CheckClouds(const BagContents& contents, const BagCheckOptions& options, Findings& findings) {
  if (contents.clouds.empty()) {
    findings.Warn("no sparse points: set the depth range by ~depth_min and ~depth_max");
    return;
  }
  if (TypeOf(contents, contents.chosen.sparse_points) == "sensor_msgs/PointCloud") {
    findings.Ok("sparse points ", contents.chosen.sparse_points,
                " are sensor_msgs/PointCloud: sparse_points_v1:=", contents.chosen.sparse_points);
  }
  CheckPointCounts(contents, findings);
  CheckCloudStamps(contents, options, findings);
  const bool in_camera = !contents.images.empty() && contents.clouds.front().frame == contents.images.front().frame;
  if (in_camera) {
    CheckCloudsInCamera(contents, findings);
  } else {
    CheckConventions(contents, options, findings);
  }
}

}  // namespace acmp
