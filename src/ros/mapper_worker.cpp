#include "acmp_mapping/ros/mapper_worker.h"

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
  min_confidence_ = options.min_confidence;

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
