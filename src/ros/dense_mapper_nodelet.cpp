#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <dynamic_reconfigure/server.h>
#include <ros/master.h>
#include <std_srvs/SetBool.h>
#include <pluginlib/class_list_macros.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/ros/diagnostics.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/mapper_worker.h"
#include "acmp_mapping/ros/nodelet_base.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/output_publisher.h"
#include "acmp_mapping/ros/tf_lookup.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

constexpr double kDeliverPeriodS = 0.05;  ///< how late a wait for a cloud may end
constexpr double kMissingPeriodS = 10;    ///< between two words in the log about missing inputs
constexpr double kReadingPeriodS = 1;     ///< between two looks whether poses are to be checked by the images
/// A flush waits for images until at so many looks in a row, so far apart, no more have come ...
constexpr int kOnTheWayLooks = 4;  ///< several: a process that stood still for a while has not read what has come
constexpr double kOnTheWayS = 0.05;
constexpr double kLongOnTheWayS = 2;  ///< ... or for so long, while a camera goes on

/// Where the scene is assumed while nothing tells: the middle of the fallback range, as the mapper has it.
double FallbackDepth(const DenseMapperOptions& options) {
  return std::sqrt(static_cast<double>(options.fallback_depth_range.min) * options.fallback_depth_range.max);
}

/// Empty for no file.
Mask ReadMaskFile(const std::string& path) {
  if (path.empty()) return {};
  try {
    Mask mask = ReadMask(path);
    if (IgnoresAll(mask)) throw InvalidInputError(path + " ignores every pixel (black)");
    return mask;
  } catch (const InvalidInputError& error) {
    throw InvalidInputError(Concat("parameter ~mask_file: ", error.what()));
  }
}

void Expect(const std::string& failure) {
  if (!failure.empty()) throw ProcessingError(failure);
}

}  // namespace

/// Wires topics, services and parameters to the mapper; README.md and docs/parameters.md list them.
///
/// Threads: one for input callbacks, which only buffer; the worker, which matches, and those of its mapper for outputs,
/// which publishes, and for poses; one for flush and one for the other services; one for diagnostics and
/// dynamic_reconfigure; one that asks the ROS master.
///
/// Locks: delivery_mutex_ keeps "take from the intake, hand to the worker" in order; config_mutex_ is held while
/// parameters change; intake_mutex_ guards the intake for a moment and comes after either. All other locks are inside
/// their classes, and none of those is held while another one is taken. What waits for the mapper waits in its queue.
class DenseMapperNodelet : public NodeletBase {
 public:
  ~DenseMapperNodelet() override {
    // First everything that waits is woken and the worker's hooks fall silent; then the threads end; members go after
    // that.
    if (worker_) worker_->Stop();
    StopThreads();
    worker_.reset();
  }

 private:
  void Start() override {
    LoadOptions();
    publisher_ =
        std::make_unique<OutputPublisher>(status_thread_.Attach(getNodeHandle()), getName(), &incidents_,
                                          [this](const RejectedInput& rejected) { Report(WithDoubt(rejected)); });
    MakeIntake(runtime_options_->Get());
    StartReconfigure();
    StartWorker();
    Subscribe();
    StartServices();
    diagnostics_ = std::make_unique<Diagnostics<MapperSnapshot>>(
        &status_thread_, getNodeHandle(), getName(), [this] { return TakeSnapshotWithAdvice(); },
        Diagnostics<MapperSnapshot>::Statuses{
            {"inputs", &DescribeInputs}, {"matching", &DescribeMatching}, {"mapping", &DescribeMapping}});
    missing_timer_ = status_thread_.MakeTimer(getNodeHandle(), kMissingPeriodS, [this] {
      const std::string missing = DescribeMissing(TakeSnapshotWithAdvice());
      if (!missing.empty()) NODELET_WARN("missing_input: %s", Printable(missing).c_str());
      if (flushing_) NODELET_INFO("flush: %s", Printable(AccountForImages(TakeSnapshot())).c_str());
      worker_->JudgeRigs(false);
    });
    reading_timer_ = status_thread_.MakeTimer(getNodeHandle(), kReadingPeriodS, [this] {
      if (matched_ < next_reading_ && !reading_wanted_.exchange(false)) return;
      next_reading_ = 2 * matched_;
      FindReading();
    });
    std::string topics;
    for (const auto& source : sources_) topics += source->status().topic + " ";
    NODELET_INFO("subscribed to %s; poses are %s", topics.c_str(), Describe(options_.pose).c_str());
  }

