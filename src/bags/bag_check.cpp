#include "acmp_mapping/bags/bag_check.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <set>

#include <rosbag/view.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_msgs/TFMessage.h>
#include <boost/algorithm/string/predicate.hpp>

#include "acmp_mapping/ros/bag_file.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/topic_names.h"
#include "bag_player.h"

namespace acmp {
namespace {

using Bags = std::vector<const rosbag::Bag*>;
using TopicTypes = std::vector<std::string>;  ///< in the order of preference

template <class... Messages>
TopicTypes TypesOf() {
  return {ros::message_traits::DataType<Messages>::value()...};
}
const TopicTypes& ImageTypes() {
  static const TopicTypes types = TypesOf<sensor_msgs::Image, sensor_msgs::CompressedImage>();
  return types;
}
const TopicTypes& CloudTypes() {
  static const TopicTypes types = TypesOf<sensor_msgs::PointCloud2, sensor_msgs::PointCloud>();
  return types;
}
const TopicTypes kInfoTypes = TypesOf<sensor_msgs::CameraInfo>(), kTfTypes = TypesOf<tf2_msgs::TFMessage>();
TopicTypes PoseTypes() {
  TopicTypes types;
  for (const PoseInput& pose : PoseInputs()) types.push_back(pose.type);
  return types;
}

/// Calls use(view) with what a query chooses of all bags, in the order of time.
template <class Query, class Use>
void WithView(const Bags& bags, const Query& query, const Use& use) {
  rosbag::View view;
  for (const rosbag::Bag* bag : bags) view.addQuery(*bag, query);
  use(view);
}

std::vector<BagTopic> ReadTopics(const Bags& bags) {
  std::map<std::string, std::string> types;
  for (const rosbag::Bag* bag : bags) {
    for (const rosbag::ConnectionInfo* connection : rosbag::View(*bag).getConnections()) {
      types[connection->topic] = connection->datatype;
    }
  }
  std::vector<BagTopic> topics;
  for (const auto& [name, type] : types) {
    WithView(bags, rosbag::TopicQuery(name), [&, &name = name, &type = type](rosbag::View& view) {
      topics.push_back({name, type, view.size(), (view.getEndTime() - view.getBeginTime()).toSec()});
    });
  }
  return topics;
}

/// Null for another type, and for a message that is damaged: what plays it says so.
template <class Message>
boost::shared_ptr<Message> ReadIfWhole(const rosbag::MessageInstance& record) {
  try {
    return InstantiateChecked<Message>(record);
  } catch (const InvalidInputError&) {
    return nullptr;
  }
}

/// Chooses what a user has not named, by types and names.
class TopicChooser {
 public:
  TopicChooser(const Bags& bags, const std::vector<BagTopic>& topics) : topics_(topics) {
    std::set<std::string> seen;
    WithView(bags, rosbag::TypeQuery(ImageTypes().front()), [&](rosbag::View& view) {
      for (const rosbag::MessageInstance& record : view) {
        if (!seen.insert(record.getTopic()).second) continue;
        const auto image = ReadIfWhole<sensor_msgs::Image>(record);
        const std::string encoding = image ? image->encoding : "";
        namespace encodings = sensor_msgs::image_encodings;
        if (encoding == encodings::TYPE_16UC1 || encoding == encodings::TYPE_32FC1) depth_.insert(record.getTopic());
      }
    });
  }

