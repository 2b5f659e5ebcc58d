#include "acmp_mapping/bags/bag_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>

#include "acmp_mapping/intake/convention_check.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "bag_contents.h"

namespace acmp {
namespace {

constexpr size_t kFewest = 3;  // images and poses: a keyframe waits for two source views
constexpr double kSecondsPerNs = 1e-9;

/// Collects findings; the arguments are joined to one sentence.
class Findings {
 public:
  template <class... Args>
  void Add(Severity severity, const Args&... args) {
    list_.push_back({severity, Concat(args...)});
  }
  template <class... Args>
  void Ok(const Args&... args) {
    Add(Severity::kOk, args...);
  }
  template <class... Args>
  void Warn(const Args&... args) {
    Add(Severity::kWarning, args...);
  }
  template <class... Args>
  void Error(const Args&... args) {
    Add(Severity::kError, args...);
  }
  std::vector<Finding> Take() { return std::move(list_); }

 private:
  std::vector<Finding> list_;
};

constexpr std::array<const char*, 4> kPoseSources = {"pose", "pose_cov", "odom", "transform"};  // in the order of types

const char* PoseSourceOf(const BagContents& contents) {
  const std::string& type = contents.Find(contents.chosen.pose)->type;
  const auto place = std::find(PoseTypes().begin(), PoseTypes().end(), type) - PoseTypes().begin();
  return kPoseSources.at(static_cast<size_t>(place));
}

/// The command that starts the mapper for the topics of a bag.
class LaunchLine {
 public:
  LaunchLine(const BagContents& contents, const BagCheckOptions& options) {
    const TopicChoice& chosen = contents.chosen;
    Set("image", WithoutCompressed(chosen.image));
    const BagTopic* image = contents.Find(chosen.image);
    if (image && image->type == ImageTypes().back()) Set("image_transport", "compressed");
    if (!options.calibration_file.empty()) {
      Set("calibration_file", std::filesystem::absolute(options.calibration_file).string());
    } else if (chosen.camera_info.empty()) {
      Set("calibration_file", "CAMERA.yaml");
    } else {
      Set("camera_info", chosen.camera_info);
    }
    SetPoses(contents, options.semantics);
    const BagTopic* points = contents.Find(chosen.sparse_points);
    if (!points) {
      Set("depth_min", "NEAREST");
      Set("depth_max", "FARTHEST");
    } else {
      Set(points->type == CloudTypes().front() ? "sparse_points" : "sparse_points_v1", chosen.sparse_points);
    }
    if (!chosen.mask.empty()) Set("mask", chosen.mask);
  }

  void Set(const std::string& argument, const std::string& value) { text_ += Concat(" ", argument, ":=", value); }
  const std::string& text() const { return text_; }

 private:
  void SetPoses(const BagContents& contents, const PoseSemantics& semantics) {
    if (contents.chosen.pose.empty()) {
      Set("pose_source", "tf");
      Set("world_frame", contents.pose_from_tf.substr(0, contents.pose_from_tf.find(' ')));
      return;
    }
    const std::string source = PoseSourceOf(contents);
    if (source != kPoseSources.front()) Set("pose_source", source);
    Set(source, contents.chosen.pose);
    if (semantics.direction != PoseSemantics().direction) Set("pose_is", Name(semantics.direction));
    if (semantics.child != PoseSemantics().child) Set("pose_child", Name(semantics.child));
  }