  void LoadOptions() {
    ParameterReader reader = ReadParameters();
    MapServerOptions of_map_server;
    for (const Option& option : OptionsOf(&of_map_server)) reader.SetElsewhere(option.name, "map_server");
    options_ = LoadNodeOptions(&reader);
    if (UsedPreset(options_, true) == kAutoPreset) {
      for (const AutoPreset::Setting& setting : AutoPreset::Settings()) {
        auto_options_.push_back(LoadRuntimeOptions(&reader, setting));
      }
    }
    const std::string preset = UsedPreset(options_, false);
    RuntimeOptions start;
    start.mapper.pipeline = MakePreset(preset == kAutoPreset ? kUsualPreset : preset);
    runtime_options_ = std::make_unique<SharedOptions>(LoadRuntimeOptions(&reader, start));
    WarnOfUnknown(reader);
  }

  void StartWorker() {
    MapperWorker::Hooks hooks;
    hooks.on_device = [this](const WorkerStatus& status) { LogDevice(status); };
    hooks.on_setting = [this](const AutoPreset& chosen, const std::string& text) { UseSetting(chosen, text); };
    worker_ = std::make_unique<MapperWorker>(options_, runtime_options_.get(), ReadMaskFile(options_.mask_file),
                                             publisher_.get(), hooks);
  }

  void Subscribe() {
    InputSink sink;
    sink.receive = [this](const std::function<void(KeyframeIntake*)>& add) {
      {
        std::lock_guard<std::mutex> lock(intake_mutex_);
        add(intake_.get());
      }
      Deliver();
    };
    sink.is_paused = [this] { return paused_.load(); };
    sink.on_drop = [this](const RejectedInput& drop) { Report(drop); };
    const ros::NodeHandle nh = input_thread_.Attach(getNodeHandle());
    sources_ = MakeInputSources(TopicsOf(nh), options_, sink);
    acmp::Subscribe(nh, &sources_);
    deliver_timer_ = input_thread_.MakeTimer(getNodeHandle(), kDeliverPeriodS, [this] { Deliver(); });
  }

  void StartServices() {
    AddTrigger(&service_thread_, names::kFlush, [this] { return Flush(); });
    AddTrigger(&urgent_thread_, names::kReset, [this] { return Reset(); });
    AddService<std_srvs::SetBool>(&urgent_thread_, names::kPause, [this](const auto& request, auto* response) {
      paused_ = request.data;
      response->message = paused_ ? "paused: images are dropped" : "running";
    });
  }

  void StartReconfigure() {
    const ros::NodeHandle nh = status_thread_.Attach(getPrivateNodeHandle());
    ToConfig(runtime_options_->Get()).__toServer__(nh);  // the server starts from there
    reconfigure_ = std::make_unique<dynamic_reconfigure::Server<DenseMapperConfig>>(config_mutex_, nh);
    const auto [least, largest] = ConfigBounds();
    reconfigure_->setConfigMin(least);
    reconfigure_->setConfigMax(largest);
    reconfigure_->setCallback([this](DenseMapperConfig& config, uint32_t) { HandleConfig(config); });
  }

