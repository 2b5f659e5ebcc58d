#include "engine_store.h"

#include <tbb/parallel_for.h>

#include <limits>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr size_t kUnlimited = std::numeric_limits<size_t>::max();

// What the caches count. On a GPU: texels of two bytes with their halved images; planes, cost, depth and half a byte of
// halved depth. On the host: nothing but halved images beside the frame; the same with normals. A mask: a byte, and
// those of its halved images.
size_t ImageBytes(const Frame& frame, bool on_host) {
  return frame.gray.size() * (on_host ? 2 : 3) + frame.mask.size() * 3 / 2;
}
size_t EstimateBytes(const Frame& frame, bool on_host) { return frame.gray.size() * (on_host ? 72 : 49) / 2; }

}  // namespace

EngineStore::EngineStore(FrameStore* frames, const ReconstructOptions& options, const std::filesystem::path& output,
                         const ReconstructPlan& plan, const Devices& devices)
    : output_(output),
      plan_(plan),
      levels_(MakePipelineOptions(options).start_level),
      steps_(ScheduleOf(MakePipelineOptions(options))),
      final_step_(static_cast<int>(steps_.size()) - 1),
      frames_(*frames),
      keeps_files_(options.keep_work || options.stages),
      always_writes_(!output.empty() && (keeps_files_ || devices.on_host())),
      finals_are_maps_(options.online()) {
  for (int device = 0; device < devices.size(); ++device) {
    const size_t bytes = devices.on_host() ? options.MemoryBytes(options.kMapShare) : devices.FreeBytes(device) / 2;
    const size_t own = devices.on_host() ? 0 : bytes / 2;
    devices_.emplace_back(bytes / 4, bytes - bytes / 4 - own, devices.on_host() ? kUnlimited : own);
  }
}

std::string EngineStore::StepName(int step, int final_step) {
  return step == final_step ? "final" : Concat("step_", step);
}

EngineProblem EngineStore::Problem(const ImagePlan& image, int step, const DeviceEngine& engine) {
  EngineProblem problem;
  problem.depth_range = image.range;
  problem.sources.resize(image.sources.size());
  tbb::parallel_for(size_t{0}, image.sources.size() + 1, [&](size_t i) {
    if (i == 0) {
      problem.reference.frame = frames_.Get(image.index);
    } else {
      problem.sources[i - 1].frame = frames_.Get(image.sources[i - 1]);
    }
  });
  // A cancelled loop leaves gaps; the caller finds out before it keeps anything.
  if (!problem.reference.frame) throw Interrupted();
  problem.reference.image = Image(problem.reference.frame, engine);
  for (EngineView& source : problem.sources) {
    if (!source.frame) throw Interrupted();
    source.image = Image(source.frame, engine);
  }
  if (step < 0) return problem;
  problem.reference.estimate = Estimate({step, image.index}, *problem.reference.frame, engine);
  for (EngineView& source : problem.sources) {
    const int index = static_cast<int>(source.frame->id);
    if (plan_.HasMap(index)) source.estimate = Estimate({step, index}, *source.frame, engine);
  }
  return problem;
}

EngineImagePtr EngineStore::Image(const FramePtr& frame, const DeviceEngine& engine) {
  Device& device = devices_.at(engine.device);
  return device.images.Get(
      static_cast<int>(frame->id), [&] { return engine.engine->Load(frame, levels_); },
      [&](const EngineImage&) { return std::max(ImageBytes(*frame, engine.on_host), device.least_image_bytes); });
}

EngineEstimatePtr EngineStore::Estimate(const Key& key, const Frame& frame, const DeviceEngine& engine) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = on_device_.find(key);
    if (found != on_device_.end() && found->second.device == engine.device) return found->second.estimate;
  }
  return devices_.at(engine.device)
      .estimates.Get(
          key, [&] { return Read(key, frame, engine); },
          [&](const EngineEstimate&) { return EstimateBytes(frame, engine.on_host); });
}

EngineEstimatePtr EngineStore::Read(const Key& key, const Frame& frame, const DeviceEngine& engine) const {
  EngineEstimatePtr elsewhere;
  std::shared_ptr<const EstimateState> in_memory;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = on_device_.find(key); found != on_device_.end()) elsewhere = found->second.estimate;
    if (const auto found = in_memory_.find(key); found != in_memory_.end()) in_memory = found->second;
  }
  if (elsewhere) return engine.engine->Import(elsewhere);
  if (key.first == final_step_ && finals_are_maps_) {
    const FinalMaps maps = ReadFinalMaps(FileOf(key));
    return engine.engine->UploadMaps({maps.depth.View(), maps.normal.View(), maps.cost.View()}, frame.camera);
  }
  const PinholeCamera camera = CameraAtLevel(frame.camera, steps_[static_cast<size_t>(key.first)].level);
  return engine.engine->UploadState(in_memory ? in_memory->Clone() : ReadEstimate(FileOf(key)), camera);
}

void EngineStore::Keep(int step, const Frame& frame, const DeviceEngine& engine, const EngineEstimatePtr& estimate) {
  const Key key = {step, static_cast<int>(frame.id)};
  const size_t bytes = EstimateBytes(frame, engine.on_host);
  if (!always_writes_ && KeepOnDevice(key, {estimate, engine.device, bytes})) return;
  EstimateState state = engine.engine->DownloadState(estimate);
  if (output_.empty()) {
    const std::lock_guard<std::mutex> lock(mutex_);
    in_memory_[key] = std::make_shared<const EstimateState>(std::move(state));
  } else {
    WriteEstimate(FileOf(key), state);
  }
  devices_.at(engine.device)
      .estimates.Get(
          key, [&] { return estimate; }, [&](const EngineEstimate&) { return bytes; });
}

bool EngineStore::KeepOnDevice(const Key& key, const OnDevice& kept) {
  const std::lock_guard<std::mutex> lock(mutex_);
  Device& device = devices_.at(kept.device);
  const size_t final_bytes = device.own_final_bytes + (key.first == final_step_ ? kept.bytes : 0);
  if (device.own_bytes + kept.bytes > device.max_own_bytes || final_bytes > device.max_own_bytes / 2) return false;
  on_device_[key] = kept;
  device.own_bytes += kept.bytes;
  device.own_final_bytes = final_bytes;
  return true;
}

void EngineStore::AddReader(const ImagePlan& image, int step) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (int index : plan_.ImagesRead(image)) ++readers_left_[{step, index}];
}

void EngineStore::HasRead(const ImagePlan& image, int step) {
  for (int index : plan_.ImagesRead(image)) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (--readers_left_.at({step, index}) > 0) continue;
    }
    Forget({step, index});
  }
}

void EngineStore::Forget(const Key& key) {
  for (Device& device : devices_) device.estimates.Drop(key);
  std::error_code ignored;  // what is left goes with the work folder
  if (!output_.empty() && !keeps_files_ && key.first != final_step_) std::filesystem::remove(FileOf(key), ignored);
  const std::lock_guard<std::mutex> lock(mutex_);
  in_memory_.erase(key);
  const auto found = on_device_.find(key);
  if (found == on_device_.end()) return;
  Device& device = devices_.at(found->second.device);
  device.own_bytes -= found->second.bytes;
  if (key.first == final_step_) device.own_final_bytes -= found->second.bytes;
  on_device_.erase(found);
}

}  // namespace acmp