  TopicChoice Choose(const TopicChoice& wanted) const {
    TopicChoice chosen = wanted;
    CheckRange<size_t>("number of --source-image", wanted.source_images.size(), 0, kMaxSourceCameras);
    CheckRange<size_t>("number of --source-camera-info", wanted.source_camera_infos.size(), 0,
                       wanted.source_images.size());
    const auto named = [&](const char* name) {
      return [&wanted, name](const BagTopic& topic) {
        return boost::algorithm::ends_with(topic.name, name) && topic.name != wanted.image;
      };
    };
    chosen.mask = Find({ImageTypes().front()}, wanted.mask, "--mask", named(names::kMask));
    chosen.labels = Find({ImageTypes().front()}, wanted.labels, "--labels", named(names::kLabels));
    const auto any = [](const BagTopic&) { return true; };
    const auto seen = [&](const BagTopic& topic) { return IsSeen(topic, chosen); };
    const auto picture = [&](const BagTopic& topic) { return seen(topic) && depth_.count(topic.name) == 0; };
    chosen.image = Find(ImageTypes(), wanted.image, "--image", picture);
    if (chosen.image.empty()) chosen.image = Find(ImageTypes(), "", "--image", seen);
    const std::string beside = InfoBeside(chosen.image);
    chosen.camera_info =
        Find(kInfoTypes, wanted.camera_info.empty() ? beside : wanted.camera_info, "--camera-info", any);
    for (size_t i = 0; i < wanted.source_images.size(); ++i) {
      const std::string& image = wanted.source_images[i];
      chosen.source_images[i] = Find(ImageTypes(), image, "--source-image", any);
      if (i == chosen.source_camera_infos.size()) chosen.source_camera_infos.push_back(InfoBeside(image));
      std::string& info = chosen.source_camera_infos[i];
      if (info.empty()) throw InvalidInputError(Concat("--source-image ", image, ": give its --source-camera-info"));
      info = Find(kInfoTypes, info, "--source-camera-info", any);
    }
    if (TypeOfTopic(wanted.pose) == kTfTypes.front()) {
      chosen.pose.clear();
    } else {
      chosen.pose = Find(PoseTypes(), wanted.pose, "--pose", any);
    }
    chosen.sparse_points = Find(CloudTypes(), wanted.sparse_points, "--sparse-points", any);
    return chosen;
  }

  std::string TypeOfTopic(const std::string& name) const {
    const auto found = std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& t) { return t.name == name; });
    return found == topics_.end() ? "" : found->type;
  }
  bool IsCompressed(const std::string& image) const { return TypeOfTopic(image) == ImageTypes().back(); }
  /// As the mapper takes it: with image_transport: compressed by its base name.
  std::string BaseOf(const std::string& image) const { return IsCompressed(image) ? WithoutCompressed(image) : image; }

  /// The camera_info beside an image's topic; empty: there is none.
  std::string InfoBeside(const std::string& image) const {
    const std::string base = BaseOf(image);
    const std::string beside = base.substr(0, base.rfind('/') + 1) + names::kCameraInfo;
    return TypeOfTopic(beside).empty() ? "" : beside;
  }

  /// Others of these types, each after a space.
  std::string Others(const TopicTypes& types, const std::string& used, const TopicChoice& chosen) const {
    std::string others;
    for (const BagTopic& topic : topics_) {
      const bool fits = std::find(types.begin(), types.end(), topic.type) != types.end();
      if (fits && topic.name != used && IsSeen(topic, chosen)) others += " " + topic.name;
    }
    return others;
  }

