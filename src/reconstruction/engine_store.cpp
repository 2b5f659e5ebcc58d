#include "reconstruct_store.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

namespace acmp {
namespace {

// What the caches count. On a GPU: texels of two bytes with their halved images; planes, cost, depth and half a byte of
// halved depth. On the host: nothing but halved images beside the frame; the same with normals.
size_t ImageBytes(const Frame& frame, bool on_host) { return frame.gray.size() * (on_host ? 2 : 3); }
size_t EstimateBytes(const Frame& frame, bool on_host) { return frame.gray.size() * (on_host ? 72 : 49) / 2; }

size_t HostBytes(const FinalMaps& maps) {
  return maps.depth.size() * (sizeof(float) + sizeof(Vec3f) + sizeof(float)) + maps.color.size() * sizeof(Rgb);
}

}  // namespace

EngineStore::EngineStore(FrameStore* frames, const ReconstructOptions& options, const ReconstructFolder& folder,
                         const ReconstructPlan& plan, const std::vector<ReconstructEngine>& engines)
    : folder_(folder),
      plan_(plan),
      levels_(MakePipelineOptions(options).start_level),
      frames_(*frames),
      always_writes_(options.keep_work || engines.front().on_host),
      final_maps_on_host_(!options.maps.empty() || options.colmap),
      max_unsaved_host_bytes_(options.MemoryBytes(options.kMapShare)) {
  for (const ReconstructEngine& engine : engines) {
    const size_t bytes = engine.on_host ? max_unsaved_host_bytes_ : engine.engine->FreeDeviceBytes() / 2;
    const size_t unsaved = engine.on_host ? 0 : bytes / 2;
    devices_.emplace(std::piecewise_construct, std::forward_as_tuple(engine.device),
                     std::forward_as_tuple(bytes / 4, bytes - bytes / 4 - unsaved, unsaved));
  }
}

bool EngineStore::HasMap(int index) const {
  return std::any_of(plan_.images.begin(), plan_.images.end(),
                     [&](const ImagePlan& image) { return image.index == index && image.no_map.empty(); });
}

EngineProblem EngineStore::Problem(const ImagePlan& image, const ReconstructEngine& engine) {
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

EngineView EngineStore::View(int index, const ReconstructEngine& engine) {
  const FramePtr frame = frames_.Get(index);
  return {frame, Image(frame, engine), nullptr};
}

EngineImagePtr EngineStore::Image(const FramePtr& frame, const ReconstructEngine& engine) {
  return devices_.at(engine.device)
      .images.Get(
          static_cast<int>(frame->id), [&] { return engine.engine->Load(frame, levels_); },
          [&](const EngineImage&) { return ImageBytes(*frame, engine.on_host); });
}

EngineEstimatePtr EngineStore::Read(const EstimateKey& key, const Frame& frame, const ReconstructEngine& engine) const {
  const auto& [stage, index] = key;
  EngineEstimatePtr elsewhere;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = unsaved_.find(key); found != unsaved_.end()) elsewhere = found->second.estimate;
  }
  if (elsewhere) return engine.engine->Import(elsewhere);
  if (stage == kFinalStage) {
    const StoredFinalMaps maps = Final(index);
    return engine.engine->UploadMaps({maps.depth(), maps.normal(), maps.cost()}, frame.camera);
  }
  const auto path = folder_.WorkFile(stage, index);
  return engine.engine->UploadState(ReadEstimate(path, frame.camera.width, frame.camera.height), frame.camera);
}

