#include "acmp_mapping/ros/dense_mapper_nodelet.h"

#include <cmath>
#include <utility>

#include <pluginlib/class_list_macros.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/calibration_file.h"
#include "acmp_mapping/ros/optimized_path.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

constexpr double kDeliverPeriodS = 0.05;  ///< how late a wait for a cloud may end
constexpr double kMapPeriodS = 0.1;       ///< how often the map's rate limit is looked at
constexpr uint32_t kPathQueue = 2;        ///< each path replaces the one before

/// Where the scene is assumed while nothing tells: the middle of the fallback range, as the mapper has it.
double FallbackDepth(const DenseMapperOptions& options) {
  return std::sqrt(static_cast<double>(options.fallback_depth_range.min) * options.fallback_depth_range.max);
}

/// Services answer with a message on success and an exception on failure.
std::string Expect(const std::string& failure, const char* success) {
  if (!failure.empty()) throw ProcessingError(failure);
  return success;
}

}  // namespace

DenseMapperNodelet::~DenseMapperNodelet() {
  // First everything that waits is woken and the worker's hooks fall silent; then the threads end; members go after
  // that.
  if (worker_) worker_->Stop();
  input_thread_.Stop();
  service_thread_.Stop();
  status_thread_.Stop();
  if (master_watch_) master_watch_->Stop();
  exchange_thread_.Stop();
  worker_.reset();
}

void DenseMapperNodelet::onInit() {
  try {
    LoadOptions();
    publisher_ = std::make_unique<OutputPublisher>(status_thread_.Attach(getNodeHandle()));
    StartWorker();
    StartReconfigure();
    Subscribe();
    StartServices();
    diagnostics_ = std::make_unique<MapperDiagnostics>(status_thread_.Attach(getNodeHandle()), getPrivateNodeHandle(),
                                                       getName(), [this] { return TakeSnapshot(); });
    master_watch_ = std::make_unique<MasterWatch>(
        getNodeHandle(), [this](const std::string& news) { NODELET_WARN("%s", news.c_str()); });
    for (CallbackThread* thread : {&input_thread_, &service_thread_, &status_thread_, &exchange_thread_}) {
      thread->Start();
    }
    master_watch_->Start();
  } catch (const std::exception& error) {
    NODELET_FATAL("cannot start: %s", error.what());
    throw;
  }
  std::string topics;
  for (const auto& source : sources_) topics += source->status().topic + " ";
  NODELET_INFO("subscribed to %s; poses are %s", topics.c_str(), Describe(options_.pose).c_str());
}

void DenseMapperNodelet::LoadOptions() {
  XmlRpc::XmlRpcValue values;
  getPrivateNodeHandle().getParam(getPrivateNodeHandle().getNamespace(), values);
  ParameterReader reader(values);
  reader.Allow("diagnostic_period");   // diagnostic_updater
  reader.Allow("num_worker_threads");  // a nodelet manager of the same name
  options_ = LoadNodeOptions(&reader);
  RuntimeOptions start;
  start.mapper.pipeline = MakePreset(options_.preset);
  const RuntimeOptions runtime_options = LoadRuntimeOptions(&reader, start);
  map_options_ = LoadMapServerOptions(&reader);
  for (const std::string& warning : reader.DescribeUnknown()) NODELET_WARN("%s", warning.c_str());
  runtime_options_ = std::make_unique<SharedOptions>(runtime_options);
}

void DenseMapperNodelet::StartWorker() {
  const RuntimeOptions runtime_options = runtime_options_->Get();
  map_ = std::make_unique<MapStore>(map_options_.map);
  map_output_ = std::make_unique<MapOutput>(status_thread_.Attach(getNodeHandle()), map_.get());
  MakeIntake(runtime_options);
  MapperWorker::Hooks hooks;
  hooks.on_device = [this](const WorkerStatus& status) { LogDevice(status); };
  hooks.on_fast = [this](const KeyframeOutput& output) {
    publisher_->PublishFast(output);
    {
      std::lock_guard<std::mutex> lock(path_mutex_);
      path_frame_ = output.world_frame;
    }
    PublishPath();
  };
  hooks.on_refined = [this](const KeyframeOutput& output) {
    map_output_->SetHeader(output.world_frame, output.stamp_ns);
    if (exchange_) exchange_->PublishPoints(output);
    publisher_->PublishRefined(output);
  };
  hooks.on_drop = [this](const Drop& drop) { ReportDrop(drop); };
  if (options_.shard.count > 1) {
    StartExchange(&hooks);
    const DenseMapperOptions& mapper = runtime_options.mapper;
    if (mapper.reestimates > 0)
      NODELET_INFO("reestimates = %d: without effect with several shards", mapper.reestimates);
    if (mapper.refine_again) NODELET_INFO("refine_again = true: without effect with several shards");
  }
  worker_ = std::make_unique<MapperWorker>(options_, runtime_options_.get(), map_.get(), &numbers_, hooks);
}