  /// Another camera that may be fixed to the chosen one: its images are of the same type and number, with a camera_info
  /// of their own.
  std::optional<TopicChoice> SecondCamera(const TopicChoice& chosen) const {
    const auto images =
        std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& topic) { return topic.name == chosen.image; });
    for (const BagTopic& topic : topics_) {
      if (images == topics_.end() || topic.type != images->type || topic.messages != images->messages) continue;
      const std::string info = InfoBeside(topic.name);
      if (topic.name == chosen.image || !IsSeen(topic, chosen) || info.empty() || info == chosen.camera_info) continue;
      TopicChoice pair = chosen;
      pair.source_images = {topic.name};
      pair.source_camera_infos = {info};
      return pair;
    }
    return std::nullopt;
  }

 private:
  /// It may be what a camera sees, no mask of it nor labels.
  bool IsSeen(const BagTopic& topic, const TopicChoice& chosen) const {
    return topic.name != chosen.mask && topic.name != chosen.labels &&
           !boost::algorithm::ends_with(BaseOf(topic.name), names::kLabels);
  }
  /// The wanted topic, or the preferred one, with the most messages, that is suitable; empty when there is none.
  std::string Find(const TopicTypes& types, const std::string& wanted, const char* option,
                   const std::function<bool(const BagTopic&)>& is_suitable) const {
    const auto preference = [&](const BagTopic& topic) { return std::find(types.begin(), types.end(), topic.type); };
    const BagTopic* best = nullptr;
    for (const BagTopic& topic : topics_) {
      if (wanted.empty() ? preference(topic) == types.end() || !is_suitable(topic) : topic.name != wanted) continue;
      const bool better = !best || preference(topic) < preference(*best) ||
                          (topic.type == best->type && topic.messages > best->messages);
      if (better) best = &topic;
    }
    if (!best && !wanted.empty()) throw InvalidInputError(Concat(option, " ", wanted, ": not in the bag"));
    if (best && preference(*best) == types.end()) {
      throw InvalidInputError(
          Concat(option, " ", wanted, ": has type ", best->type, ", which the mapper cannot use there"));
    }
    return best ? best->name : "";
  }

  const std::vector<BagTopic>& topics_;
  std::set<std::string> depth_;  ///< images that are depth maps, as RGB-D cameras have
};

/// The root of the tf tree with the images' frame, as their first one has it; empty: tf has no pose for them.
std::string WorldOfTf(const Bags& bags, const std::string& image_topic) {
  std::string frame;
  const auto take_header = [&](const auto& message) {
    if (message && frame.empty()) frame = StripLeadingSlash(message->header.frame_id);
  };
  WithView(bags, rosbag::TopicQuery(image_topic), [&](rosbag::View& view) {
    if (view.size() == 0) return;
    take_header(ReadIfWhole<sensor_msgs::Image>(*view.begin()));
    take_header(ReadIfWhole<sensor_msgs::CompressedImage>(*view.begin()));
  });
  std::map<std::string, std::string> parents;
  WithView(bags, rosbag::TopicQuery(std::vector<std::string>{names::kTf, names::kTfStatic}), [&](rosbag::View& view) {
    for (const rosbag::MessageInstance& record : view) {
      const auto message = ReadIfWhole<tf2_msgs::TFMessage>(record);
      if (!message) continue;
      for (const auto& t : message->transforms) {
        parents[StripLeadingSlash(t.child_frame_id)] = StripLeadingSlash(t.header.frame_id);
      }
    }
  });
  std::string root = frame;
  for (size_t i = 0; i < parents.size() && parents.count(root) > 0; ++i) root = parents[root];  // there may be a loop
  return root == frame ? "" : root;
}

/// How the mapper is given the topics, as its launch file takes them: names of inputs, and parameters.
struct Wiring {
  std::map<std::string, std::string> remaps;
  std::string line;  ///< of roslaunch

  void Set(const std::string& argument, const std::string& value) { line += Concat(" ", argument, ":=", value); }
  void Remap(const std::string& input, const std::string& topic) {
    if (topic.empty()) return;
    remaps[input] = topic;
    Set(input, topic);
  }
};