  void LogDevice(const WorkerStatus& status) {
    if (!status.ready) {
      NODELET_ERROR("no device to match on: %s", status.device_error.c_str());
    } else if (!status.fallback_reason.empty()) {
      NODELET_WARN("mapping on %s, not on a GPU: %s", status.device_name.c_str(), status.fallback_reason.c_str());
    } else {
      NODELET_INFO("mapping on %s", status.device_name.c_str());
    }
    if (!status.on_cpu) return;
    const std::string size = options_.max_image_size > 0 ? Concat(options_.max_image_size, " px") : "the size as sent";
    NODELET_INFO(
        "preset %s, images of at most %s (~max_image_size); %s", status.preset.c_str(), size.c_str(),
        options_.overload == OverloadPolicy::kBlock
            ? "the input waits for the CPU (~overload: block) in a quarter of the memory, so that nothing is lost"
            : "keyframes that come faster than the CPU maps them get no maps; with ~overload: block a "
              "recording loses nothing");
  }

  void MakeIntake(const RuntimeOptions& runtime_options) {
    // Also where nothing needs them: for checks that try another reading of the poses.
    tf_ = std::make_unique<TfLookup>([this](const std::string& text) { Report(RejectedInput{"bad_tf", text}); });
    tf_->Listen(input_thread_.Attach(getNodeHandle()));
    intake_ = std::make_unique<KeyframeIntake>(options_, FallbackDepth(runtime_options.mapper), tf_->transforms());
    if (!options_.calibration_file.empty()) {
      intake_->AddCameraInfo(ReadCalibrationFile(options_.calibration_file, options_.rectified));
    }
  }

  void HandleConfig(DenseMapperConfig& config) {
    const RuntimeOptions current = runtime_options_->Get();
    try {
      const RuntimeOptions wanted = FromConfig(config, current);
      runtime_options_->Set(wanted);
      const DepthRange& range = wanted.mapper.fallback_depth_range;
      if (!HasDepthRange(range) && (range.min > 0 || range.max > 0)) {
        NODELET_WARN("depth_min = %g, depth_max = %g: used when both are set", range.min, range.max);
      }
      std::lock_guard<std::mutex> lock(intake_mutex_);
      intake_->set_fallback_depth(FallbackDepth(wanted.mapper));
    } catch (const InvalidInputError& error) {
      NODELET_WARN("the change of parameters was refused: %s", error.what());
      config = ToConfig(current);
    }
  }

  /// Of preset: auto. `text`: what it says of it.
  void UseSetting(const AutoPreset& chosen, const std::string& text) {
    const boost::recursive_mutex::scoped_lock lock(config_mutex_);
    const DenseMapperOptions& setting = auto_options_[chosen.index()].mapper;
    RuntimeOptions wanted = runtime_options_->Get();  // the rest may have been changed since the start
    wanted.mapper.pipeline = setting.pipeline;
    wanted.mapper.max_source_views = setting.max_source_views;
    wanted.mapper.min_source_views = setting.min_source_views;
    runtime_options_->Set(wanted);
    reconfigure_->updateConfig(ToConfig(wanted));
    if (text.empty()) return;
    if (chosen.keeps_up()) {
      NODELET_INFO("preset auto: %s", text.c_str());
    } else {
      NODELET_WARN("preset auto: %s", text.c_str());
    }
  }

  /// Takes what the intake has ready and hands it on. `all`: without waiting for clouds.
  void Deliver(bool all = false) {
    std::lock_guard<std::mutex> delivery_lock(delivery_mutex_);
    std::vector<IntakeEvent> events;
    {
      std::lock_guard<std::mutex> lock(intake_mutex_);
      SetExpected(
          sources_, [](const InputSource& source) { return source.subscriber.getNumPublishers() > 0; }, intake_.get());
      events = all ? intake_->TakeAll() : intake_->Take(SteadySeconds());
      publisher_->set_images(ImagesReceived(sources_) - intake_->unposed_images());
    }
    for (IntakeEvent& event : events) Dispatch(std::move(event), all);
  }

