#include "bag_player.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/presets.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

DenseMapperOptions TrialOptions() {
  constexpr int kSourceViews = 4;
  DenseMapperOptions options;
  options.pipeline = MakePreset("online");
  options.max_source_views = kSourceViews;
  return options;
}

/// At the size at which it is tried.
FramePtr Small(const Frame& frame, int size) {
  ColorImage color = frame.color.Clone();
  if (color.empty()) {  // of a companion
    color = ColorImage(frame.gray.width(), frame.gray.height());
    std::transform(frame.gray.begin(), frame.gray.end(), color.begin(), [](float gray) {
      const auto level = static_cast<unsigned char>(gray);
      return Rgb{level, level, level};
    });
  }
  return std::make_shared<const Frame>(MakeFrame(frame.id, frame.stamp_s, std::move(color), frame.camera,
                                                 frame.cam_from_world, frame.landmarks_in_world, size, frame.mask,
                                                 frame.prior_depth));
}

bool IsTf(const std::string& topic) { return topic == names::kTf || topic == names::kTfStatic; }

}  // namespace

BagPlayer::BagPlayer(const NodeOptions& options, const std::map<std::string, std::string>& remaps,
                     std::map<std::string, std::string> published, double start_s, int trial_size)
    : options_(options),
      published_(std::move(published)),
      trial_size_(trial_size),
      now_s_(start_s),
      intake_(options, 0, tf_.transforms()),
      preparation_(options, {}, [this](const RejectedInput& rejected) { Report(rejected); }),
      mapper_(backend_.engine.get(), TrialOptions(), MakeCallbacks()) {
  InputTopics topics;
  topics.is_remapped = [&remaps](const std::string& name) { return remaps.count(name) > 0; };
  topics.resolve = [&remaps](const std::string& name) {
    if (name.front() == '/') return name;
    const auto found = remaps.find(name);
    return found == remaps.end() ? names::kDefaultTopics + name : found->second;
  };
  sources_ = MakeInputSources(topics, options, MakeSink());
  SetExpected(
      sources_, [this](const InputSource& source) { return IsPublished(source); }, &intake_);
  if (!options.calibration_file.empty()) {
    intake_.AddCameraInfo(ReadCalibrationFile(options.calibration_file, options.rectified));
  }
}

InputSink BagPlayer::MakeSink() {
  InputSink sink;
  sink.receive = [this](const std::function<void(KeyframeIntake*)>& add) { add(&intake_); };
  sink.is_paused = [] { return false; };
  sink.on_drop = [this](const RejectedInput& drop) { Report(drop); };
  sink.now_s = [this] { return now_s_; };
  return sink;
}

DenseMapper::Callbacks BagPlayer::MakeCallbacks() {
  DenseMapper::Callbacks callbacks;
  callbacks.on_refined = [this](const KeyframeDepthPtr& maps) { mapped_.insert(maps->frame->id); };
  callbacks.on_refined_again = callbacks.on_refined;
  callbacks.on_drop = [this](const KeyframeDrop& drop) { Report({drop.reason, drop.message, true}); };
  callbacks.on_withdrawn = [this](const KeyframeDepthPtr& maps, const std::string& message) {
    mapped_.erase(maps->frame->id);
    Report({"poses_contradict", message, true});
  };
  callbacks.on_problem = [this](const std::string& reason, const std::string& message) { Report({reason, message}); };
  return callbacks;
}

void BagPlayer::Report(RejectedInput rejected) {
  if (rejected.reason == "no_depth_range" || rejected.reason == "poses_contradict") {
    rejected.message += intake_.DescribeDoubt();
  }
  rejected.message = Printable(rejected.message);
  incidents_.Record(rejected, now_s_);
}

std::vector<std::string> BagPlayer::Topics() const {
  std::vector<std::string> topics = {names::kTf, names::kTfStatic};
  for (const auto& source : sources_) topics.push_back(source->fixed.topic);
  return topics;
}

void BagPlayer::Play(const rosbag::View& records) {
  const auto deliver = [this](std::vector<IntakeEvent> events) {
    for (IntakeEvent& event : events) Dispatch(std::move(event));
  };
  for (const rosbag::MessageInstance& record : const_cast<rosbag::View&>(records)) {
    now_s_ = record.getTime().toSec();
    const std::string& topic = record.getTopic();
    if (IsTf(topic)) {
      try {
        const auto message = InstantiateChecked<tf2_msgs::TFMessage>(record);
        if (message) tf_.Receive(*message, topic == names::kTfStatic, record.getTime());
      } catch (const InvalidInputError& error) {
        Report({"bad_tf", error.what()});
      }
    }
    for (const auto& source : sources_) {
      if (source->fixed.topic == topic) source->play(record);
    }
    deliver(intake_.Take(now_s_));
  }
  deliver(intake_.TakeAll());
  mapper_.Flush();
  FindReading();
  JudgeRigs();
}

