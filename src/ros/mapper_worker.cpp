#include "acmp_mapping/ros/mapper_worker.h"

#include <cmath>
#include <exception>
#include <future>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/ros/input_sources.h"

namespace acmp {
namespace {

constexpr char kStopped[] = "the mapper is shutting down";
constexpr size_t kMaxWaiting = 8;  ///< own refinements that wait for other shards before new keyframes have to

/// Pixels whose depth is published: known to the lens and confident enough.
Image<unsigned char> MakeKeepMask(const KeyframeDepth& maps, const cv::Mat& valid, double min_confidence) {
  Image<unsigned char> keep(maps.depth.width(), maps.depth.height(), 1);
  for (int row = 0; row < keep.height(); ++row) {
    for (int col = 0; col < keep.width(); ++col) {
      const bool known = valid.empty() || valid.at<uchar>(row, col) != 0;
      const bool confident = maps.confidence.empty() || maps.confidence(col, row) >= min_confidence;
      keep(col, row) = known && confident ? 1 : 0;
    }
  }
  return keep;
}

PointCloud KeptPoints(const KeyframeDepth& maps, ImageView<const unsigned char> keep, double min_confidence) {
  const PinholeCamera& camera = maps.frame->camera;
  PointCloud kept;
  kept.reserve(maps.points_in_camera.size());
  for (const SurfacePoint& point : maps.points_in_camera) {
    if (point.confidence < min_confidence) continue;
    const Eigen::Vector2d pixel = camera.Project({point.position.x, point.position.y, point.position.z});
    // Rounded as Contains does: -0.5 belongs to pixel 0.
    const int col = static_cast<int>(std::floor(pixel.x() + 0.5));
    const int row = static_cast<int>(std::floor(pixel.y() + 0.5));
    if (camera.Contains(pixel) && !keep(col, row)) continue;
    kept.push_back(point);
  }
  return kept;
}

}  // namespace

MapperWorker::MapperWorker(const NodeOptions& node_options, const SharedOptions* options, MapStore* map,
                           KeyframeNumbers* numbers, Hooks hooks)
    : node_options_(node_options),
      options_(options),
      map_(map),
      numbers_(numbers),
      hooks_(std::move(hooks)),
      queue_(node_options.overload, kWorkQueueCapacity * static_cast<size_t>(node_options.shard.count)),
      thread_([this] { Run(); }) {}

MapperWorker::~MapperWorker() {
  Stop();
  thread_.join();
}

void MapperWorker::Stop() {
  stopping_ = true;
  queue_.Stop();
}

void MapperWorker::Push(KeyframeInput input) {
  const int64_t number = numbers_->Assign(input.stamp_ns);
  const std::optional<NumberedInput> dropped = queue_.Push({std::move(input), number});
  if (!dropped || stopping_) return;
  const bool oldest = node_options_.overload == OverloadPolicy::kDropOldest;
  ReportUnmapped(
      *dropped,
      {oldest ? "overload_oldest" : "overload_busy",
       Concat("keyframe ", FormatStamp(dropped->keyframe.stamp_ns), ": the mapper is busy (~overload)"), true});
}

std::string MapperWorker::Flush() {
  return RunCommand(false, [this](const std::function<void()>& done) {
    if (!mapper_) throw ProcessingError(device_error_);
    if (hooks_.on_flush && last_number_ >= 0) hooks_.on_flush(last_number_);
    mapper_->Flush();
    when_finished_.push_back(done);
  });
}

void MapperWorker::StartOver(bool clear_map) {
  queue_.PushCommand([this, clear_map] {
    if (mapper_) mapper_->Flush(!clear_map);
    when_finished_.push_back([this, clear_map] {
      if (mapper_) mapper_->Reset();
      if (clear_map) {
        map_->Clear();
      } else {
        map_->StartRun();
      }
    });
  });
}

std::string MapperWorker::Reset() {
  for (const NumberedInput& input : queue_.ClearInputs()) {
    ReportUnmapped(input,
                   {"reset", Concat("keyframe ", FormatStamp(input.keyframe.stamp_ns), " was queued (reset)"), true});
  }
  return RunCommand(true, [this](const std::function<void()>& done) {
    if (mapper_) mapper_->Reset();
    flush_after_.reset();
    map_->Clear();
    done();
  });
}

void MapperWorker::AddPeerEstimate(ShardEstimate estimate) {
  // A std::function must be copyable.
  const auto shared = std::make_shared<ShardEstimate>(std::move(estimate));
  queue_.PushUrgent([this, shared] {
    if (mapper_) mapper_->SetPeerEstimate(std::move(*shared));
  });
}

void MapperWorker::FlushAfter(int64_t number) {
  queue_.PushUrgent([this, number] {
    if (number > last_number_) {
      flush_after_ = number;
    } else if (mapper_) {
      mapper_->Flush();
    }
  });
}

void MapperWorker::CheckWaiting() {
  queue_.PushUrgent([this] {
    const auto oldest = mapper_ ? mapper_->oldest_waiting() : std::nullopt;
    UpdateStatus([&](WorkerStatus* status) { status->waiting = mapper_ ? mapper_->waiting() : 0; });
    const double now_s = SteadySeconds();
    if (oldest != oldest_waiting_) {
      oldest_waiting_ = oldest;
      waiting_since_s_ = now_s;
    }
    if (!oldest || now_s - waiting_since_s_ < node_options_.shard_timeout_s) return;
    // What it waits for may have come while the worker was busy: that goes first.
    queue_.PushUrgent([this, oldest] {
      if (mapper_->oldest_waiting() == oldest) mapper_->StopWaiting();
    });
  });
}

std::string MapperWorker::RunCommand(bool urgent, const std::function<void(const std::function<void()>& done)>& work) {
  // Only the queue and the worker own the promise: if they are stopped first, the promise breaks and wakes us.
  auto promise = std::make_shared<std::promise<std::string>>();
  std::future<std::string> result = promise->get_future();
  auto command = [work, promise = std::move(promise)] {
    try {
      work([promise] { promise->set_value(""); });
    } catch (const std::exception& error) {
      promise->set_value(error.what());
    }
  };
  if (!(urgent ? queue_.PushUrgent(std::move(command)) : queue_.PushCommand(std::move(command)))) return kStopped;
  try {
    return result.get();
  } catch (const std::future_error&) {
    return kStopped;
  }
}

WorkerStatus MapperWorker::status() const {
  std::lock_guard<std::mutex> lock(status_mutex_);
  return status_;
}

template <class Change>
void MapperWorker::UpdateStatus(const Change& change) {
  std::lock_guard<std::mutex> lock(status_mutex_);
  change(&status_);
}

void MapperWorker::Run() {
  MakeMapper();
  if (!stopping_) hooks_.on_device(status());
  while (auto item = queue_.Pop(MustWait())) {
    if (auto* command = std::get_if<Command>(&*item)) {
      (*command)();
    } else {
      const NumberedInput& input = std::get<NumberedInput>(*item);
      const std::string name = Concat("keyframe ", FormatStamp(input.keyframe.stamp_ns), ": ");
      try {
        Process(input);
      } catch (const InvalidInputError& error) {
        ReportUnmapped(input, {"bad_image", name + error.what(), true});
      } catch (const std::exception& error) {
        ReportUnmapped(input, {"processing_error", name + error.what(), true});
      }
    }
    FinishWaits();
  }
  // The device's memory goes in a thread that has used it.
  mapper_.reset();
  output_engine_.reset();
  engine_.reset();
  when_finished_.clear();
}

/// With several shards: what waits for others must not pile up, and what was begun before comes first.
bool MapperWorker::MustWait() const {
  if (!when_finished_.empty()) return true;
  return mapper_ && mapper_->waiting() >= kMaxWaiting;
}

void MapperWorker::FinishWaits() {
  if (mapper_ && flush_after_ && last_number_ >= *flush_after_) {
    flush_after_.reset();
    mapper_->Flush();
  }
  if (mapper_ && mapper_->waiting() > 0) return;
  if (mapper_ && !when_finished_.empty()) mapper_->WaitForOutputs();
  for (const auto& finish : std::exchange(when_finished_, {})) finish();
}

void MapperWorker::MakeMapper() {
  try {
    DepthEngineBackend backend = MakeDepthEngine(node_options_.device, node_options_.cuda_device);
    engine_ = std::move(backend.engine);
    output_engine_ = engine_->Share();
    DenseMapper::Callbacks callbacks;
    callbacks.on_fast = [this](const KeyframeDepthPtr& maps) { HandleFast(maps); };
    callbacks.on_refined = [this](const KeyframeDepthPtr& maps) { HandleRefined(maps); };
    callbacks.on_refined_again = [this](const KeyframeDepthPtr& maps) { HandleRefinedAgain(maps); };
    callbacks.wants_refined_again = [this](int64_t id) { return !stopping_ && map_->HasPoints(id); };
    callbacks.on_drop = [this](const KeyframeDrop& drop) { HandleDrop(drop); };
    callbacks.on_own_estimate = [this](const ShardEstimate& estimate) {
      const RecordPtr record = FindRecord(pending_, estimate.id);
      if (!stopping_ && record) hooks_.on_own_estimate(estimate, record->stamp_ns);
    };
    callbacks.on_problem = [this](const std::string& reason, const std::string& message) {
      ReportDrop({reason, message});
    };
    mapper_ = std::make_unique<DenseMapper>(engine_.get(), options_->Get().mapper, callbacks, node_options_.shard,
                                            output_engine_.get());
    UpdateStatus([&](WorkerStatus* status) {
      status->ready = true;
      status->device_name = engine_->device_name();
      status->fallback_reason = backend.fallback_reason;
    });
  } catch (const std::exception& error) {
    device_error_ = error.what();
    UpdateStatus([&](WorkerStatus* status) { status->device_error = error.what(); });
  }
}

void MapperWorker::Process(const NumberedInput& numbered) {
  const KeyframeInput& input = numbered.keyframe;
  last_number_ = numbered.number;
  if (!mapper_) {
    return ReportUnmapped(numbered,
                          {"no_device", Concat("keyframe ", FormatStamp(input.stamp_ns), ": ", device_error_), true});
  }
  Timer timer;
  const RuntimeOptions options = options_->Get();
  mapper_->set_options(options.mapper);
  map_->set_options(options.map);
  min_confidence_ = options.output.min_confidence;

  cv::Mat valid;
  const FrameOptions frame_options = {node_options_.max_image_size, options.mapper.pipeline.sharpening};
  const FramePtr frame = PrepareFrame(numbered, frame_options, &valid);
  const double preparation_ms = timer.Lap();
  if (IsOwn(frame->id)) {
    auto record = std::make_shared<const Record>(
        Record{input.stamp_ns, input.arrival_s, input.camera_frame, input.world_frame, input.world_from_cam, valid});
    const std::lock_guard<std::mutex> lock(records_mutex_);
    pending_[frame->id] = std::move(record);
  }
  UpdateStatus([&](WorkerStatus* status) {
    ++status->keyframes;
    status->of_others += IsOwn(frame->id) ? 0 : 1;
    status->width = frame->camera.width;
    status->height = frame->camera.height;
    status->preparation_ms = preparation_ms;
  });
  mapper_->AddKeyframe(frame);
  {
    const std::lock_guard<std::mutex> lock(records_mutex_);
    while (refined_.size() > 2 * static_cast<size_t>(options.mapper.window_size)) refined_.erase(refined_.begin());
  }
  UpdateStatus([&](WorkerStatus* status) { status->keyframe_ms = preparation_ms + timer.Lap(); });
}

FramePtr MapperWorker::PrepareFrame(const NumberedInput& numbered, const FrameOptions& options, cv::Mat* valid) {
  const KeyframeInput& input = numbered.keyframe;
  if (!calibration_ || !SameCalibration(*calibration_, *input.calibration)) {
    rectifier_ = std::make_unique<ImageRectifier>(*input.calibration);
    calibration_ = input.calibration;
  }
  auto frame = std::make_shared<const Frame>(MakeFrame(
      numbered.number, static_cast<double>(input.stamp_ns) * 1e-9, rectifier_->Rectify(DecodeRgb(*input.image)),
      calibration_->camera, input.world_from_cam.inverse(), input.landmarks_in_world, options));
  if (!rectifier_->valid().empty()) {
    cv::resize(rectifier_->valid(), *valid, cv::Size(frame->camera.width, frame->camera.height), 0, 0,
               cv::INTER_NEAREST);
  }
  return frame;
}

MapperWorker::RecordPtr MapperWorker::FindRecord(const Records& records, int64_t id) const {
  const std::lock_guard<std::mutex> lock(records_mutex_);
  const auto found = records.find(id);
  return found == records.end() ? nullptr : found->second;
}

KeyframeOutput MapperWorker::MakeOutput(const KeyframeDepthPtr& maps, const Record& record) const {
  const double min_confidence = min_confidence_;
  KeyframeOutput output;
  output.maps = maps;
  output.stamp_ns = record.stamp_ns;
  output.camera_frame = record.camera_frame;
  output.world_frame = record.world_frame;
  output.world_from_cam = record.world_from_cam;
  output.keep = MakeKeepMask(*maps, record.valid, min_confidence);
  output.points_in_camera = KeptPoints(*maps, output.keep.View(), min_confidence);
  return output;
}

void MapperWorker::HandleFast(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(pending_, maps->frame->id);
  if (stopping_ || !record) return;
  const KeyframeOutput output = MakeOutput(maps, *record);
  map_->AddPose(maps->frame->id, output.stamp_ns, output.world_from_cam);
  Publish(hooks_.on_fast, output);
  const double latency_ms = LatencyMs(*record);
  UpdateStatus([&](WorkerStatus* status) {
    ++status->fast;
    status->fast_latency.Add(latency_ms);
  });
}

void MapperWorker::HandleRefined(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(pending_, maps->frame->id);
  if (stopping_ || !record) return;
  const KeyframeOutput output = MakeOutput(maps, *record);
  map_->AddPoints(maps->frame->id, output.stamp_ns, output.world_from_cam, output.points_in_camera);
  Publish(hooks_.on_refined, output);
  const double latency_ms = LatencyMs(*record);
  {
    const std::lock_guard<std::mutex> lock(records_mutex_);
    refined_.insert(pending_.extract(maps->frame->id));
  }
  UpdateStatus([&](WorkerStatus* status) {
    ++status->refined;
    status->refined_latency.Add(latency_ms);
    status->times = maps->times;
    status->consistency_ms = maps->consistency_ms;
  });
}

/// For the map: each keyframe's depth and points are published once.
void MapperWorker::HandleRefinedAgain(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(refined_, maps->frame->id);
  if (stopping_ || !record) return;
  try {  // the mapper's callbacks must not throw
    if (!map_->ReplacePoints(maps->frame->id, MakeOutput(maps, *record).points_in_camera)) return;
  } catch (const std::exception& error) {
    return ReportDrop({"refine_again_failed", Concat("image ", FormatStamp(record->stamp_ns), ": ", error.what())});
  }
  UpdateStatus([](WorkerStatus* status) { ++status->refined_again; });
}

double MapperWorker::LatencyMs(const Record& record) { return (SteadySeconds() - record.arrival_s) * 1e3; }

void MapperWorker::Publish(const std::function<void(const KeyframeOutput&)>& hook, const KeyframeOutput& output) const {
  try {
    hook(output);
  } catch (const std::exception& error) {  // the mapper's callbacks must not throw
    ReportDrop({"publish_error", Concat("image ", FormatStamp(output.stamp_ns), ": ", error.what())});
  }
}

void MapperWorker::HandleDrop(const KeyframeDrop& drop) {
  const RecordPtr record = FindRecord(pending_, drop.id);
  const std::string stamp = record ? FormatStamp(record->stamp_ns) : "?";
  if (record) {
    if (!stopping_ && hooks_.on_dropped_keyframe) {
      hooks_.on_dropped_keyframe(drop.id, record->stamp_ns, drop.reason);
    }
    const std::lock_guard<std::mutex> lock(records_mutex_);
    pending_.erase(drop.id);
  }
  ReportDrop({drop.reason, Concat("image ", stamp, drop.had_fast ? " (refinement only): " : ": ", drop.message), true});
}

/// A keyframe that never got to the mapper: if it is this shard's, nobody needs to wait for it.
void MapperWorker::ReportUnmapped(const NumberedInput& input, const Drop& drop) const {
  ReportDrop(drop);
  if (stopping_ || node_options_.shard.count == 1 || !IsOwn(input.number)) return;
  hooks_.on_own_estimate({input.number, EstimateStage::kFast, {}}, input.keyframe.stamp_ns);
  hooks_.on_dropped_keyframe(input.number, input.keyframe.stamp_ns, drop.reason);
}

void MapperWorker::ReportDrop(const Drop& drop) const {
  if (!stopping_) hooks_.on_drop(drop);
}

}  // namespace acmp