  void Dispatch(IntakeEvent event, bool must_wait) {
    if (auto* drop = std::get_if<RejectedInput>(&event)) return Report(*drop);
    if (auto* notice = std::get_if<Notice>(&event)) {
      if (notice->warning && publisher_->readings().verdict().text.empty()) {  // images tell more than points in view
        NODELET_WARN("%s", notice->text.c_str());
      } else if (!notice->warning) {
        NODELET_INFO("%s", notice->text.c_str());
      }
      return;
    }
    if (auto* jump = std::get_if<TimeJump>(&event)) {
      tf_->Clear();
      publisher_->readings().Clear();
      NODELET_WARN("time jumped back from image %s to %s: buffers and window are cleared",
                   FormatStamp(jump->from_ns).c_str(), FormatStamp(jump->to_ns).c_str());
      return worker_->StartOver();
    }
    if (auto* world = std::get_if<NewWorld>(&event)) {
      publisher_->readings().Clear();
      Report(RejectedInput{"new_world", world->text});
      return worker_->StartOver();
    }
    ++matched_;
    worker_->Push(std::move(std::get<KeyframeInput>(event)), must_wait);
  }

  /// Finishes what was published before the call; says what that was.
  std::string Flush() {
    const MapperSnapshot before = TakeSnapshot();
    WaitForArriving();
    Deliver(true);
    flushing_ = true;
    const std::string failure = worker_->Flush();
    flushing_ = false;
    Expect(failure);
    FindReading();
    worker_->JudgeRigs(true);
    const MapperSnapshot after = TakeSnapshot();
    const uint64_t arrived = ImagesReceived(after.inputs) - ImagesReceived(before.inputs);
    std::string text =
        Concat("finished all that had come; waited for ", arrived, " image(s) on their way and ",
               ImagesUnderWay(before), " under way; images: ", AccountForImages(after), DescribeDrops(after),
               "; points were sent ", after.points_sent, " times to ", after.maps, " map(s)");
    if (after.waiting_images > 0) {
      text += Concat("; ", after.waiting_images,
                     " image(s) still wait: ", after.waiting_for.empty() ? "they have no pose" : after.waiting_for);
    }
    return text;
  }

  /// Waits for messages that are on their way or in the queues of subscribers: until no image has come for a moment.
  void WaitForArriving() {
    const double end_s = SteadySeconds() + kLongOnTheWayS;
    for (int looks = 0; looks < kOnTheWayLooks && SteadySeconds() < end_s;) {
      const uint64_t received = ImagesReceived(sources_);
      ros::WallDuration(kOnTheWayS).sleep();
      if (!input_thread_.Drain()) throw ProcessingError("the mapper is shutting down");
      looks = ImagesReceived(sources_) == received ? looks + 1 : 0;
    }
  }

  std::string Reset() {
    {
      std::lock_guard<std::mutex> delivery_lock(delivery_mutex_);  // what came before is in the queue, not on its way
      std::lock_guard<std::mutex> lock(intake_mutex_);
      intake_->Clear();
    }
    const std::string failure = worker_->Reset();
    publisher_->readings().Clear();
    Deliver();  // the drops
    Expect(failure);
    return "buffers and window are empty";
  }

  std::vector<InputStatus> InputStatuses() const {
    std::vector<InputStatus> statuses;
    for (const auto& source : sources_) statuses.push_back(source->status());
    return statuses;
  }

  /// Adds what of the poses' meaning may be wrong where they do not fit the images.
  RejectedInput WithDoubt(RejectedInput drop) {
    const bool stands = drop.reason == "no_source_views";  // most of the time
    if (!stands && drop.reason != "no_depth_range" && drop.reason != "no_points" && drop.reason != "poses_contradict") {
      return drop;
    }
    reading_wanted_ = true;  // not here: it takes some tenths of a second, in which keyframes would wait
    if (!publisher_->readings().verdict().text.empty() || stands) return drop;
    std::lock_guard<std::mutex> lock(intake_mutex_);
    drop.message += intake_->DescribeDoubt();
    return drop;
  }