Wiring MakeWiring(const TopicChooser& topics, const TopicChoice& chosen, const NodeOptions& options, bool again) {
  Wiring wiring = {{}, "roslaunch acmp_mapping dense_mapper.launch"};
  wiring.Set("namespace", again ? "acmp_again" : "acmp");
  wiring.Remap(names::kImage, topics.BaseOf(chosen.image));
  if (options.image_transport == ImageTransport::kCompressed) wiring.Set("image_transport", "compressed");
  if (!options.calibration_file.empty()) {
    wiring.Set("calibration_file", std::filesystem::absolute(options.calibration_file).string());
  } else {
    wiring.Remap(names::kCameraInfo, chosen.camera_info);
  }
  if (options.pose_source != NodeOptions().pose_source) wiring.Set("pose_source", options.pose_source);
  if (options.pose_source == kTfPoses) {
    wiring.Set("world_frame", options.world_frame);
  } else {
    wiring.Remap(options.pose_source, chosen.pose);
  }
  if (options.pose.direction != PoseSemantics().direction) wiring.Set("pose_is", Name(options.pose.direction));
  if (options.pose.child != PoseSemantics().child) wiring.Set("pose_child", Name(options.pose.child));
  const bool is_new = topics.TypeOfTopic(chosen.sparse_points) == CloudTypes().front();
  wiring.Remap(is_new ? names::kSparsePoints : names::kSparsePointsV1, chosen.sparse_points);
  wiring.Remap(names::kMask, chosen.mask);
  wiring.Remap(names::kLabels, chosen.labels);
  const size_t sources = chosen.source_images.size();
  if (sources == 1) wiring.Set("stereo", "true");
  if (sources > 1) wiring.Set("source_cameras", Concat(sources));
  for (size_t i = 0; i < sources; ++i) {
    wiring.Remap(names::kSourceImages[i], topics.BaseOf(chosen.source_images[i]));
    wiring.Remap(names::kSourceCameraInfos[i], chosen.source_camera_infos[i]);
  }
  if (options.keyframe_mode == KeyframeMode::kGate) wiring.Set("keyframe_mode", "gate");
  if (options.matcher.sync_tolerance_s != InputMatcherOptions().sync_tolerance_s) {
    wiring.Set("sync_tolerance", Concat(options.matcher.sync_tolerance_s));
  }
  return wiring;
}

/// What the recording tells of the mapper's options.
NodeOptions OptionsFor(const Bags& bags, const TopicChooser& topics, const TopicChoice& chosen, NodeOptions options,
                       const std::vector<BagTopic>& all) {
  options.matcher.source_cameras = static_cast<int>(chosen.source_images.size());
  options.image_transport = topics.IsCompressed(chosen.image) ? ImageTransport::kCompressed : ImageTransport::kRaw;
  for (const PoseInput& pose : PoseInputs()) {
    if (pose.type == topics.TypeOfTopic(chosen.pose)) options.pose_source = pose.name;
  }
  if (chosen.pose.empty() && !chosen.image.empty()) {
    if (const std::string world = WorldOfTf(bags, chosen.image); !world.empty()) {
      options.pose_source = kTfPoses;
      options.world_frame = world;
    }
  }
  // A video has a pose for nearly each of its images.
  constexpr double kVideo_hz = 5, kNearlyAll = 0.9;
  constexpr size_t kFewest = 30;
  size_t images = 0, poses = options.pose_source == kTfPoses ? SIZE_MAX : 0;
  double hz = 0;
  for (const BagTopic& topic : all) {
    if (topic.name == chosen.pose) poses = topic.messages;
    if (topic.name != chosen.image) continue;
    images = topic.messages;
    hz = topic.duration_s > 0 ? static_cast<double>(images) / topic.duration_s : 0;
  }
  const bool is_posed = static_cast<double>(poses) >= kNearlyAll * static_cast<double>(images);
  if (images >= kFewest && hz > kVideo_hz && is_posed) options.keyframe_mode = KeyframeMode::kGate;
  return options;
}

struct Findings : std::vector<Finding> {
  /// @param sentence what is joined to it
  template <class... Args>
  void Add(Severity severity, const Args&... sentence) {
    push_back({severity, Concat(sentence...)});
  }
};

std::string ValueOf(const diagnostic_updater::DiagnosticStatusWrapper& status, const std::string& key) {
  for (const auto& value : status.values) {
    if (value.key == key) return value.value;
  }
  return "";
}

