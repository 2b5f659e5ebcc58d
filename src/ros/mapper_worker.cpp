#include "acmp_mapping/ros/mapper_worker.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <future>
#include <limits>
#include <utility>

#include <ros/time.h>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/common/thread_limit.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/ros/callback_thread.h"
#include "acmp_mapping/ros/diagnostics.h"

namespace acmp {
namespace {

constexpr char kWhenBusy[] =
    "; try ~preset: auto or online, a smaller ~max_image_size, or ~overload: block for recordings";
constexpr char kStopped[] = "the mapper is shutting down";

/// A number that no earlier run of this mapper had, also of one before the program was started again.
uint64_t NewRun() { return ros::WallTime::now().toNSec(); }

/// Keyframes over which the time between two is measured.
constexpr size_t kPaceKeyframes = 11;

/// Of a camera: nothing may make keyframes wait. A recording that waits gives the same maps again.
bool IsLive(const NodeOptions& options) { return options.overload != OverloadPolicy::kBlock; }

size_t BytesOf(const std::shared_ptr<const EncodedImage>& image) {
  if (!image) return 0;
  return image->raw ? image->raw->data.size() : image->compressed->data.size();
}

/// What an input holds on to.
size_t BytesOf(const KeyframeInput& input) {
  size_t bytes = BytesOf(input.image) + BytesOf(input.mask) + BytesOf(input.prior_depth) + BytesOf(input.labels);
  for (const SourceImage& source : input.source_images) bytes += BytesOf(source.image);
  return bytes + input.landmarks_in_world.size() * sizeof(Eigen::Vector3d);
}

/// Mean time between stamps; none where there are too few to tell.
std::optional<double> MeanInterval(const std::deque<int64_t>& stamps_ns) {
  constexpr size_t kFewest = 3;
  if (stamps_ns.size() < kFewest) return std::nullopt;
  return 1e-9 * static_cast<double>(stamps_ns.back() - stamps_ns.front()) / static_cast<double>(stamps_ns.size() - 1);
}

}  // namespace

void InputPace::Add(double now_s) {
  newest_s_.push_back(now_s);
  if (newest_s_.size() > kPaceKeyframes) newest_s_.pop_front();
}

double InputPace::WaitFor(double now_s, double takes_s) const {
  if (newest_s_.empty()) return 0;
  constexpr double kUnknown_s = 0.1, kLate = 1.5;
  const double last_s = newest_s_.back();
  const double interval_s =
      newest_s_.size() < 2 ? kUnknown_s : (last_s - newest_s_.front()) / static_cast<double>(newest_s_.size() - 1);
  if (now_s + takes_s <= last_s + interval_s) return 0;
  return std::max(0.0, last_s + kLate * interval_s - now_s);
}

MapperWorker::MapperWorker(const NodeOptions& node_options, const SharedOptions* options, Mask fixed_mask,
                           OutputPublisher* outputs, Hooks hooks)
    : node_options_(node_options),
      options_(options),
      outputs_(outputs),
      hooks_(std::move(hooks)),
      preparation_(node_options_, std::move(fixed_mask),
                   [outputs](const RejectedInput& rejected) { outputs->Report(rejected); }),
      queue_(node_options.overload, static_cast<size_t>(1e9 * DefaultMemoryLimitGb()), SteadySeconds),
      run_(NewRun()),
      thread_([this] { Run(); }) {}

MapperWorker::~MapperWorker() {
  Stop();
  if (thread_.joinable()) thread_.join();
}

void MapperWorker::Stop() {
  outputs_->Stop();
  stop_.Request();
  queue_.Stop();
}

bool MapperWorker::IsKeyframe(const KeyframeInput& input) {
  const KeyframeGateOptions options = options_->Get().gate;
  const std::lock_guard<std::mutex> lock(status_mutex_);
  if (node_options_.keyframe_mode == KeyframeMode::kGate) {
    gate_.set_options(options);
    const double depth = input.scene_depth > 0 ? input.scene_depth : scene_depth_;
    if (!gate_.Accept(input.world_from_cam, input.calibration->camera, depth)) {
      outputs_->PassOver();
      return false;
    }
  }
  if (!newest_stamps_ns_.empty() && input.stamp_ns <= newest_stamps_ns_.back()) newest_stamps_ns_.clear();
  newest_stamps_ns_.push_back(input.stamp_ns);
  if (newest_stamps_ns_.size() > kPaceKeyframes) newest_stamps_ns_.pop_front();
  pace_.Add(SteadySeconds());
  return true;
}

void MapperWorker::Push(KeyframeInput input, bool must_wait) {
  if (IsLive(node_options_) && !IsKeyframe(input)) return;
  const size_t bytes = BytesOf(input);
  const std::optional<KeyframeInput> dropped = queue_.Push(std::move(input), bytes, must_wait);
  if (!dropped) return;
  const std::string why =
      must_wait || !IsLive(node_options_)
          ? Concat(": images of ", DefaultMemoryLimitGb(),
                   " GB, a quarter of the memory, wait for the mapper already: play the recording more slowly "
                   "(rosbag play -r), or set a smaller max_image_size")
          : Concat(": the mapper is busy (~overload)", kWhenBusy);
  outputs_->Report({"overload", Concat("keyframe ", FormatStamp(dropped->stamp_ns), why), true});
}

std::string MapperWorker::Flush() {
  return RunCommand(false, [this] {
    if (!mapper_) throw ProcessingError(device_error_);
    FlushMapper();
    if (stop_.requested()) throw ProcessingError("a reset, or the end, came before all was finished");
  });
}

void MapperWorker::ResetGate() {
  const std::lock_guard<std::mutex> lock(status_mutex_);
  gate_.Reset();
}

void MapperWorker::BeginRun() {
  if (mapper_) mapper_->Reset();
  outputs_->ForgetNewest();
  if (!IsLive(node_options_)) ResetGate();
  preparation_.ForgetRigs();  // another world may have another unit
  run_ = NewRun();
  UpdateStatus([this](WorkerStatus*) { scene_depth_ = 0; });
}

void MapperWorker::StartOver() {
  if (IsLive(node_options_)) ResetGate();
  queue_.PushCommand([this] {
    if (mapper_) FlushMapper();
    BeginRun();
  });
}

std::string MapperWorker::Reset() {
  if (IsLive(node_options_)) ResetGate();
  for (const KeyframeInput& input : queue_.ClearInputs()) {
    outputs_->Report({"reset", Concat("keyframe ", FormatStamp(input.stamp_ns), " was queued (reset)"), true});
  }
  stop_.Request();
  return RunCommand(true, [this] {
    const std::unique_ptr<StopRequest, void (*)(StopRequest*)> clear(&stop_, [](StopRequest* stop) { stop->Clear(); });
    BeginRun();
  });
}

void MapperWorker::JudgeRigs(bool at_end) {
  const std::string text = preparation_.JudgeRigs(at_end);
  bool is_new = false;
  UpdateStatus([&](WorkerStatus* status) { is_new = std::exchange(status->rig, text) != text; });
  if (is_new && !text.empty()) outputs_->Report({"source_camera_place", text});
}

PreparationOptions MapperWorker::HowToPrepare() const {
  PreparationOptions how;
  how.run = run_;
  if (auto_preset_) how.size = auto_preset_->setting().size;
  how.uses_prior_depth = options_->Get().mapper.pipeline.fill.enabled;
  return how;
}

std::string MapperWorker::RunCommand(bool urgent, const std::function<void()>& work) {
  // Only the queue and the worker own the task: if they are stopped first, its promise breaks and wakes us.
  auto task = std::make_shared<std::packaged_task<void()>>(work);
  std::future<void> done = task->get_future();
  Command command = [task = std::move(task)] { (*task)(); };
  try {
    if (!queue_.PushCommand(std::move(command), urgent)) return kStopped;
    done.get();
    return "";
  } catch (const std::future_error&) {
    return kStopped;
  } catch (const std::exception& error) {
    return error.what();
  }
}

WorkerStatus MapperWorker::status() const {
  WorkerStatus status;
  {
    std::lock_guard<std::mutex> lock(status_mutex_);
    status = status_;
  }
  status.outputs = outputs_->status();
  return status;
}

void MapperWorker::Run() {
  const auto report = [this](const std::string& text) { outputs_->Report({"processing_error", text}); };
  MakeMapper();
  CallGuarded(
      [this] {
        if (!outputs_->is_stopping()) hooks_.on_device(status());
      },
      report);
  // A GPU leaves short loops over an image to the CPU.
  constexpr int kThreadsBesideGpu = 4, kAll = std::numeric_limits<int>::max();
  ThreadLimit threads(status().on_cpu ? kAll : kThreadsBesideGpu);
  while (auto item = queue_.Pop(IdleWait())) {
    threads.Run([&] {
      if (item->is_idle()) return CallGuarded([this] { CatchUp(); }, report);
      may_catch_up_ = IsLive(node_options_);
      if (item->command) return CallGuarded(*item->command, report);
      constexpr double kForget = 0.95;  // or one thing that took long would be the last
      catch_up_s_ *= kForget;
      if (!IsLive(node_options_) && !IsKeyframe(*item->input)) return;
      ProcessOrDrop(*item->input, item->overtaken ? &MapperWorker::ProcessOvertaken : &MapperWorker::Process);
    });
  }
  // The device's memory goes in a thread that has used it.
  mapper_.reset();
  output_engine_.reset();
  engine_.reset();
}

std::optional<double> MapperWorker::IdleWait() const {
  if (!may_catch_up_ || !mapper_) return std::nullopt;
  const std::lock_guard<std::mutex> lock(status_mutex_);
  return pace_.WaitFor(SteadySeconds(), catch_up_s_);
}

void MapperWorker::CatchUp() {
  Timer timer;
  may_catch_up_ = false;  // nor after a failure
  may_catch_up_ = mapper_->CatchUp();
  if (may_catch_up_) catch_up_s_ = std::max(catch_up_s_, 1e-3 * timer.Lap());
  UpdateStatus([&](WorkerStatus* status) { status->left_out = mapper_->left_out(); });
}

void MapperWorker::ProcessOrDrop(const KeyframeInput& input, void (MapperWorker::*process)(const KeyframeInput&)) {
  const char* reason = "processing_error";
  const auto work = [&] {
    try {
      (this->*process)(input);
    } catch (const InvalidInputError&) {
      reason = "bad_image";
      throw;
    }
  };
  CallGuarded(work, [&](const std::string& text) {
    const std::string topic = input.image->topic.empty() ? "" : Concat(" of ", input.image->topic);
    outputs_->Report({reason, Concat("keyframe ", FormatStamp(input.stamp_ns), topic, ": ", text), true});
  });
}

void MapperWorker::MakeMapper() {
  try {
    DepthEngineBackend backend = MakeDepthEngine(node_options_.device, node_options_.cuda_device);
    engine_ = std::move(backend.engine);
    output_engine_ = engine_->Share();
    const bool on_cpu = node_options_.device == Device::kCpu || !backend.fallback_reason.empty();
    const std::string preset = UsedPreset(node_options_, on_cpu);
    if (preset == kAutoPreset) hooks_.on_setting(auto_preset_.emplace(), "");
    if (!on_cpu) WarmUp(engine_.get(), options_->Get().mapper, output_engine_.get(), &stop_);
    DenseMapperOptions options = options_->Get().mapper;
    options.live = IsLive(node_options_);
    mapper_ =
        std::make_unique<DenseMapper>(engine_.get(), options, outputs_->MakeCallbacks(), output_engine_.get(), &stop_);
    UpdateStatus([&](WorkerStatus* status) {
      status->ready = true;
      status->on_cpu = on_cpu;
      status->preset = preset;
      status->device_name = engine_->device_name();
      status->fallback_reason = backend.fallback_reason;
    });
  } catch (const std::exception& error) {
    device_error_ = error.what();
    UpdateStatus([&](WorkerStatus* status) { status->device_error = error.what(); });
  }
}

void MapperWorker::UseOptions() {
  RuntimeOptions options = options_->Get();
  options.mapper.refine_again = options.mapper.refine_again && outputs_->maps() > 0;
  options.mapper.live = IsLive(node_options_);
  mapper_->set_options(options.mapper);
  outputs_->set_min_depth_confidence(options.min_depth_confidence);
}

void MapperWorker::FlushMapper() {
  UseOptions();
  mapper_->Flush();
}

void MapperWorker::Process(const KeyframeInput& input) {
  if (!mapper_) {
    return outputs_->Report({"no_device", Concat("keyframe ", FormatStamp(input.stamp_ns), ": ", device_error_), true});
  }
  Timer timer;
  UseOptions();

  const Capture capture = preparation_.Prepare(input, HowToPrepare());
  const Frame& frame = *capture.keyframes.front();
  const double preparation_ms = timer.Lap();
  UpdateStatus([&](WorkerStatus* status) {
    ++status->keyframes;
    status->width = frame.camera.width;
    status->height = frame.camera.height;
    status->preparation_ms = preparation_ms;
  });
  mapper_->AddCapture(capture);
  const PoseChecks checks = mapper_->pose_checks();
  const double keyframe_ms = preparation_ms + timer.Lap();
  const CameraCalibration& calibration = *input.calibration;
  const CameraErrors errors = checks.camera_errors.value_or(CameraErrors());
  constexpr double kPlace = 0.7;  // of the way from the middle to the corner
  const std::string distortion =
      DescribeDistortion(DistortionShift(frame.camera, errors, kPlace), frame.camera.width, calibration.distortion);
  std::string camera_errors;
  const bool is_face = capture.keyframes.size() > 1;  // whose errors are not those of the lens
  if (distortion.empty() && checks.has_camera_errors && !is_face &&
      CanHaveRadialDistortion(calibration.distortion.model)) {
    camera_errors = DescribeCameraErrors(errors, calibration);
  }
  bool is_new_offset = false, is_new_distortion = false, are_new_errors = false;
  UpdateStatus([&](WorkerStatus* status) {
    is_new_distortion = !distortion.empty() && status->distortion.empty();
    status->distortion = distortion;
    are_new_errors = !camera_errors.empty() && status->camera_errors.empty();
    status->camera_errors = camera_errors;
    is_new_offset = checks.stamp_offset_s && !status->pose_checks.stamp_offset_s;
    status->pose_checks = checks;
    status->left_out = mapper_->left_out();
    scene_depth_ = mapper_->scene_depth();
    status->keyframe_ms = keyframe_ms;
  });
  if (is_new_offset) outputs_->Report({"stamp_offset", DescribeStampOffset(*checks.stamp_offset_s)});
  if (is_new_distortion) outputs_->Report({"distortion", distortion});
  if (are_new_errors) outputs_->Report({"camera_errors", camera_errors});
  if (auto_preset_ && !stop_.requested()) ChooseSetting(keyframe_ms);
}

void MapperWorker::ChooseSetting(double keyframe_ms) {
  std::optional<double> interval_s;
  {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    interval_s = MeanInterval(newest_stamps_ns_);
  }
  const double size = auto_preset_->setting().size;
  const std::optional<std::string> chosen = auto_preset_->Add(keyframe_ms, interval_s);
  if (!chosen) return;
  if (auto_preset_->setting().size != size) {  // images of different sizes do not match well
    FlushMapper();
    mapper_->Reset();
  }
  UpdateStatus([&](WorkerStatus* status) { status->auto_preset = *chosen; });
  hooks_.on_setting(*auto_preset_, *chosen);
}

void MapperWorker::ProcessOvertaken(const KeyframeInput& input) {
  if (mapper_) {
    UseOptions();
    mapper_->AddCapture({{}, preparation_.PrepareSource(input, HowToPrepare())});
  }
  outputs_->Report(
      {"overload",
       Concat("keyframe ", FormatStamp(input.stamp_ns),
              " gets no maps, since the mapper is busy (~overload); others are matched against it", kWhenBusy),
       true});
}

}  // namespace acmp