  /// Tells which reading of the poses fits the images, where the configured one does not. Returns whether it does.
  bool FindReading() {
    PoseSemantics semantics;
    {
      std::lock_guard<std::mutex> lock(intake_mutex_);
      semantics = intake_->pose_semantics();
    }
    const std::string found = publisher_->readings().Judge(semantics).text;
    if (!found.empty()) Report(RejectedInput{"pose_reading", Concat(kPosesDoNotFit, found)});
    return !found.empty();
  }

  MapperSnapshot TakeSnapshot() {
    MapperSnapshot snapshot;
    snapshot.now_s = SteadySeconds();
    snapshot.paused = paused_;
    snapshot.inputs = InputStatuses();
    snapshot.matched = matched_;
    snapshot.sync_tolerance_s = options_.matcher.sync_tolerance_s;
    snapshot.queued = worker_->queued();
    snapshot.not_chosen = publisher_->passed_over();
    snapshot.worker = worker_->status();
    snapshot.maps = publisher_->maps();
    snapshot.points_sent = publisher_->points_sent();
    snapshot.drops = incidents_.entries();
    snapshot.images_dropped = incidents_.images();
    const std::string found = publisher_->readings().verdict().text;
    std::lock_guard<std::mutex> lock(intake_mutex_);
    AddIntake(*intake_, &snapshot);
    if (!found.empty()) snapshot.convention_warning = Concat(kPosesDoNotFit, found);
    return snapshot;
  }

  /// The same. Where an input is silent the master is asked what is published under its name.
  MapperSnapshot TakeSnapshotWithAdvice() {
    MapperSnapshot snapshot = TakeSnapshot();
    const auto nothing = [](const InputStatus& input) {
      return input.received == 0 && (input.is_wanted() || input.kind == InputStatus::Kind::kCloud);
    };
    if (std::none_of(snapshot.inputs.begin(), snapshot.inputs.end(), nothing)) return snapshot;
    XmlRpc::XmlRpcValue request, answer, topics;
    request[0] = ros::this_node::getName();
    request[1] = "";
    constexpr bool kWaitForMaster = false;  // as ros::master::getTopics would, and an unload with it
    if (!ros::master::execute("getPublishedTopics", request, answer, topics, kWaitForMaster)) return snapshot;
    std::map<std::string, std::string> published;
    for (int i = 0; i < topics.size(); ++i) {
      published[static_cast<std::string&>(topics[i][0])] = static_cast<std::string&>(topics[i][1]);
    }
    AddAdvice(published, &snapshot.inputs);
    return snapshot;
  }

  NodeOptions options_;
  std::unique_ptr<SharedOptions> runtime_options_;
  std::vector<RuntimeOptions> auto_options_;  ///< of preset: auto, one for each of its settings; empty: never used
  std::unique_ptr<OutputPublisher> publisher_;
  std::atomic<bool> paused_{false};
  std::atomic<bool> flushing_{false};  ///< its progress is told in the log
  std::atomic<uint64_t> matched_{0};
  uint64_t next_reading_ = 10;  ///< of matched_: when FindReading is called unasked
  std::atomic<bool> reading_wanted_{false};

  std::mutex delivery_mutex_;
  mutable std::mutex intake_mutex_;
  std::unique_ptr<TfLookup> tf_;
  std::unique_ptr<KeyframeIntake> intake_;

  std::unique_ptr<MapperWorker> worker_;
  ros::WallTimer missing_timer_, reading_timer_;
  ros::WallTimer deliver_timer_;
  InputSources sources_;
  boost::recursive_mutex config_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<DenseMapperConfig>> reconfigure_;
  std::unique_ptr<Diagnostics<MapperSnapshot>> diagnostics_;
};

}  // namespace acmp

PLUGINLIB_EXPORT_CLASS(acmp::DenseMapperNodelet, nodelet::Nodelet)
