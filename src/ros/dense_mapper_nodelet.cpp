#include "acmp_mapping/ros/dense_mapper_nodelet.h"

#include <cmath>
#include <utility>

#include <pluginlib/class_list_macros.hpp>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr double kDeliverPeriodS = 0.05;  ///< how late a wait for a cloud may end
constexpr double kMapPeriodS = 0.1;       ///< how often the map's rate limit is looked at

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
    for (CallbackThread* thread : {&input_thread_, &service_thread_, &status_thread_, &exchange_thread_})
      thread->Start();
  } catch (const std::exception& error) {
    NODELET_FATAL("cannot start: %s", error.what());
    throw;
  }
  NODELET_INFO("image %s, camera_info %s, pose %s (%s), sparse_points %s", image_source_->status().topic.c_str(),
               camera_info_source_->status().topic.c_str(), pose_source_->status().topic.c_str(),
               Describe(options_.pose).c_str(), cloud_source_->status().topic.c_str());
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
  reader.CheckUnknown();
  config_ = ToConfig(runtime_options);
  runtime_options_ = std::make_unique<SharedOptions>(runtime_options);
}

void DenseMapperNodelet::StartWorker() {
  const RuntimeOptions runtime_options = runtime_options_->Get();
  map_ = std::make_unique<MapStore>(runtime_options.map);
  map_output_ = std::make_unique<MapOutput>(status_thread_.Attach(getNodeHandle()), map_.get());
  intake_ = std::make_unique<KeyframeIntake>(options_, runtime_options.gate, FallbackDepth(runtime_options.mapper));
  MapperWorker::Hooks hooks;
  hooks.on_device = [this](const WorkerStatus& status) { LogDevice(status); };
  hooks.on_fast = [this](const KeyframeOutput& output) {
    publisher_->PublishFast(output, static_cast<size_t>(runtime_options_->Get().map.max_keyframes));
  };
  hooks.on_refined = [this](const KeyframeOutput& output) {
    map_output_->SetHeader(output.world_frame, output.stamp_ns);
    if (exchange_) exchange_->PublishPoints(output);
    publisher_->PublishRefined(output);
  };
  hooks.on_drop = [this](const Drop& drop) { ReportDrop(drop); };
  hooks.on_map_cleared = [this] { publisher_->ClearPath(); };
  hooks.on_warning = [this](const std::string& warning) { NODELET_WARN("%s", warning.c_str()); };
  if (options_.shard.count > 1) StartExchange(&hooks);
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
  config_.__toServer__(nh);  // the server starts from there
  reconfigure_ = std::make_unique<dynamic_reconfigure::Server<DenseMapperConfig>>(config_mutex_, nh);
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
  const DropHandler on_drop = [this](const Drop& drop) { ReportDrop(drop); };
  const auto on_cloud = [this](SparseCloudPtr c) { Receive([&](auto* intake) { intake->AddCloud(std::move(c)); }); };
  const auto on_pose = [this](PoseSample p) { Receive([&](auto* intake) { intake->AddPose(std::move(p)); }); };
  const auto on_info = [this](const sensor_msgs::CameraInfo& info) {
    Receive([&](auto* intake) { intake->AddCameraInfo(info); });
  };
  const auto on_image = [this](std::shared_ptr<const EncodedImage> image) { HandleImage(std::move(image)); };
  cloud_source_ = MakeCloudSource(nh, options_, on_cloud, on_drop);
  pose_source_ = MakePoseSource(nh, options_, on_pose, on_drop);
  camera_info_source_ = MakeCameraInfoSource(nh, on_info, on_drop);
  image_source_ = MakeImageSource(nh, options_, on_image, on_drop);
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

void DenseMapperNodelet::HandleImage(std::shared_ptr<const EncodedImage> image) {
  if (paused_) {
    return ReportDrop({"paused", Concat("image ", FormatStamp(ToStampNs(image->header().stamp)), " (~pause)")});
  }
  Receive([&](KeyframeIntake* intake) { intake->AddImage(std::move(image)); });
}

void DenseMapperNodelet::HandleConfig(DenseMapperConfig& config) {
  for (const std::string& change : MakeValid(config_, &config)) NODELET_WARN("%s", change.c_str());
  config_ = config;
  const RuntimeOptions runtime_options = FromConfig(config);
  runtime_options_->Set(runtime_options);
  std::lock_guard<std::mutex> lock(intake_mutex_);
  intake_->set_gate(runtime_options.gate, FallbackDepth(runtime_options.mapper));
}

void DenseMapperNodelet::Deliver(bool all) {
  // Clouds of a player that has ended may still be queued behind their images.
  const InputStatus clouds = cloud_source_->status();
  const bool clouds_expected = clouds.publishers > 0 || clouds.received > 0;
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
  if (auto* jump = std::get_if<TimeJump>(&event)) {
    NODELET_WARN("time jumped back from image %s to %s: buffers and window are cleared",
                 FormatStamp(jump->from_ns).c_str(), FormatStamp(jump->to_ns).c_str());
    return worker_->StartOver(options_.on_time_jump == TimeJumpPolicy::kReset);
  }
  ++matched_;
  worker_->Push(std::move(std::get<KeyframeInput>(event)));
}

void DenseMapperNodelet::ReportDrop(const Drop& drop) {
  if (drops_.Record(drop, SteadySeconds())) NODELET_WARN("%s: %s", drop.reason.c_str(), drop.message.c_str());
}

void DenseMapperNodelet::HandlePeriod() {
  try {
    map_output_->PublishIfDue(runtime_options_->Get().output.map_publish_rate);
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
  snapshot.image = image_source_->status();
  snapshot.camera_info = camera_info_source_->status();
  snapshot.pose = pose_source_->status();
  snapshot.sparse_points = cloud_source_->status();
  snapshot.matched = matched_;
  snapshot.sync_tolerance_s = options_.matcher.sync_tolerance_s;
  snapshot.queued = worker_->queued();
  snapshot.worker = worker_->status();
  snapshot.map = map_->statistics();
  snapshot.drops = drops_.entries();
  snapshot.shard = options_.shard;
  if (exchange_) snapshot.peers = exchange_->peers();
  std::lock_guard<std::mutex> lock(intake_mutex_);
  snapshot.waiting_images = intake_->waiting_images();
  snapshot.not_chosen = intake_->not_chosen();
  snapshot.last_gap = intake_->last_gap();
  return snapshot;
}

}  // namespace acmp

PLUGINLIB_EXPORT_CLASS(acmp::DenseMapperNodelet, nodelet::Nodelet)