void BagPlayer::JudgeRigs() {
  const std::string verdict = preparation_.JudgeRigs(true);
  if (!verdict.empty()) rig_ = verdict;
  preparation_.ForgetRigs();
}

void BagPlayer::Dispatch(IntakeEvent event) {
  if (auto* drop = std::get_if<RejectedInput>(&event)) return Report(std::move(*drop));
  if (auto* notice = std::get_if<Notice>(&event)) {
    if (!notice->warning) told_.push_back({Severity::kOk, notice->text});  // warnings are in the snapshot
    return;
  }
  if (auto* jump = std::get_if<TimeJump>(&event)) {
    tf_.Clear();
    told_.push_back({Severity::kWarning, Concat("time jumped back from image ", FormatStamp(jump->from_ns), " to ",
                                                FormatStamp(jump->to_ns), ": buffers and window are cleared")});
    return StartOver();
  }
  if (auto* world = std::get_if<NewWorld>(&event)) {
    Report({"new_world", world->text});
    return StartOver();
  }
  const auto& input = std::get<KeyframeInput>(event);
  const double depth = input.scene_depth > 0 ? input.scene_depth : mapper_.scene_depth();
  const bool is_gated = options_.keyframe_mode == KeyframeMode::kGate;
  if (is_gated && !gate_.Accept(input.world_from_cam, input.calibration->camera, depth)) {
    ++not_chosen_;
    return;
  }
  try {
    TakeKeyframe(input);
  } catch (const InvalidInputError& error) {
    Report({"bad_image",
            Concat("keyframe ", FormatStamp(input.stamp_ns), " of ", input.image->topic, ": ", error.what()), true});
  }
}

void BagPlayer::TakeKeyframe(const KeyframeInput& input) {
  ++matched_;
  const Capture capture = preparation_.Prepare(input, {});
  ++taken_;
  readings_.Add(*capture.keyframes.front());
  if (tried_ < kTried) {
    ++tried_;
    Capture small;
    small.keyframes.push_back(Small(*capture.keyframes.front(), trial_size_));  // of a wide image one face
    for (const FramePtr& frame : capture.companions) small.companions.push_back(Small(*frame, trial_size_));
    mapper_.AddCapture(small);
  }
  if (matched_ < next_reading_) return;
  next_reading_ = 2 * matched_;
  FindReading();
}

void BagPlayer::FindReading() {
  const ReadingVerdict verdict = readings_.Judge(intake_.pose_semantics());
  // Of a camera that stands at the end images tell nothing; one word of another reading is enough.
  if (verdict.share && verdict_.text.empty()) verdict_ = verdict;
}

void BagPlayer::StartOver() {
  FindReading();
  readings_.Clear();
  JudgeRigs();
  gate_.Reset();
  mapper_.Flush();
  mapper_.Reset();
}

bool BagPlayer::IsPublished(const InputSource& source) const {
  const auto found = published_.find(source.fixed.topic);
  return found != published_.end() && found->second == source.fixed.type;
}

MapperSnapshot BagPlayer::Snapshot() const {
  MapperSnapshot snapshot;
  snapshot.now_s = now_s_;
  for (const auto& source : sources_) {
    InputStatus status = source->status();
    status.publishers = IsPublished(*source) ? 1 : 0;
    snapshot.inputs.push_back(status);
  }
  AddAdvice(published_, &snapshot.inputs);
  snapshot.matched = matched_;
  snapshot.not_chosen = not_chosen_;
  snapshot.sync_tolerance_s = options_.matcher.sync_tolerance_s;
  snapshot.drops = incidents_.entries();
  snapshot.images_dropped = incidents_.images();
  snapshot.worker.outputs.refined = mapped();
  snapshot.worker.pose_checks = mapper_.pose_checks();
  snapshot.worker.rig = rig_;
  AddIntake(intake_, &snapshot);
  snapshot.waiting_for = intake_.DescribeWait(std::numeric_limits<double>::infinity());  // no more will come
  return snapshot;
}

}  // namespace acmp
