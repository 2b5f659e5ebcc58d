#include "acmp_mapping/bags/bag_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include <rosbag/view.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "acmp_mapping/ros/bag_file.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/tf_lookup.h"
#include "bag_feed.h"

namespace acmp {
namespace {

constexpr size_t kFewestKeyframes = 3;  // keyframes: one waits for two source views
constexpr std::array<const char*, 4> kPoseSources = {"pose", "pose_cov", "odom", "transform"};  // in the order of types

bool IsMost(size_t part, size_t whole) { return static_cast<double>(part) >= 0.9 * static_cast<double>(whole); }

/// Transforms of a bag: those that never change, or all.
void LoadTransforms(const rosbag::Bag& bag, bool only_static, tf2::BufferCore* buffer) {
  for (const rosbag::MessageInstance& record : rosbag::View(bag, rosbag::TypeQuery(kTfType))) {
    const bool is_static = record.getTopic().find("tf_static") != std::string::npos;
    if (only_static && !is_static) continue;
    const auto message = InstantiateChecked<tf2_msgs::TFMessage>(record);
    if (!message) continue;
    for (const auto& transform : message->transforms) {
      try {
        buffer->setTransform(transform, "bag", is_static);
      } catch (const std::exception&) {  // a stamp that tf cannot hold: what is missing shows where it is looked up
      }
    }
  }
}

std::string RootOf(const tf2::BufferCore& buffer, const std::string& frame) {
  constexpr int kMaxChain = 1000;  // a corrupt tree may be a loop
  std::string root = frame, parent;
  for (int i = 0; i < kMaxChain && buffer._getParent(root, ros::Time(), parent); ++i) root = parent;
  return root;
}

/// The tolerance that nearly all of the rarer of images and poses need; none where that is sensible for no camera.
std::optional<double> NeededTolerance(const Stream& images, const Stream& poses) {
  constexpr double kLargestSensible_s = 0.05;  // a hand-held camera moves visibly in that time
  std::vector<int64_t> rarer = images.stamps_ns, others = poses.stamps_ns;  // poses of keyframes only, or of an IMU
  if (others.size() < rarer.size()) std::swap(rarer, others);
  if (rarer.empty()) return std::nullopt;
  std::sort(others.begin(), others.end());
  std::vector<double> gaps_s;
  for (const int64_t stamp_ns : rarer) {
    const auto after = std::lower_bound(others.begin(), others.end(), stamp_ns);
    int64_t gap_ns = std::numeric_limits<int64_t>::max();
    if (after != others.end()) gap_ns = *after - stamp_ns;
    if (after != others.begin()) gap_ns = std::min(gap_ns, stamp_ns - *std::prev(after));
    gaps_s.push_back(static_cast<double>(gap_ns) * 1e-9);
  }
  std::sort(gaps_s.begin(), gaps_s.end());
  const double needed_s = gaps_s[static_cast<size_t>(0.95 * static_cast<double>(gaps_s.size() - 1))];
  return needed_s <= kLargestSensible_s ? std::make_optional(needed_s) : std::nullopt;
}

struct Findings : std::vector<Finding> {
  /// @param sentence what is joined to it
  template <class... Args>
  void Add(Severity severity, const Args&... sentence) {
    push_back({severity, Concat(sentence...)});
  }
};

void ReportOthers(const BagTopics& topics, const std::vector<std::string>& types, const std::string& chosen,
                  const std::string& wanted, const char* option, Findings* findings) {
  if (!wanted.empty() || chosen.empty()) return;
  std::string others;
  for (const BagTopic& topic : topics.all) {
    const bool fits = std::find(types.begin(), types.end(), topic.type) != types.end();
    if (fits && topic.name != chosen && topic.name != topics.chosen.mask) others += " " + topic.name;
  }
  if (others.empty()) return;
  findings->Add(Severity::kWarning, "checked ", chosen, "; there is also", others, "; choose with ", option);
}

/// Another camera of the bag that may be fixed to the chosen one: its images are of the same type and number, with a
/// camera_info of its own. Taken as a source camera, so that the intake tells whether it is one. Returns whether there
/// is one.
bool AddSecondCamera(BagTopics* topics) {
  TopicChoice* chosen = &topics->chosen;
  const BagTopic images = topics->Find(chosen->image);
  for (const BagTopic& topic : topics->all) {
    const std::string info = CameraInfoBeside(topics->all, topic.name);
    const bool same = topic.type == images.type && topic.messages == images.messages && topic.messages > 0;
    if (!same || topic.name == chosen->image || topic.name == chosen->mask) continue;
    if (info.empty() || info == chosen->camera_info) continue;
    chosen->source_images = {topic.name};
    chosen->source_camera_infos = {info};
    return true;
  }
  return false;
}

/// Arguments for the source cameras.
std::string SourceArguments(const TopicChoice& chosen) {
  const size_t count = chosen.source_images.size();
  std::string arguments = count == 1 ? "stereo:=true" : Concat("source_cameras:=", count);
  for (size_t i = 0; i < count; ++i) {
    const std::string number = i == 0 ? "" : Concat("_", i + 1);
    arguments += Concat(" source_image", number, ":=", WithoutCompressed(chosen.source_images[i]),
                        " source_camera_info", number, ":=", chosen.source_camera_infos[i]);
  }
  return arguments;
}

/// What the messages themselves have wrong, or what they are.
void ReportStream(const std::string& name, const Stream& stream, size_t fewest, const std::string& content,
                  Findings* findings) {
  if (stream.refused > 0) {
    findings->Add(stream.used() >= fewest ? Severity::kWarning : Severity::kError, name, ": ", stream.refused, " of ",
                  stream.size(), " cannot be used; the first one: ", stream.refusal);
  }
  if (stream.used() < fewest) {
    findings->Add(Severity::kError, name, ": only ", stream.used(), " are usable, at least ", fewest, " needed");
  } else {
    findings->Add(Severity::kOk, name, ": ", stream.used(), content, ", frame \"", stream.frame, "\"");
  }
}

void ReportImages(const BagTopics& topics, const IntakeRun& run, Findings* findings) {
  if (run.images.size() == 0) {
    return findings->Add(Severity::kError, "no images: the bag has no sensor_msgs/Image or CompressedImage messages");
  }
  std::string sizes;
  for (const auto& [width, height] : run.sizes) sizes += Concat(", ", width, "x", height, " px");
  ReportStream("images " + topics.chosen.image, run.images, kFewestKeyframes, ", " + run.encoding + sizes, findings);
}

void ReportCamera(const BagTopics& topics, const std::string& calibration_file, const IntakeRun& run,
                  Findings* findings) {
  if (run.infos.size() == 0) {
    return findings->Add(Severity::kWarning,
                         "no camera_info: set ~calibration_file to a file of camera_calibration "
                         "(convert_calibration.py makes one of the frontend's own), here --calibration-file");
  }
  const std::string name =
      calibration_file.empty() ? "camera_info " + topics.chosen.camera_info : "calibration " + calibration_file;
  const PinholeCamera camera = run.calibration ? run.calibration->camera : PinholeCamera();
  ReportStream(name, run.infos, 1, Concat(", fx ", camera.fx, ", fy ", camera.fy), findings);
  if (!run.calibration) return;
  for (const auto& [width, height] : run.sizes) {
    if (width == camera.width && height == camera.height) continue;
    findings->Add(Severity::kError, name, ": is for ", camera.width, "x", camera.height, " px, an image has ", width,
                  "x", height);
  }
  if (!run.names_a_model) {
    findings->Add(Severity::kWarning, name, ": names no distortion model; the images are taken as undistorted");
  }
}

/// @param verdict of images, of the reading in `options`
/// @param has_source whether images have one of a source camera
void ReportPoses(const BagTopics& topics, const NodeOptions& options, const IntakeRun& run,
                 const ReadingVerdict& verdict, bool has_source, Findings* findings) {
  if (options.pose_source == PoseSource::kTf) {
    return findings->Add(Severity::kOk, "poses are those of tf, \"", run.images.frame, "\" in \"", options.world_frame,
                         "\": ~pose_source: tf");
  }
  if (run.poses.size() == 0) {
    return findings->Add(Severity::kError,
                         "no poses: neither a PoseStamped, PoseWithCovarianceStamped, Odometry or TransformStamped "
                         "topic nor a transform tree that reaches the images' frame");
  }
  const std::string name = "poses " + topics.chosen.pose;
  ReportStream(name, run.poses, kFewestKeyframes, Concat(", path length ", run.path, " (units of the poses)"),
               findings);
  if (run.poses.used() > 1 && run.path == 0) {
    findings->Add(has_source ? Severity::kWarning : Severity::kError, name,
                  ": all at the same position; without a baseline there is no depth",
                  has_source ? " but by another camera" : "");
  }
  const bool fits = verdict.share && *verdict.share >= ReadingVerdict::kFittingShare;
  if (verdict.share && verdict.text.empty()) {
    findings->Add(fits ? Severity::kOk : Severity::kWarning, "poses read as ", Describe(options.pose), " put ",
                  std::lround(100 * *verdict.share), " % of the matches between images where they should lie",
                  fits ? std::string()
                       : Concat(", and no other reading that was tried fits: stamps or calibration are wrong, ",
                                options.pose.child == PoseSemantics::Child::kBody
                                    ? "T_body_cam is"
                                    : "these are poses of a body (~pose_child: body)",
                                ", or the frontend has lost track"));
  }
  const std::string& camera = run.images.frame;
  const bool body = options.pose.child == PoseSemantics::Child::kBody;
  if (run.child_frame.empty() || camera.empty() || run.child_frame == camera) return;
  if (!body && verdict.share && !verdict.NothingFits()) return;
  findings->Add(body ? Severity::kWarning : Severity::kOk, "poses are those of \"", run.child_frame,
                "\" (child_frame_id), images of \"", camera, "\": ",
                body ? "set ~pose_child: body" : "if these are two frames, set ~pose_child: body and T_body_cam");
}

void ReportCompanions(const BagTopics& topics, const IntakeRun& run, Findings* findings) {
  if (run.clouds.size() == 0) {
    findings->Add(Severity::kWarning,
                  "no sparse points: add depth_min:= and depth_max:=, the distances of the nearest and the farthest "
                  "surface in the unit of the poses");
  } else {
    std::string content;
    if (run.share_in_front)
      content += Concat(", ", std::lround(100 * *run.share_in_front), " % in front of the camera");
    if (run.range) content += Concat(", depth range ", run.range->min, " to ", run.range->max);
    ReportStream("sparse points " + topics.chosen.sparse_points, run.clouds, 1, content, findings);
  }
  if (run.masks.size() == 0) return;
  const std::string name = "masks " + topics.chosen.mask;
  ReportStream(name, run.masks, 1, "", findings);
  findings->Add(run.masked > 0 ? Severity::kOk : Severity::kError, name, ": ", run.masked, " of ", run.keyframes,
                " images have one with their stamp");
}

/// @param asked_for else nobody has said that the other camera is fixed to this one
void ReportSources(const BagTopics& topics, IntakeRun* tells, bool asked_for, Findings* findings) {
  const TopicChoice& chosen = topics.chosen;
  const IntakeRun& run = *tells;
  for (size_t i = 0; i < chosen.source_images.size(); ++i) {
    const std::string verdict = tells->rigs[chosen.source_images[i]].Judge(true);
    if (!verdict.empty() && asked_for) {
      findings->Add(Severity::kWarning, "source images ", chosen.source_images[i], ": ", verdict);
    }
    const auto found = run.with_source.find(chosen.source_images[i]);
    const size_t count = found == run.with_source.end() ? 0 : found->second;
    const std::string what = Concat(count, " of ", run.keyframes, " images have one of ", chosen.source_images[i]);
    if (asked_for) {
      ReportStream("source images " + chosen.source_images[i], run.source_images[i], 1, "", findings);
      findings->Add(count > 0 ? Severity::kOk : Severity::kError, "source images: ", what, "; ", run.source_places);
    } else {
      findings->Add(
          Severity::kOk,
          "if another camera is fixed to this one, its images can be source views: ", SourceArguments(chosen),
          count > 0 ? Concat(" (", what, "; ", run.source_places, verdict.empty() ? "" : "; but ", verdict, ")") : "");
    }
  }
}

/// What became of the images, in the intake's own sentences.
/// @param verdict of images, which tell more than points in view
/// @param sources_asked_for else what is said of source cameras is left out
void ReportIntake(const IntakeRun& run, double tolerance_s, const ReadingVerdict& verdict, bool sources_asked_for,
                  Findings* findings) {
  for (const std::string& text : run.warnings) findings->Add(Severity::kWarning, text);
  for (const std::string& text : run.convention_warnings) {
    if (verdict.text.empty()) findings->Add(Severity::kWarning, text);
  }
  if (run.time_jumps > 0) {
    findings->Add(Severity::kWarning, "time runs backward ", run.time_jumps,
                  " times; the mapper starts over at each (~on_time_jump)");
  }
  if (run.infos.size() == 0 || run.images.used() == 0) return;  // said above
  for (const auto& [reason, rejection] : run.rejections) {
    if (reason.find("source") != std::string::npos && !sources_asked_for) continue;
    // Many frontends pose some images alone.
    const bool usual = reason == "no_pose" && IsMost(run.posed, run.poses.used());
    findings->Add(usual ? Severity::kOk : Severity::kWarning, reason, ", ", rejection.count,
                  " times; the first: ", rejection.first);
  }
  findings->Add(run.keyframes >= kFewestKeyframes ? Severity::kOk : Severity::kError, "the mapper takes ",
                run.keyframes, " of ", run.images.used(), " images, with poses within ", tolerance_s, " s of them");
}

/// The command that starts the mapper for a bag's topics.
std::string LaunchLine(const BagTopics& topics, const NodeOptions& options, const IntakeRun& run, bool with_sources) {
  const TopicChoice& chosen = topics.chosen;
  std::string line = "roslaunch acmp_mapping dense_mapper.launch";
  const auto set = [&line](const std::string& argument, const std::string& value) {
    line += Concat(" ", argument, ":=", value);
  };
  // A recording of the mapper's own outputs must not be mixed with them.
  const auto is_output = [](const BagTopic& topic) { return topic.name.rfind("/acmp/", 0) == 0; };
  set("namespace", std::any_of(topics.all.begin(), topics.all.end(), is_output) ? "acmp_again" : "acmp");
  set("image", WithoutCompressed(chosen.image));
  if (topics.Find(chosen.image).type == ImageTypes().back()) set("image_transport", "compressed");
  if (!options.calibration_file.empty()) {
    set("calibration_file", std::filesystem::absolute(options.calibration_file).string());
  } else if (chosen.camera_info.empty()) {
    set("calibration_file", "CAMERA.yaml");
  } else {
    set("camera_info", chosen.camera_info);
  }
  if (options.pose_source == PoseSource::kTf) {
    set("pose_source", "tf");
    set("world_frame", options.world_frame);
  } else {
    const auto type = std::find(PoseTypes().begin(), PoseTypes().end(), topics.Find(chosen.pose).type);
    const std::string source = kPoseSources.at(static_cast<size_t>(type - PoseTypes().begin()));
    if (source != kPoseSources.front()) set("pose_source", source);
    set(source, chosen.pose);
    if (options.pose.direction != PoseSemantics().direction) set("pose_is", Name(options.pose.direction));
    if (options.pose.child != PoseSemantics().child) set("pose_child", Name(options.pose.child));
  }
  if (!chosen.sparse_points.empty()) {
    const bool is_new = topics.Find(chosen.sparse_points).type == CloudTypes().front();
    set(is_new ? "sparse_points" : "sparse_points_v1", chosen.sparse_points);
  }
  if (!chosen.mask.empty()) set("mask", chosen.mask);
  if (with_sources) line += " " + SourceArguments(chosen);
  constexpr size_t kVideo = 30;
  if (run.images.used() >= kVideo && IsMost(run.posed, run.images.used())) set("keyframe_mode", "gate");
  if (options.matcher.sync_tolerance_s != InputMatcherOptions().sync_tolerance_s) {
    set("sync_tolerance", Concat(options.matcher.sync_tolerance_s));
  }
  return line;
}

/// Poses from tf, where it has the images' frame. Returns whether it has.
bool UseTf(const IntakeRun& run, const tf2::BufferCore& transforms, NodeOptions* options) {
  const std::string& camera = run.images.frame;
  const std::string root = RootOf(transforms, camera);
  if (root.empty() || root == camera) return false;
  options->pose_source = PoseSource::kTf;
  options->world_frame = root;
  return true;
}

/// Reads the poses as images say, or where they do not tell, as frames and tf do. Returns whether that is another
/// reading, and says why.
bool DeclareReading(const IntakeRun& run, const ReadingVerdict& verdict, NodeOptions* options, Findings* findings) {
  if (!verdict.fitting.empty()) {
    const PoseReading& best = verdict.fitting.front();
    if (verdict.fitting.size() > 1 || !best.is_declared_by_name) return false;
    findings->Add(Severity::kWarning, "set ~pose_is: ", Name(best.semantics.direction),
                  ", ~pose_child: ", Name(best.semantics.child), verdict.text);
    options->pose.direction = best.semantics.direction;
    options->pose.child = best.semantics.child;
    return true;
  }
  const bool body_is_known = run.semantics.body_from_cam && run.semantics.child != PoseSemantics::Child::kBody;
  if (!body_is_known || verdict.NothingFits() || !verdict.FitsToo(PoseSemantics::Child::kBody)) return false;
  options->pose.child = PoseSemantics::Child::kBody;
  return true;
}

BagReport CheckOpened(const rosbag::Bag& bag, const BagCheckOptions& asked) {
  BagTopics topics = ChooseTopics(bag, asked.topics);
  const bool asked_for_sources = !asked.topics.source_images.empty();
  if (!asked_for_sources) AddSecondCamera(&topics);
  const TopicChoice& chosen = topics.chosen;
  NodeOptions options = asked.mapper;
  options.matcher.source_cameras = static_cast<int>(chosen.source_images.size());
  tf2::BufferCore buffer(ros::Duration(1e9));  // as long as any bag
  LoadTransforms(bag, !chosen.pose.empty(), &buffer);
  const TransformSource transforms = TransformsOf(&buffer);
  Findings findings;
  // What a run tells may be what the next one needs.
  const auto feed = [&] { return FeedBag(bag, topics, options, transforms); };
  IntakeRun run = feed();
  if (chosen.pose.empty() && UseTf(run, buffer, &options)) run = feed();
  const auto needed_s = NeededTolerance(run.images, run.poses);
  if (const double tolerance_s = options.matcher.sync_tolerance_s; needed_s && *needed_s > tolerance_s) {
    const size_t before = run.keyframes;
    options.matcher.sync_tolerance_s = 1.1 * *needed_s;
    run = feed();
    findings.Add(Severity::kWarning, "only ", before, " images have a pose within ", tolerance_s,
                 " s; set ~sync_tolerance to ", options.matcher.sync_tolerance_s);
  }
  ReadingVerdict verdict = run.images_of_poses->Judge(run.semantics);
  if (!asked.semantics_declared && DeclareReading(run, verdict, &options, &findings)) {
    run = feed();
    verdict = run.images_of_poses->Judge(run.semantics);
  }
  if (!verdict.text.empty()) {
    findings.Add(Severity::kWarning, "poses do not fit the images", verdict.text);
  }
  const TopicChoice& wanted = asked.topics;
  ReportOthers(topics, ImageTypes(), chosen.image, wanted.image, "--image", &findings);
  ReportOthers(topics, CameraInfoTypes(), chosen.camera_info, wanted.camera_info, "--camera-info", &findings);
  ReportOthers(topics, PoseTypes(), chosen.pose, wanted.pose, "--pose", &findings);
  ReportOthers(topics, CloudTypes(), chosen.sparse_points, wanted.sparse_points, "--sparse-points", &findings);
  ReportImages(topics, run, &findings);
  ReportCamera(topics, options.calibration_file, run, &findings);
  ReportPoses(topics, options, run, verdict, !chosen.source_images.empty(), &findings);
  ReportSources(topics, &run, asked_for_sources, &findings);
  ReportCompanions(topics, run, &findings);
  ReportIntake(run, options.matcher.sync_tolerance_s, verdict, asked_for_sources, &findings);
  const bool can_start = !chosen.image.empty() && (!chosen.pose.empty() || options.pose_source == PoseSource::kTf);
  return {topics.all, chosen, std::move(findings),
          can_start ? LaunchLine(topics, options, run, asked_for_sources) : ""};
}

}  // namespace

size_t BagReport::Count(Severity severity) const {
  return static_cast<size_t>(std::count_if(
      findings.begin(), findings.end(), [severity](const Finding& finding) { return finding.severity == severity; }));
}

BagReport CheckBag(const std::filesystem::path& path, const BagCheckOptions& options) {
  BagReport report;
  ReadBag(path, "repair it with: rosbag reindex", [&](const rosbag::Bag& bag) { report = CheckOpened(bag, options); });
  return report;
}

}  // namespace acmp
