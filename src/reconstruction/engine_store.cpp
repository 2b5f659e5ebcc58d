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

size_t HostBytes(const FinalMaps& maps) { return maps.depth.size() * (sizeof(float) + sizeof(Vec3f) + sizeof(float)); }

std::shared_ptr<const FinalMaps> FetchFinal(const DeviceEngine& engine, const EngineEstimatePtr& estimate) {
  EstimateMaps maps = engine.engine->Download(estimate);
  return std::make_shared<const FinalMaps>(
      FinalMaps{std::move(maps.depth), std::move(maps.normal), std::move(maps.cost), {}});
}

}  // namespace

EngineStore::EngineStore(FrameStore* frames, const ReconstructOptions& options, const std::filesystem::path& output,
                         Results results, const ReconstructPlan& plan, const Devices& devices,
                         const std::vector<KeyframeStep>& steps)
    : output_(output),
      plan_(plan),
      levels_(MakePipelineOptions(options).start_level),
      steps_(steps),
      final_step_(static_cast<int>(steps.size()) - 1),
      frames_(*frames),
      always_writes_(results == Results::kFiles && (options.keep_work || devices.on_host())),
      removes_files_(results == Results::kMemory || (devices.on_host() && !options.keep_work)),
      writes_maps_(results == Results::kMemory || !options.maps.empty() || options.colmap),
      max_unsaved_map_bytes_(results == Results::kMemory ? kUnlimited : options.MemoryBytes(options.kMapShare)) {
  for (int device = 0; device < devices.size(); ++device) {
    const size_t bytes = devices.on_host() ? options.MemoryBytes(options.kMapShare) : devices.FreeBytes(device) / 2;
    const size_t unsaved = devices.on_host() ? 0 : bytes / 2;
    devices_.emplace_back(bytes / 4, bytes - bytes / 4 - unsaved, devices.on_host() ? kUnlimited : unsaved);
  }
}

std::string EngineStore::StepName(int step, int final_step) {
  return step == final_step ? "final" : Concat("step_", step);
}

EngineProblem EngineStore::Problem(const ImagePlan& image, const DeviceEngine& engine) {
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
  return problem;
}

EngineProblem EngineStore::Problem(const ImagePlan& image, int step, const DeviceEngine& engine) {
  EngineProblem problem = Problem(image, engine);
  problem.reference.estimate = Estimate({step, image.index}, *problem.reference.frame, engine);
  for (EngineView& source : problem.sources) {
    const int index = static_cast<int>(source.frame->id);
    if (plan_.HasMap(index)) source.estimate = Estimate({step, index}, *source.frame, engine);
  }
  return problem;
}

EngineImagePtr EngineStore::Image(const FramePtr& frame, const DeviceEngine& engine) {
  return devices_.at(engine.device)
      .images.Get(
          static_cast<int>(frame->id), [&] { return engine.engine->Load(frame, levels_); },
          [&](const EngineImage&) { return ImageBytes(*frame, engine.on_host); });
}

EngineEstimatePtr EngineStore::Estimate(const Key& key, const Frame& frame, const DeviceEngine& engine) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = unsaved_.find(key);
    if (found != unsaved_.end() && found->second.device == engine.device) return found->second.estimate;
  }
  return devices_.at(engine.device)
      .estimates.Get(
          key, [&] { return Read(key, frame, engine); },
          [&](const EngineEstimate&) { return EstimateBytes(frame, engine.on_host); });
}

EngineEstimatePtr EngineStore::Read(const Key& key, const Frame& frame, const DeviceEngine& engine) const {
  EngineEstimatePtr elsewhere;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = unsaved_.find(key); found != unsaved_.end()) elsewhere = found->second.estimate;
  }
  if (elsewhere) return engine.engine->Import(elsewhere);
  if (key.first == final_step_) {
    const std::shared_ptr<const FinalMaps> maps = Final(key.second);
    return engine.engine->UploadMaps({maps->depth.View(), maps->normal.View(), maps->cost.View()}, frame.camera);
  }
  const PinholeCamera camera = CameraAtLevel(frame.camera, steps_[static_cast<size_t>(key.first)].level);
  return engine.engine->UploadState(ReadEstimate(FileOf(key)), camera);
}