void DenseMapperNodelet::StartExchange(MapperWorker::Hooks* hooks) {
  ShardExchange::Handlers handlers;  // they run when the thread does, with a worker
  handlers.on_estimate = [this](ShardEstimate estimate) { worker_->AddPeerEstimate(std::move(estimate)); };
  handlers.on_flush = [this](int64_t number) { worker_->FlushAfter(number); };
  handlers.on_period = [this] { worker_->CheckWaiting(); };
  handlers.on_drop = [this](const Drop& drop) { ReportDrop(drop); };
  exchange_ = std::make_unique<ShardExchange>(exchange_thread_.Attach(getNodeHandle()), options_.shard, &numbers_,
                                              std::move(handlers));
  hooks->on_own_estimate = [this](const ShardEstimate& estimate, int64_t stamp_ns) {
    exchange_->PublishEstimate(estimate, stamp_ns);
  };
  hooks->on_dropped_keyframe = [this](int64_t number, int64_t stamp_ns, const std::string& reason) {
    exchange_->PublishDropped(number, stamp_ns, reason);
  };
  hooks->on_flush = [this](int64_t number) { exchange_->PublishFlush(number); };
}

void DenseMapperNodelet::MakeIntake(const RuntimeOptions& runtime_options) {
  TransformSource transforms;
  if (options_.pose_source == PoseSource::kTf || NeedsExtrinsic(options_)) {
    tf_ = std::make_unique<TfLookup>(input_thread_.Attach(getNodeHandle()));
    transforms.find_pose = [this](const std::string& world, const std::string& child, int64_t stamp_ns) {
      return tf_->FindPose(world, child, stamp_ns);
    };
    transforms.find_latest = [this](const std::string& target, const std::string& source) {
      return tf_->FindLatest(target, source);
    };
  }
  intake_ = std::make_unique<KeyframeIntake>(options_, runtime_options.gate, FallbackDepth(runtime_options.mapper),
                                             transforms);
  if (!options_.calibration_file.empty()) intake_->AddCameraInfo(ReadCalibrationFile(options_.calibration_file));
}

void DenseMapperNodelet::LogDevice(const WorkerStatus& status) {
  if (!status.ready) {
    NODELET_ERROR("no device to match on: %s", status.device_error.c_str());
  } else if (!status.fallback_reason.empty()) {
    NODELET_WARN("mapping on %s, since there is no GPU: %s", status.device_name.c_str(),
                 status.fallback_reason.c_str());
  } else {
    NODELET_INFO("mapping on %s", status.device_name.c_str());
  }
}

void DenseMapperNodelet::StartReconfigure() {
  const ros::NodeHandle nh = status_thread_.Attach(getPrivateNodeHandle());
  ToConfig(runtime_options_->Get()).__toServer__(nh);  // the server starts from there
  reconfigure_ = std::make_unique<dynamic_reconfigure::Server<DenseMapperConfig>>(config_mutex_, nh);
  const auto [least, largest] = ConfigBounds();
  reconfigure_->setConfigMin(least);
  reconfigure_->setConfigMax(largest);
  reconfigure_->setCallback([this](DenseMapperConfig& config, uint32_t) { HandleConfig(config); });
}

template <class Add>
void DenseMapperNodelet::Receive(const Add& add) {
  {
    std::lock_guard<std::mutex> lock(intake_mutex_);
    add(intake_.get());
  }
  Deliver();
}