/// What the mapper's diagnostics and log say at the end.
void ReportSnapshot(const MapperSnapshot& snapshot, bool is_reading_wrong, Findings* findings) {
  diagnostic_updater::DiagnosticStatusWrapper inputs, matching;
  DescribeInputs(snapshot, &inputs);
  DescribeMatching(snapshot, &matching);
  for (size_t i = 0; i < snapshot.inputs.size(); ++i) {
    const InputStatus& input = snapshot.inputs[i];
    const bool is_missing = input.received == 0;
    if (is_missing && !input.is_wanted() && input.advice.empty()) continue;
    findings->Add(!is_missing      ? Severity::kOk
                  : input.required ? Severity::kError
                                   : Severity::kWarning,
                  input.topic, ": ", inputs.values[i].value);
  }
  for (const auto& [reason, entry] : snapshot.drops) {
    // Many frontends pose some images alone.
    const bool usual = reason == "no_pose" && snapshot.matched > 0;
    findings->Add(usual ? Severity::kOk : Severity::kWarning, reason, ", ", entry.count,
                  " times; the last: ", entry.last_message);
  }
  if (snapshot.last_gap) {
    findings->Add(Severity::kWarning, "last image without a pose: ", ValueOf(matching, "last image without a pose"));
  }
  if (const std::string stamps = ValueOf(matching, "stamps of images and poses"); !stamps.empty()) {
    findings->Add(Severity::kOk, "stamps of images and poses: ", stamps);
  }
  if (!snapshot.waiting_for.empty()) {
    findings->Add(Severity::kWarning, snapshot.waiting_images, " images wait: ", snapshot.waiting_for);
  }
  if (!snapshot.convention_warning.empty() && !is_reading_wrong) {  // images tell more than points in view
    findings->Add(Severity::kWarning, snapshot.convention_warning);
  }
  if (!snapshot.worker.rig.empty()) findings->Add(Severity::kWarning, snapshot.worker.rig);
  if (snapshot.worker.pose_checks.stamp_offset_s) {
    findings->Add(Severity::kWarning, DescribeStampOffset(*snapshot.worker.pose_checks.stamp_offset_s));
  }
}

void ReportReading(const PoseSemantics& semantics, const ReadingVerdict& verdict, Findings* findings) {
  if (!verdict.share) return;
  if (!verdict.text.empty()) return findings->Add(Severity::kError, kPosesDoNotFit, verdict.text);
  const bool fits = *verdict.share >= ReadingVerdict::kFittingShare;
  findings->Add(fits ? Severity::kOk : Severity::kError, "poses read as ", Describe(semantics), " put ",
                std::lround(100 * *verdict.share), " % of the matches between images where they should lie",
                fits ? ""
                     : ", and no other reading that was tried fits: stamps or calibration are wrong, or T_body_cam, or "
                       "these are poses of a body (~pose_child: body), or the frontend has lost track");
}

/// Another reading of the poses, where images say that it fits, or where they do not tell, frames and tf. Says why.
std::optional<PoseSemantics> BetterReading(const BagPlayer& player, Findings* findings) {
  const ReadingVerdict& verdict = player.verdict();
  PoseSemantics reading = player.intake().pose_semantics();
  if (!verdict.fitting.empty()) {
    const PoseReading& best = verdict.fitting.front();
    if (!best.is_declared_by_name) return std::nullopt;
    reading.direction = best.semantics.direction;
    reading.child = best.semantics.child;
    findings->Add(Severity::kWarning, "set ~pose_is: ", Name(reading.direction), ", ~pose_child: ", Name(reading.child),
                  verdict.text);
    return reading;
  }
  const bool body_is_known = reading.body_from_cam && reading.child != PoseSemantics::Child::kBody;
  if (!body_is_known || verdict.NothingFits() || !verdict.FitsToo(PoseSemantics::Child::kBody)) return std::nullopt;
  findings->Add(Severity::kWarning, "set ~pose_child: body", player.intake().DescribeDoubt());
  reading.child = PoseSemantics::Child::kBody;
  return reading;
}