void EngineStore::Keep(int step, const Frame& frame, const DeviceEngine& engine, const EngineEstimatePtr& estimate) {
  const Key key = {step, static_cast<int>(frame.id)};
  const bool is_final = step == final_step_;
  const size_t bytes = EstimateBytes(frame, engine.on_host);
  std::shared_ptr<const FinalMaps> maps;
  if (is_final && writes_maps_) maps = FetchFinal(engine, estimate);
  if (KeepUnsaved(key, {estimate, engine.device, bytes}, maps)) return;
  if (is_final) {
    WriteFinalMaps(FileOf(key), maps ? *maps : *FetchFinal(engine, estimate));
  } else {
    WriteEstimate(FileOf(key), engine.engine->DownloadState(estimate));
  }
  devices_.at(engine.device)
      .estimates.Get(
          key, [&] { return estimate; }, [&](const EngineEstimate&) { return bytes; });
}

bool EngineStore::KeepUnsaved(const Key& key, const Unsaved& unsaved, std::shared_ptr<const FinalMaps> maps) {
  if (always_writes_) return false;
  const std::lock_guard<std::mutex> lock(mutex_);
  Device& device = devices_.at(unsaved.device);
  const size_t final_bytes = device.unsaved_final_bytes + (key.first == final_step_ ? unsaved.bytes : 0);
  const size_t map_bytes = unsaved_map_bytes_ + (maps ? HostBytes(*maps) : 0);
  if (device.unsaved_bytes + unsaved.bytes > device.max_unsaved_bytes || final_bytes > device.max_unsaved_bytes / 2 ||
      map_bytes > max_unsaved_map_bytes_) {
    return false;
  }
  unsaved_[key] = unsaved;
  device.unsaved_bytes += unsaved.bytes;
  device.unsaved_final_bytes = final_bytes;
  unsaved_map_bytes_ = map_bytes;
  if (maps) unsaved_maps_[key.second] = std::move(maps);
  return true;
}

std::vector<EngineStore::Key> EngineStore::Estimates(const ImagePlan& image, int step) const {
  std::vector<Key> keys = {{step, image.index}};
  for (int source : image.sources) {
    if (plan_.HasMap(source)) keys.emplace_back(step, source);
  }
  return keys;
}

void EngineStore::AddReaders(const ImagePlan& image, int step, int count) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const Key& key : Estimates(image, step)) readers_left_[key] += count;
}

void EngineStore::HasRead(const ImagePlan& image, int step) {
  for (const Key& key : Estimates(image, step)) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (--readers_left_.at(key) > 0) continue;
    }
    Forget(key);
  }
}

void EngineStore::Forget(const Key& key) {
  for (Device& device : devices_) device.estimates.Drop(key);
  std::error_code ignored;  // what is left goes with the work folder
  if (removes_files_ && key.first != final_step_) std::filesystem::remove(FileOf(key), ignored);
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = unsaved_.find(key);
  if (found == unsaved_.end()) return;
  Device& device = devices_.at(found->second.device);
  device.unsaved_bytes -= found->second.bytes;
  if (key.first == final_step_) device.unsaved_final_bytes -= found->second.bytes;
  unsaved_.erase(found);
}

std::shared_ptr<const FinalMaps> EngineStore::Final(int index) const {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = unsaved_maps_.find(index); found != unsaved_maps_.end()) return found->second;
  }
  return std::make_shared<const FinalMaps>(ReadFinalMaps(FileOf({final_step_, index})));
}

void EngineStore::ReleaseFinal(int index) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = unsaved_maps_.find(index);
  if (found == unsaved_maps_.end()) return;
  unsaved_map_bytes_ -= HostBytes(*found->second);
  unsaved_maps_.erase(found);
}

}  // namespace acmp