void DenseMapperNodelet::Subscribe() {
  ros::NodeHandle nh = input_thread_.Attach(getNodeHandle());
  InputHandlers handlers;
  handlers.on_cloud = [this](SparseCloudPtr c) { Receive([&](auto* intake) { intake->AddCloud(std::move(c)); }); };
  handlers.on_pose = [this](PoseSample p) { Receive([&](auto* intake) { intake->AddPose(std::move(p)); }); };
  handlers.on_tf = [this] { Deliver(); };
  handlers.on_extrinsic = [this](const RigidTransform& t) { Receive([&](auto* intake) { intake->SetExtrinsic(t); }); };
  handlers.on_camera_info = [this](const sensor_msgs::CameraInfo& info) {
    Receive([&](auto* intake) { intake->AddCameraInfo(info); });
  };
  handlers.on_image = [this](std::shared_ptr<const EncodedImage> image) {
    if (DropWhilePaused(image->header())) return;
    Receive([&](auto* intake) { intake->AddImage(std::move(image), SteadySeconds()); });
  };
  handlers.on_keyframe = [this](const acmp_mapping::KeyframeConstPtr& keyframe) {
    if (DropWhilePaused(keyframe->header)) return;
    Receive([&](auto* intake) { intake->AddKeyframe(keyframe, SteadySeconds()); });
  };
  handlers.on_drop = [this](const Drop& drop) { ReportDrop(drop); };
  sources_ = MakeInputSources(nh, options_, handlers);
  const boost::function<void(const nav_msgs::PathConstPtr&)> on_path = [this](const nav_msgs::PathConstPtr& path) {
    HandleOptimizedPath(*path);
  };
  optimized_path_ = status_thread_.Attach(getNodeHandle()).subscribe(names::kOptimizedPath, kPathQueue, on_path);
  deliver_timer_ =
      nh.createWallTimer(ros::WallDuration(kDeliverPeriodS), [this](const ros::WallTimerEvent&) { Deliver(); });
}

void DenseMapperNodelet::StartServices() {
  MapperServices::Handlers handlers;
  handlers.flush = [this] {
    Deliver(true);
    return Expect(worker_->Flush(), "all keyframes are finished");
  };
  handlers.reset = [this] { return Reset(); };
  handlers.publish_map = [this] {
    const size_t points = map_output_->Publish();
    return Concat("published ", points, " points");
  };
  handlers.pause = [this](bool pause) -> std::string {
    paused_ = pause;
    return pause ? "paused: images are dropped" : "running";
  };
  handlers.save_map = [this](const acmp_mapping::SaveMap::Request& request) { return map_output_->Save(request); };
  handlers.periodic = [this] { HandlePeriod(); };
  services_ = std::make_unique<MapperServices>(service_thread_.Attach(getPrivateNodeHandle()), kMapPeriodS, handlers);
}

bool DenseMapperNodelet::DropWhilePaused(const std_msgs::Header& header) {
  if (paused_) ReportDrop({"paused", Concat("image ", FormatStamp(ToStampNs(header.stamp)), " (~pause)"), true});
  return paused_;
}

void DenseMapperNodelet::HandleConfig(DenseMapperConfig& config) {
  const RuntimeOptions current = runtime_options_->Get();
  try {
    const RuntimeOptions wanted = FromConfig(config, current);
    runtime_options_->Set(wanted);
    std::lock_guard<std::mutex> lock(intake_mutex_);
    intake_->set_gate(wanted.gate, FallbackDepth(wanted.mapper));
  } catch (const InvalidInputError& error) {
    NODELET_WARN("the change of parameters was refused: %s", error.what());
    config = ToConfig(current);
  }
}

void DenseMapperNodelet::Deliver(bool all) {
  // Clouds of a player that has ended may still be queued behind their images.
  const bool clouds_expected = std::any_of(sources_.begin(), sources_.end(), [](const auto& source) {
    const InputStatus status = source->status();
    return status.kind == InputStatus::Kind::kCloud && (status.publishers > 0 || status.received > 0);
  });
  std::lock_guard<std::mutex> delivery_lock(delivery_mutex_);
  std::vector<IntakeEvent> events;
  {
    std::lock_guard<std::mutex> lock(intake_mutex_);
    intake_->set_clouds_expected(clouds_expected);
    events = all ? intake_->TakeAll() : intake_->Take(SteadySeconds() - blocked_s_);
  }
  const double start_s = SteadySeconds();
  for (IntakeEvent& event : events) Dispatch(std::move(event));
  blocked_s_ += SteadySeconds() - start_s;
}

