#include "reconstruct_store.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

#include "reconstruct_work_files.h"

namespace acmp {
namespace {

// What the caches count. On a GPU: texels of two bytes with their halved images; planes, cost and depth. On the host:
// nothing but halved images beside the frame; the same with normals.
size_t ImageBytes(const Frame& frame, bool on_host) { return frame.gray.size() * (on_host ? 2 : 3); }
size_t EstimateBytes(const Frame& frame, bool on_host) { return frame.gray.size() * (on_host ? 36 : 24); }

}  // namespace

FrameStore::FrameStore(const Scene& scene, int max_image_size, size_t max_bytes)
    : scene_(scene), max_image_size_(max_image_size), cache_(max_bytes) {}

FramePtr FrameStore::Get(int index) {
  return cache_.Get(
      index, [&] { return std::make_shared<const Frame>(LoadFrame(scene_, index, max_image_size_)); },
      [](const Frame& frame) { return frame.gray.size() * sizeof(float) + frame.color.size() * sizeof(Rgb); });
}

EngineStore::EngineStore(const Scene& scene, const ReconstructOptions& options, const ReconstructFolder& folder,
                         const ReconstructPlan& plan, const std::vector<ReconstructEngine>& engines)
    : folder_(folder),
      plan_(plan),
      levels_(MakePipelineOptions(options).start_level),
      frames_(scene, options.max_image_size, static_cast<size_t>(0.5e9 * options.memory_limit_gb)) {
  for (const ReconstructEngine& engine : engines) {
    const size_t host_bytes = static_cast<size_t>(0.5e9 * options.memory_limit_gb);
    const size_t bytes = engine.on_host ? host_bytes : engine.engine->FreeDeviceBytes() / 2;
    devices_.emplace(std::piecewise_construct, std::forward_as_tuple(engine.device),
                     std::forward_as_tuple(bytes / 4, bytes - bytes / 4));
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

EngineEstimatePtr EngineStore::ReadFromFile(const std::string& stage, const Frame& frame,
                                            const ReconstructEngine& engine) const {
  const auto path = folder_.WorkFile(stage, static_cast<int>(frame.id));
  if (stage != kFinalStage) {
    return engine.engine->UploadState(ReadEstimate(path, frame.camera.width, frame.camera.height), frame.camera);
  }
  const MappedFinalMaps maps(path);
  return engine.engine->UploadMaps({maps.depth(), maps.normal(), maps.cost()}, frame.camera);
}

EngineEstimatePtr EngineStore::Estimate(const std::string& stage, const Frame& frame, const ReconstructEngine& engine) {
  return devices_.at(engine.device)
      .estimates.Get(
          {stage, static_cast<int>(frame.id)}, [&] { return ReadFromFile(stage, frame, engine); },
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
  devices_.at(engine.device)
      .estimates.Get(
          {stage, static_cast<int>(frame.id)}, [&] { return estimate; },
          [&](const EngineEstimate&) { return EstimateBytes(frame, engine.on_host); });
}

}  // namespace acmp