BagReport CheckOpened(const Bags& bags, const BagCheckOptions& asked) {
  BagReport report;
  report.topics = ReadTopics(bags);
  const TopicChooser topics(bags, report.topics);
  const TopicChoice chosen = report.chosen = topics.Choose(asked.topics);
  std::map<std::string, std::string> published;
  bool again = false;  // a recording of the mapper's own outputs must not be mixed with them
  for (const BagTopic& topic : report.topics) {
    published[topic.name] = topic.type;
    again = again || topic.name.rfind("/acmp/", 0) == 0;
  }
  double start_s = 0;
  for (const rosbag::Bag* bag : bags) {
    const double begin_s = rosbag::View(*bag).getBeginTime().toSec();
    start_s = bag == bags.front() ? begin_s : std::min(start_s, begin_s);
  }
  Findings findings;
  NodeOptions options = OptionsFor(bags, topics, chosen, asked.mapper, report.topics);
  std::optional<BagPlayer> player;
  Wiring wiring;
  const auto play = [&] {
    wiring = MakeWiring(topics, chosen, options, again);
    player.emplace(options, wiring.remaps, published, start_s, asked.trial_size);
    WithView(bags, rosbag::TopicQuery(player->Topics()), [&](rosbag::View& view) { player->Play(view); });
  };
  play();
  if (const auto reading = BetterReading(*player, &findings)) {
    options.pose.direction = reading->direction;
    options.pose.child = reading->child;
    play();
  }
  const struct {
    const TopicTypes types;
    const std::string& chosen;
    const std::string& wanted;
    const char* option;
  } kinds[] = {{ImageTypes(), chosen.image, asked.topics.image, "--image"},
               {kInfoTypes, chosen.camera_info, asked.topics.camera_info, "--camera-info"},
               {PoseTypes(), chosen.pose, asked.topics.pose, "--pose"},
               {CloudTypes(), chosen.sparse_points, asked.topics.sparse_points, "--sparse-points"}};
  for (const auto& kind : kinds) {
    const std::string others = topics.Others(kind.types, kind.chosen, chosen);
    if (!kind.wanted.empty() || kind.chosen.empty() || others.empty()) continue;
    findings.Add(Severity::kWarning, "checked ", kind.chosen, "; there is also", others, "; choose with ", kind.option);
  }
  if (const auto pair = topics.SecondCamera(chosen); pair && chosen.source_images.empty()) {
    findings.Add(Severity::kOk, "if ", pair->source_images.front(), " is of a camera that is fixed to this one, its ",
                 "images can be source views: check it with --source-image ", pair->source_images.front());
  }
  const MapperSnapshot snapshot = player->Snapshot();
  ReportSnapshot(snapshot, !player->verdict().text.empty(), &findings);
  findings.insert(findings.end(), player->told().begin(), player->told().end());
  ReportReading(player->intake().pose_semantics(), player->verdict(), &findings);
  const std::string passed_over =
      snapshot.not_chosen > 0 ? Concat(" and passes over ", snapshot.not_chosen, " (~keyframe_mode: gate)") : "";
  findings.Add(player->mapped() > 0 ? Severity::kOk : Severity::kError, "the mapper takes ", player->taken(), " of ",
               ImagesReceived(snapshot.inputs), " images", passed_over, DescribeDrops(snapshot), "; of the first ",
               player->tried(), " keyframes ", player->mapped(), " get maps (tried at ", asked.trial_size, " px)");
  report.findings = std::move(findings);
  if (report.usable()) report.launch = wiring.line;
  return report;
}

}  // namespace

size_t BagReport::Count(Severity severity) const {
  return static_cast<size_t>(std::count_if(
      findings.begin(), findings.end(), [severity](const Finding& finding) { return finding.severity == severity; }));
}

BagReport CheckBags(const std::vector<std::filesystem::path>& paths, const BagCheckOptions& options) {
  BagReport report;
  Bags bags;
  const std::function<void(size_t)> open = [&](size_t i) {
    if (i == paths.size()) {
      report = CheckOpened(bags, options);
      return;
    }
    ReadBag(paths[i], "repair it with: rosbag reindex", [&](const rosbag::Bag& bag) {
      bags.push_back(&bag);
      open(i + 1);
    });
  };
  open(0);
  return report;
}

}  // namespace acmp