  std::string text_ = "roslaunch acmp_mapping dense_mapper.launch";
};

std::string Percent(size_t part, size_t whole) {
  return Concat(std::round(1000.0 * static_cast<double>(part) / static_cast<double>(whole)) / 10, " %");
}

/// Messages that the mapper would refuse.
template <class T>
void CheckRefused(const std::string& what, const BagStream<T>& stream, size_t fewest, Findings* findings) {
  const bool enough = stream.samples.size() >= fewest;
  if (stream.refused > 0) {
    findings->Add(enough ? Severity::kWarning : Severity::kError, what, ": ", stream.refused, " of ", stream.size(),
                  " cannot be used; the first one: ", stream.refusal);
  }
  if (!enough) {
    findings->Error(what, ": only ", stream.samples.size(), " are usable, at least ", fewest, " needed");
  }
}

template <class T>
void CheckHeaders(const std::string& what, const std::vector<T>& samples, std::string T::*frame, Findings* findings) {
  size_t unset = 0, nameless = 0, backward = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    unset += samples[i].stamp_ns == 0;
    nameless += (samples[i].*frame).empty();
    backward += i > 0 && samples[i].stamp_ns < samples[i - 1].stamp_ns;
  }
  if (unset > 0) findings->Error(what, ": ", unset, " of ", samples.size(), " stamps are zero");
  if (nameless > 0) findings->Warn(what, ": ", nameless, " of ", samples.size(), " have no frame_id");
  if (backward > 0) {
    findings->Warn(what, ": time runs backward ", backward, " times; the mapper starts over at each (~on_time_jump)");
  }
}

template <class T>
std::vector<int64_t> Stamps(const std::vector<T>& samples) {
  std::vector<int64_t> stamps;
  stamps.reserve(samples.size());
  for (const T& sample : samples) stamps.push_back(sample.stamp_ns);
  return stamps;
}

/// Seconds from each of `stamps` to the nearest of `others`, which are not empty. In order of time.
std::vector<double> NearestGaps(std::vector<int64_t> stamps, std::vector<int64_t> others) {
  std::sort(stamps.begin(), stamps.end());
  std::sort(others.begin(), others.end());
  std::vector<double> gaps;
  for (const int64_t stamp : stamps) {
    const auto after = std::lower_bound(others.begin(), others.end(), stamp);
    int64_t gap = std::numeric_limits<int64_t>::max();
    if (after != others.end()) gap = *after - stamp;
    if (after != others.begin()) gap = std::min(gap, stamp - *std::prev(after));
    gaps.push_back(static_cast<double>(gap) * kSecondsPerNs);
  }
  return gaps;
}

size_t CountWithin(const std::vector<double>& gaps, double tolerance_s) {
  return static_cast<size_t>(std::count_if(gaps.begin(), gaps.end(), [=](double gap) { return gap <= tolerance_s; }));
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

void CheckOtherTopics(const BagContents& contents, const std::vector<std::string>& types, const std::string& chosen,
                      const std::string& wanted, const char* option, Findings* findings) {
  if (!wanted.empty()) return;
  std::string others;
  for (const BagTopic& topic : contents.topics) {
    const bool fits = std::find(types.begin(), types.end(), topic.type) != types.end();
    if (fits && topic.name != chosen && topic.name != contents.chosen.mask) others += " " + topic.name;
  }
  if (!others.empty()) findings->Warn("checked ", chosen, "; there is also", others, "; choose with ", option);
}

void CheckImages(const BagContents& contents, Findings* findings) {
  const std::string name = "images " + contents.chosen.image;
  if (contents.images.size() == 0) {
    return findings->Error("no images: the bag has no sensor_msgs/Image or CompressedImage messages");
  }
  CheckRefused(name, contents.images, kFewest, findings);
  const std::vector<BagImage>& images = contents.images.samples;
  if (images.empty()) return;
  std::set<std::pair<int, int>> sizes;
  for (const BagImage& image : images) sizes.insert({image.width, image.height});
  if (sizes.size() > 1) findings->Warn(name, ": ", sizes.size(), " different sizes");
  CheckHeaders(name, images, &BagImage::frame, findings);
  const BagImage& first = images.front();
  findings->Ok(name, ": ", images.size(), ", ", first.encoding, ", ", first.width, "x", first.height, " px, frame \"",
               first.frame, "\"");
}

void CheckMasks(const BagContents& contents, Findings* findings) {
  if (contents.masks.size() == 0) return;
  const std::string name = "masks " + contents.chosen.mask;
  CheckRefused(name, contents.masks, 1, findings);
  const std::vector<BagMask>& masks = contents.masks.samples;
  const std::vector<BagImage>& images = contents.images.samples;
  if (masks.empty() || images.empty()) return;
  size_t of_another_size = 0, ignoring_all = 0;
  for (const BagMask& mask : masks) {
    of_another_size += mask.width != images.front().width || mask.height != images.front().height;
    ignoring_all += mask.ignores_all;
  }
  if (of_another_size > 0) {
    findings->Error(name, ": ", of_another_size, " of ", masks.size(), " have not the images' size, ",
                    images.front().width, "x", images.front().height, " px, and would be refused");
  }
  if (ignoring_all > 0) findings->Warn(name, ": ", ignoring_all, " of ", masks.size(), " ignore the whole image");
  constexpr double kSameStamp_s = 1e-3;  // as the mapper pairs them
  const size_t masked = CountWithin(NearestGaps(Stamps(images), Stamps(masks)), kSameStamp_s);
  findings->Add(masked > 0 ? Severity::kOk : Severity::kError, name, ": ", masks.size(), "; ", masked, " of ",
                images.size(), " images have one with their stamp; mask:=", contents.chosen.mask);
}

void CheckCameraInfo(const BagContents& contents, const BagCheckOptions& options, Findings* findings) {
  const std::string name = options.calibration_file.empty() ? "camera_info " + contents.chosen.camera_info
                                                            : "calibration " + options.calibration_file.string();
  if (contents.calibrations.size() == 0) {
    return findings->Warn(
        "no camera_info: set ~calibration_file to a file of camera_calibration (convert_calibration.py makes one of "
        "the frontend's own), here --calibration-file");
  }
  CheckRefused(name, contents.calibrations, 1, findings);
  if (contents.calibrations.samples.empty()) return;
  const BagCalibration& first = contents.calibrations.samples.front();
  const PinholeCamera& camera = first.calibration.camera;
  for (const BagCalibration& other : contents.calibrations.samples) {
    if (SameCalibration(first.calibration, other.calibration)) continue;
    findings->Warn(name, ": changes");
    break;
  }
  for (const BagImage& image : contents.images.samples) {
    if (image.width == camera.width && image.height == camera.height) continue;
    findings->Error(name, ": is for ", camera.width, "x", camera.height, " px, an image has ", image.width, "x",
                    image.height);
    break;
  }
  if (!camera.Contains({camera.cx, camera.cy})) {
    findings->Warn(name, ": principal point ", camera.cx, ", ", camera.cy, " lies outside the image");
  }
  if (!first.names_a_model) {
    findings->Warn(name, ": names no distortion model; the images are taken as undistorted");
  }
  findings->Ok(name, ": fx ", camera.fx, ", fy ", camera.fy);
}

/// Which parameters make the mapper take these poses.
void AdviseOnPoses(const BagContents& contents, const std::string& name, Findings* findings) {
  if (contents.chosen.pose.empty()) {
    return findings->Ok(name,
                        " are transforms: set ~pose_source: tf, ~world_frame and, if the images have no frame_id, ",
                        "~camera_frame");
  }
  const std::string& type = contents.Find(contents.chosen.pose)->type;
  const char* source = PoseSourceOf(contents);
  findings->Ok(name, " are ", type, ": ~pose_source: ", source, ", and ", source, ":=", contents.chosen.pose);
}

/// Adds what the launch line needs: the tolerance, and whether every image has a pose.
void CheckPoseStamps(const BagContents& contents, double tolerance_s, LaunchLine* line, Findings* findings) {
  const std::vector<int64_t> images = Stamps(contents.images.samples), poses = Stamps(contents.poses.samples);
  const std::vector<double> image_gaps = NearestGaps(images, poses), pose_gaps = NearestGaps(poses, images);
  const size_t matched = CountWithin(image_gaps, tolerance_s), used = CountWithin(pose_gaps, tolerance_s);
  // Poses of keyframes only, or of every IMU sample: what counts is the sparser of the two.
  std::vector<double> gaps = image_gaps.size() <= pose_gaps.size() ? image_gaps : pose_gaps;
  findings->Ok("stamp gaps between poses and images: ", GapHistogram(gaps));
  constexpr double kMostMatched = 0.9;
  constexpr size_t kVideo = 30;
  const auto most = [](size_t part, size_t whole) { return part >= kMostMatched * static_cast<double>(whole); };
  if (images.size() >= kVideo && most(matched, images.size())) line->Set("keyframe_mode", "gate");
  if (matched >= kFewest && (most(matched, images.size()) || most(used, poses.size()))) {
    return findings->Ok(matched, " images have a pose within ", tolerance_s, " s (", Percent(matched, images.size()),
                        " of the images, ", Percent(used, poses.size()), " of the poses)");
  }
  std::sort(gaps.begin(), gaps.end());
  const double needed_s = gaps[static_cast<size_t>(0.95 * static_cast<double>(gaps.size() - 1))];
  constexpr double kLargestSensible_s = 0.05;  // a hand-held camera moves visibly in that time
  const bool sensible = needed_s <= kLargestSensible_s;
  if (sensible) line->Set("sync_tolerance", Concat(1.1 * needed_s));
  findings->Add(matched >= kFewest || sensible ? Severity::kWarning : Severity::kError, "only ", matched,
                " images have a pose within ", tolerance_s, " s",
                sensible ? Concat("; set ~sync_tolerance to ", 1.1 * needed_s)
                         : "; poses and images do not have the same clock, or most poses are missing");
}

/// Whether the poses are those of the images' frame.
void CheckChildFrame(const BagContents& contents, const PoseSemantics& semantics, Findings* findings) {
  if (contents.chosen.pose.empty() || contents.images.samples.empty()) return;
  const std::string& child = contents.poses.samples.front().child_frame;
  const std::string& camera = contents.images.samples.front().frame;
  if (child.empty() || camera.empty() || child == camera) return;
  const std::string frames = Concat("poses are those of \"", child, "\" (child_frame_id), images of \"", camera, "\"");
  if (semantics.child == PoseSemantics::Child::kBody) {
    findings->Warn(frames, ", and tf_static has the transform between them: set ~pose_child: body");
  } else if (!contents.body_from_cam) {
    findings->Ok(frames, ": if these are two frames, set ~pose_child: body and T_body_cam");
  }
}

void CheckPoses(const BagContents& contents, const BagCheckOptions& options, LaunchLine* line, Findings* findings) {
  const std::vector<PoseSample>& poses = contents.poses.samples;
  const std::string name =
      "poses " + (contents.chosen.pose.empty() ? "tf " + contents.pose_from_tf : contents.chosen.pose);
  if (contents.poses.size() == 0) {
    return findings->Error(
        "no poses: neither a PoseStamped, PoseWithCovarianceStamped, Odometry or TransformStamped topic nor a "
        "transform tree that reaches the images' frame");
  }
  AdviseOnPoses(contents, name, findings);
  CheckRefused(name, contents.poses, kFewest, findings);
  if (poses.empty()) return;
  CheckHeaders(name, poses, &PoseSample::world_frame, findings);
  size_t repeated = 0;
  double path = 0;
  for (size_t i = 1; i < poses.size(); ++i) {
    const double step = (poses[i].received.translation() - poses[i - 1].received.translation()).norm();
    path += step;
    repeated += step == 0;
  }
  if (poses.size() > 1 && path == 0) {
    findings->Error(name, ": all at the same position; without a baseline there is no depth");
  } else if (repeated > 0) {
    findings->Warn(name, ": ", repeated, " of ", poses.size(), " repeat the position of the pose before");
  }
  findings->Ok(name, ": ", poses.size(), ", path length ", path, " (units of the poses), frame \"",
               poses.front().world_frame, "\"");
  CheckChildFrame(contents, options.semantics, findings);
  if (!contents.images.samples.empty()) CheckPoseStamps(contents, options.sync_tolerance_s, line, findings);
}

const PoseSample* NearestPose(const std::vector<PoseSample>& poses, int64_t stamp_ns, double tolerance_s) {
  const auto gap = [stamp_ns](const PoseSample& pose) { return std::abs(pose.stamp_ns - stamp_ns); };
  const auto nearest = std::min_element(poses.begin(), poses.end(),
                                        [&](const PoseSample& a, const PoseSample& b) { return gap(a) < gap(b); });
  const bool near = nearest != poses.end() && static_cast<double>(gap(*nearest)) * kSecondsPerNs <= tolerance_s;
  return near ? &*nearest : nullptr;
}

/// Whether the points lie before the camera, as the mapper checks it.
void CheckConventions(const BagContents& contents, const BagCheckOptions& options, Findings* findings) {
  const std::vector<SparseCloud>& clouds = contents.clouds.samples;
  if (contents.calibrations.samples.empty() || clouds.empty()) return;
  const PinholeCamera& camera = contents.calibrations.samples.front().calibration.camera;
  const std::vector<BagImage>& images = contents.images.samples;
  // As the mapper's sparse_frame: auto.
  const std::string& frame = clouds.front().frame_id;
  const bool in_world =
      frame.empty() || (!contents.poses.samples.empty() && frame == contents.poses.samples.front().world_frame);
  const bool in_camera = !in_world && ((!images.empty() && frame == images.front().frame) ||
                                       frame == contents.calibrations.samples.front().calibration.frame_id);
  if (!in_world && !in_camera) {
    return findings->Warn("sparse points are in \"", frame,
                          "\", which is neither the poses' nor the images' frame, and are not used: set ~sparse_frame "
                          "to world or camera");
  }
  ConventionCheck check;
  for (const SparseCloud& cloud : clouds) {
    const PoseSample* pose = NearestPose(contents.poses.samples, cloud.stamp_ns, options.sparse_tolerance_s);
    if (pose == nullptr) continue;
    const auto warning = check.Add(options.semantics, pose->received, cloud, in_camera, camera);
    if (warning) findings->Warn(*warning);
  }
  if (const auto share = check.share_in_front()) {
    findings->Ok("points are in the ", in_camera ? "camera's frame" : "world",
                 " (sparse_frame: auto takes them so): ", std::lround(100 * *share), " % lie in front of the camera");
  }
}

void CheckClouds(const BagContents& contents, const BagCheckOptions& options, Findings* findings) {
  const std::vector<SparseCloud>& clouds = contents.clouds.samples;
  const std::string& topic = contents.chosen.sparse_points;
  const std::string name = "sparse points " + topic;
  if (contents.clouds.size() == 0) {
    return findings->Warn("no sparse points: set the depth range by ~depth_min and ~depth_max");
  }
  if (contents.Find(topic)->type != CloudTypes().front()) {
    findings->Ok(name, " are sensor_msgs/PointCloud: sparse_points_v1:=", topic);
  }
  CheckRefused(name, contents.clouds, 1, findings);
  size_t empty = 0, not_finite = 0, zero = 0;
  for (const SparseCloud& cloud : clouds) {
    empty += cloud.points.empty();
    not_finite += cloud.not_finite;
    zero += cloud.zero;
  }
  if (empty > 0) findings->Warn(name, ": ", empty, " of ", clouds.size(), " have no point that is usable");
  if (not_finite > 0) findings->Warn(name, ": ", not_finite, " points are not finite; the mapper leaves them out");
  if (zero > 0) findings->Warn(name, ": ", zero, " points are (0, 0, 0); the mapper leaves them out");
  if (empty == clouds.size()) findings->Warn(name, ": none is usable; set ~depth_min and ~depth_max");
  if (clouds.empty() || contents.images.samples.empty()) return;
  const std::vector<double> gaps = NearestGaps(Stamps(clouds), Stamps(contents.images.samples));
  if (const size_t near = CountWithin(gaps, options.sparse_tolerance_s); near < gaps.size()) {
    findings->Warn(name, ": ", gaps.size() - near, " of ", gaps.size(), " are more than ", options.sparse_tolerance_s,
                   " s from any image (largest gap ", *std::max_element(gaps.begin(), gaps.end()),
                   " s); the mapper then takes the last ones before: have them carry their image's stamp");
  }
  CheckConventions(contents, options, findings);
}

}  // namespace

size_t BagReport::Count(Severity severity) const {
  return static_cast<size_t>(std::count_if(
      findings.begin(), findings.end(), [severity](const Finding& finding) { return finding.severity == severity; }));
}

BagReport CheckBag(const std::filesystem::path& path, const BagCheckOptions& declared) {
  BagContents contents = ReadBagContents(path, declared.topics);
  BagCheckOptions options = declared;
  options.semantics.body_from_cam = contents.body_from_cam;
  if (!options.child_declared && contents.body_from_cam) options.semantics.child = PoseSemantics::Child::kBody;
  if (options.semantics.child == PoseSemantics::Child::kBody && !contents.body_from_cam) {
    throw InvalidInputError(
        "pose_child body: tf_static of the bag has no transform from the poses' child frame to the "
        "images'");
  }
  if (!options.calibration_file.empty()) {
    contents.calibrations = {};
    contents.calibrations.samples.push_back(
        {ToCalibration(ReadCalibrationFile(options.calibration_file.string()), false), true});
  }
  const TopicChoice& chosen = contents.chosen;
  const TopicChoice& wanted = options.topics;
  Findings findings;
  CheckOtherTopics(contents, ImageTypes(), chosen.image, wanted.image, "--image", &findings);
  CheckOtherTopics(contents, CameraInfoTypes(), chosen.camera_info, wanted.camera_info, "--camera-info", &findings);
  CheckOtherTopics(contents, PoseTypes(), chosen.pose, wanted.pose, "--pose", &findings);
  CheckOtherTopics(contents, CloudTypes(), chosen.sparse_points, wanted.sparse_points, "--sparse-points", &findings);
  CheckImages(contents, &findings);
  CheckMasks(contents, &findings);
  CheckCameraInfo(contents, options, &findings);
  LaunchLine line(contents, options);
  CheckPoses(contents, options, &line, &findings);
  CheckClouds(contents, options, &findings);
  return {contents.topics, chosen, findings.Take(), line.text()};
}

}  // namespace acmp