void DenseMapperNodelet::Dispatch(IntakeEvent event) {
  if (auto* drop = std::get_if<Drop>(&event)) return ReportDrop(*drop);
  if (auto* notice = std::get_if<Notice>(&event)) {
    if (notice->warning) {
      NODELET_WARN("%s", notice->text.c_str());
    } else {
      NODELET_INFO("%s", notice->text.c_str());
    }
    return;
  }
  if (auto* jump = std::get_if<TimeJump>(&event)) {
    if (tf_) tf_->Clear();
    NODELET_WARN("time jumped back from image %s to %s: buffers and window are cleared",
                 FormatStamp(jump->from_ns).c_str(), FormatStamp(jump->to_ns).c_str());
    return worker_->StartOver(map_options_.on_time_jump == TimeJumpPolicy::kReset);
  }
  ++matched_;
  worker_->Push(std::move(std::get<KeyframeInput>(event)));
}

void DenseMapperNodelet::ReportDrop(const Drop& drop) {
  if (drops_.Record(drop, SteadySeconds())) NODELET_WARN("%s: %s", drop.reason.c_str(), drop.message.c_str());
}

void DenseMapperNodelet::HandleOptimizedPath(const nav_msgs::Path& message) {
  std::optional<PoseResolver> resolver;
  {
    std::lock_guard<std::mutex> lock(intake_mutex_);
    resolver = intake_->path_resolver();
  }
  if (!resolver->ready()) {
    return ReportDrop({"bad_optimized_path", Concat("optimized_path: ", resolver->DescribeMissing())});
  }
  const auto world_from_camera = [&resolver](const RigidTransform& received) {
    return resolver->WorldFromCamera(received);
  };
  std::string world_frame;
  if (options_.world_frame.empty()) {  // else it replaces the frames of all inputs
    std::lock_guard<std::mutex> lock(path_mutex_);
    world_frame = path_frame_;
  }
  const auto on_doubt = [this](const Drop& doubt) {
    if (path_doubts_.Record(doubt, SteadySeconds())) {
      NODELET_WARN("%s: %s", doubt.reason.c_str(), doubt.message.c_str());
    }
  };
  const bool moved = ApplyOptimizedPath(
      message, world_frame, world_from_camera, options_.matcher.sync_tolerance_s, map_.get(),
      [this](const Drop& drop) { ReportDrop(drop); }, on_doubt);
  if (moved) PublishPath();
}

void DenseMapperNodelet::PublishPath() {
  std::lock_guard<std::mutex> lock(path_mutex_);
  publisher_->PublishPath(map_->Path(), path_frame_);
}

void DenseMapperNodelet::HandlePeriod() {
  try {
    map_output_->PublishIfDue(map_options_.map_publish_rate);
  } catch (const std::exception& error) {  // a thrown exception would end the whole manager
    ReportDrop({"map_error", Concat("the map was not published: ", error.what())});
  }
}

std::string DenseMapperNodelet::Reset() {
  {
    std::lock_guard<std::mutex> lock(intake_mutex_);
    intake_->Clear();
  }
  const std::string failure = worker_->Reset();
  Deliver();  // the drops; only now, since a full queue might have blocked it
  return Expect(failure, "buffers, window and map are empty");
}

MapperSnapshot DenseMapperNodelet::TakeSnapshot() {
  MapperSnapshot snapshot;
  snapshot.now_s = SteadySeconds();
  snapshot.paused = paused_;
  for (const auto& source : sources_) snapshot.inputs.push_back(source->status());
  snapshot.matched = matched_;
  snapshot.sync_tolerance_s = options_.matcher.sync_tolerance_s;
  snapshot.queued = worker_->queued();
  snapshot.worker = worker_->status();
  snapshot.map = map_->statistics();
  snapshot.optimized_path_topic = optimized_path_.getTopic();
  snapshot.optimized_path_publishers = optimized_path_.getNumPublishers();
  snapshot.drops = drops_.entries();
  snapshot.images_dropped = drops_.images();
  snapshot.path_doubts = path_doubts_.entries();
  snapshot.shard = options_.shard;
  if (exchange_) snapshot.peers = exchange_->peers();
  std::lock_guard<std::mutex> lock(intake_mutex_);
  snapshot.waiting_images = intake_->waiting_images();
  snapshot.waiting_for = intake_->DescribeWait(snapshot.now_s);
  snapshot.not_chosen = intake_->not_chosen();
  snapshot.last_gap = intake_->last_gap();
  snapshot.points_in_front = intake_->share_in_front();
  return snapshot;
}

}  // namespace acmp

PLUGINLIB_EXPORT_CLASS(acmp::DenseMapperNodelet, nodelet::Nodelet)