EngineEstimatePtr EngineStore::Estimate(const std::string& stage, const Frame& frame, const ReconstructEngine& engine) {
  const EstimateKey key = {stage, static_cast<int>(frame.id)};
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

void EngineStore::AddEstimates(const std::string& stage, const ReconstructEngine& engine,
                               std::vector<EngineView>* sources) {
  for (EngineView& source : *sources) {
    if (HasMap(static_cast<int>(source.frame->id))) source.estimate = Estimate(stage, *source.frame, engine);
  }
}

void EngineStore::Keep(const std::string& stage, const Frame& frame, const ReconstructEngine& engine,
                       const EngineEstimatePtr& estimate) {
  const EstimateKey key = {stage, static_cast<int>(frame.id)};
  const size_t bytes = EstimateBytes(frame, engine.on_host);
  if (KeepUnsaved(key, {estimate, engine.device, bytes}, 0)) return;
  WriteEstimate(folder_.WorkFile(stage, key.second), engine.engine->DownloadState(estimate));
  devices_.at(engine.device)
      .estimates.Get(
          key, [&] { return estimate; }, [&](const EngineEstimate&) { return bytes; });
}

bool EngineStore::KeepUnsaved(const EstimateKey& key, const Unsaved& unsaved, size_t host_bytes) {
  if (always_writes_) return false;
  const std::lock_guard<std::mutex> lock(mutex_);
  Device& device = devices_.at(unsaved.device);
  const bool is_final = key.first == kFinalStage;
  const size_t final_bytes = device.unsaved_final_bytes + (is_final ? unsaved.bytes : 0);
  if (device.unsaved_bytes + unsaved.bytes > device.max_unsaved_bytes || final_bytes > device.max_unsaved_bytes / 2 ||
      unsaved_host_bytes_ + host_bytes > max_unsaved_host_bytes_) {
    return false;
  }
  unsaved_[key] = unsaved;
  device.unsaved_bytes += unsaved.bytes;
  device.unsaved_final_bytes = final_bytes;
  unsaved_host_bytes_ += host_bytes;
  return true;
}

void EngineStore::FetchFinal(const Frame& frame, const ReconstructEngine& engine, const EngineEstimatePtr& estimate,
                             FinalMaps* maps) {
  EstimateMaps estimate_maps = engine.engine->Download(estimate);
  maps->depth = std::move(estimate_maps.depth);
  maps->normal = std::move(estimate_maps.normal);
  maps->cost = std::move(estimate_maps.cost);
  maps->color = frame.color.Clone();
}

void EngineStore::KeepFinal(const Frame& frame, const std::vector<int>& sources, const ReconstructEngine& engine,
                            const EngineEstimatePtr& estimate) {
  auto maps = std::make_shared<FinalMaps>();
  maps->sources = sources;
  if (final_maps_on_host_) FetchFinal(frame, engine, estimate, maps.get());
  const EstimateKey key = {kFinalStage, static_cast<int>(frame.id)};
  const size_t bytes = EstimateBytes(frame, engine.on_host);
  if (KeepUnsaved(key, {estimate, engine.device, bytes}, HostBytes(*maps))) {
    const std::lock_guard<std::mutex> lock(mutex_);
    unsaved_final_[key.second] = std::move(maps);
    return;
  }
  if (!final_maps_on_host_) FetchFinal(frame, engine, estimate, maps.get());
  WriteFinalMaps(folder_.WorkFile(kFinalStage, key.second), *maps);
  devices_.at(engine.device)
      .estimates.Get(
          key, [&] { return estimate; }, [&](const EngineEstimate&) { return bytes; });
}

StoredFinalMaps EngineStore::Final(int index) const {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = unsaved_final_.find(index); found != unsaved_final_.end()) {
      return StoredFinalMaps(found->second);
    }
  }
  return StoredFinalMaps(folder_.WorkFile(kFinalStage, index));
}

void EngineStore::ReleaseFinal(int index) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = unsaved_final_.find(index);
  if (found == unsaved_final_.end()) return;
  unsaved_host_bytes_ -= HostBytes(*found->second);
  auto only_sources = std::make_shared<FinalMaps>();
  only_sources->sources = found->second->sources;
  found->second = std::move(only_sources);
}

void EngineStore::Forget(const std::string& stage, int index) {
  const EstimateKey key = {stage, index};
  for (auto& [number, device] : devices_) device.estimates.Drop(key);
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = unsaved_.find(key);
  if (found == unsaved_.end()) return;
  Device& device = devices_.at(found->second.device);
  device.unsaved_bytes -= found->second.bytes;
  if (stage == kFinalStage) device.unsaved_final_bytes -= found->second.bytes;
  unsaved_.erase(found);
}

}  // namespace acmp
