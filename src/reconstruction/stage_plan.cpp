#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/pipeline/schedule.h"
#include "input_hash.h"
#include "run_record.h"
#include "stages.h"
#include "work_files.h"

namespace acmp {
namespace {

using Json = nlohmann::ordered_json;

struct Chunk {
  std::vector<const ImagePlan*> images;
  std::set<int> reads;              ///< images whose estimates its own ones' refinements and points are made of
  std::map<int, int> fused_before;  ///< PlannedScene::FusedBefore
};

std::map<int, Chunk> CutIntoChunks(const ReconstructPlan& plan, int chunk_images) {
  std::map<int, Chunk> chunks;
  for (const ImagePlan& image : plan.images) {
    Chunk& chunk = chunks[image.index / chunk_images];
    chunk.images.push_back(&image);
    if (!image.no_map.empty()) continue;
    for (int read : plan.ImagesRead(image)) chunk.reads.insert(read);
  }
  std::map<int, int> last_chunk;  // whose points use pixels of a view, by scene index
  for (auto& [number, chunk] : chunks) {
    for (int index : chunk.reads) {
      if (const auto last = last_chunk.find(index); last != last_chunk.end()) chunk.fused_before.insert(*last);
      last_chunk[index] = number;
    }
  }
  return chunks;
}

std::filesystem::path ChunkFile(const std::filesystem::path& output, int chunk) {
  return OutputFolder::WorkFile(output, "plan", chunk);
}

/// Without it there is no plan: it is written last.
std::filesystem::path ChunkList(const std::filesystem::path& output) {
  return ChunkFile(output, 0).parent_path() / "chunks.bin";
}

/// Below the root relative to it, so that machines may have it at different places.
std::string RelativePath(const std::filesystem::path& path, const std::filesystem::path& root) {
  const std::filesystem::path relative = path.lexically_relative(root);
  return relative.empty() || *relative.begin() == ".." ? path.string() : relative.string();
}

Json ToJson(const SceneImage& image, const std::filesystem::path& root) {
  const PinholeCamera& c = image.camera;
  const double* pose = image.cam_from_world.matrix().data();
  return {{"name", image.name},
          {"path", RelativePath(image.path, root)},
          {"mask", image.mask.string()},
          {"prior_depth", image.prior_depth.string()},
          {"camera", {c.fx, c.fy, c.cx, c.cy}},
          {"size", {c.width, c.height}},
          {"distortion", static_cast<int>(image.distortion.model)},
          {"coefficients", image.distortion.coefficients},
          {"pose", std::vector<double>(pose, pose + 16)}};
}

SceneImage ImageOf(const Json& json, const std::filesystem::path& root) {
  SceneImage image;
  image.name = json.at("name").get<std::string>();
  image.path = root / json.at("path").get<std::string>();
  image.mask = json.at("mask").get<std::string>();
  image.prior_depth = json.at("prior_depth").get<std::string>();
  const Json& camera = json.at("camera");
  const Json& size = json.at("size");
  image.camera = {size.at(0), size.at(1), camera.at(0), camera.at(1), camera.at(2), camera.at(3)};
  image.distortion.model = static_cast<LensDistortion::Model>(json.at("distortion").get<int>());
  image.distortion.coefficients = json.at("coefficients").get<std::vector<double>>();
  const std::vector<double> pose = json.at("pose").get<std::vector<double>>();
  std::copy_n(pose.begin(), 16, image.cam_from_world.matrix().data());
  return image;
}

/// The content of a chunk's file.
std::string FormatChunk(const Scene& scene, const std::map<int, const ImagePlan*>& planned, const Chunk& chunk,
                        const Eigen::Vector3d& origin, const std::filesystem::path& root) {
  Json json = {{"images", Json::array()},
               {"views", Json::object()},
               {"origin", {origin.x(), origin.y(), origin.z()}},
               {"fused_before", Json::array()}};
  std::set<int> seen;
  for (const ImagePlan* image : chunk.images) {
    json["images"].push_back(
        {{"index", image->index}, {"range", {image->range.min, image->range.max}}, {"sources", image->sources}});
    seen.insert(image->index);
    seen.insert(image->sources.begin(), image->sources.end());
  }
  for (int index : seen) {
    const SceneImage& image = scene.images[static_cast<size_t>(index)];
    Json& view = json["views"][std::to_string(index)] = ToJson(image, root);
    view["no_map"] = planned.at(index)->no_map;
    view["geometry"] = HashOfGeometry(scene, image);
  }
  for (const auto& [view, before] : chunk.fused_before) json["fused_before"].push_back({view, before});
  return json.dump();
}

/// A stage of a chunk, by the stage's place among StagesOfChunk; in the order in which one process would do what is
/// ready: late stages first, so that chunks are finished early.
struct Task {
  int stage = 0;
  int chunk = 0;
  bool operator<(const Task& other) const { return stage != other.stage ? stage > other.stage : chunk < other.chunk; }
};

/// The tasks of a plan with what each waits for.
std::map<Task, std::vector<Task>> TasksOf(const std::map<int, Chunk>& chunks, const ReconstructOptions& options) {
  const std::vector<std::string> stages = StagesOfChunk(options);
  const int steps = static_cast<int>(std::find(stages.begin(), stages.end(), "final") - stages.begin()) + 1;
  std::map<Task, std::vector<Task>> tasks;
  for (const auto& [number, chunk] : chunks) {
    std::set<int> reads, fused_before;  // chunks
    for (int index : chunk.reads) reads.insert(index / options.chunk_images);
    for (const auto& [view, before] : chunk.fused_before) fused_before.insert(before);
    for (int stage = 0; stage < static_cast<int>(stages.size()); ++stage) {
      std::vector<Task>& after = tasks[{stage, number}];
      for (int read : stage > 0 ? reads : std::set<int>()) after.push_back({std::min(stage, steps) - 1, read});
      if (stages[static_cast<size_t>(stage)] != kFuseStage) continue;
      for (int before : fused_before) after.push_back({stage, before});
    }
  }
  return tasks;
}

Json ListOfTasks(const std::map<int, Chunk>& chunks, const ReconstructOptions& options) {
  const std::vector<std::string> stages = StagesOfChunk(options);
  const std::map<Task, std::vector<Task>> tasks = TasksOf(chunks, options);
  std::map<Task, std::vector<Task>> followers;
  std::map<Task, size_t> waits_for;
  std::set<Task> ready;
  for (const auto& [task, after] : tasks) {
    waits_for[task] = after.size();
    if (after.empty()) ready.insert(task);
    for (const Task& other : after) followers[other].push_back(task);
  }
  Json list = Json::array();
  std::map<Task, int> numbers;
  std::vector<int> before_finish;
  while (!ready.empty()) {
    const Task task = *ready.begin();
    ready.erase(ready.begin());
    const std::string& stage = stages[static_cast<size_t>(task.stage)];
    const int number = numbers[task] = static_cast<int>(list.size());
    if (stage == kMapsStage || stage == kFuseStage) before_finish.push_back(number);
    std::vector<int> after;
    for (const Task& other : tasks.at(task)) after.push_back(numbers.at(other));
    const std::vector<const ImagePlan*>& images = chunks.at(task.chunk).images;
    list.push_back(
        {{"stage", stage}, {"images", Concat(images.front()->index, "-", images.back()->index)}, {"after", after}});
    for (const Task& follower : followers[task]) {
      if (--waits_for[follower] == 0) ready.insert(follower);
    }
  }
  list.push_back({{"stage", kFinishStage}, {"images", ""}, {"after", before_finish}});
  return list;
}

/// Whether a finished run with these settings and this input is there. Reads the images' files.
bool IsComplete(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options) {
  if (options.overwrite || !OutputFolder::Exists(options.output)) return false;
  const OutputFolder folder(options.output, {}, false, OutputFolder::Use::kStages);
  if (folder.state() != OutputFolder::State::kComplete || folder.Setting(kChunkImagesKey) != "(none)") return false;
  for (const auto& [key, value] : SettingsRecord(options)) {
    if (folder.Setting(key) != value) return false;
  }
  std::vector<ImageHashes> hashes;
  for (const ImagePlan& image : plan.images) hashes.push_back(HashesOf(scene, image.index));
  return folder.Setting(kInputKey) == InputHash(hashes);
}

/// Makes the output folder one of this plan.
void WritePlan(const Scene& scene, const ReconstructPlan& plan, const std::map<int, Chunk>& chunks,
               const ReconstructOptions& options) {
  std::map<int, const ImagePlan*> planned;
  for (const ImagePlan& image : plan.images) planned[image.index] = &image;
  std::map<int, std::string> files;
  std::vector<int> numbers;
  Hash hash;
  for (const auto& [number, chunk] : chunks) {
    files[number] = FormatChunk(scene, planned, chunk, plan.origin, options.scene);
    numbers.push_back(number);
    hash.Add(number);
    hash.Add(files[number]);
  }
  RunRecord record = MakeRecord(options, "that of the first stage", Concat("that of plan ", HexDigits(hash.value())));
  record.emplace_back(kChunkImagesKey, Concat(options.chunk_images));
  const OutputFolder folder(options.output, record, options.overwrite, OutputFolder::Use::kStages);
  for (const auto& [number, content] : files) {
    const std::filesystem::path file = ChunkFile(options.output, number);
    if (ReadWorkFile(file) != content) WriteWorkFile(file, content);
  }
  WriteWorkFile(ChunkList(options.output), Json(numbers).dump());
}

}  // namespace

std::vector<std::string> StagesOfChunk(const ReconstructOptions& options) {
  const int final_step = static_cast<int>(ScheduleOf(MakePipelineOptions(options)).size()) - 1;
  std::vector<std::string> stages;
  for (int step = 0; step <= final_step; ++step) stages.push_back(EngineStore::StepName(step, final_step));
  if (!options.maps.empty()) stages.emplace_back(kMapsStage);
  stages.emplace_back(kFuseStage);
  return stages;
}

void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options, Progress* progress,
                std::ostream* out) {
  ReportImagesWithoutMap(plan, scene, progress);
  const bool complete = IsComplete(scene, plan, options);
  Json tasks = Json::array();
  if (!complete) {
    const std::map<int, Chunk> chunks = CutIntoChunks(plan, options.chunk_images);
    WritePlan(scene, plan, chunks, options);
    tasks = ListOfTasks(chunks, options);
  }
  const size_t count = tasks.size();
  WriteFileAtomically(options.plan, Json({{"complete", complete}, {"tasks", std::move(tasks)}}).dump() + "\n");
  if (complete) {
    return ReportComplete(OutputFolder(options.output, {}, false, OutputFolder::Use::kStages),
                          Concat(options.plan.string(), ": ", options.output.string(), " is already complete"),
                          options.quiet, out);
  }
  if (options.quiet) return;
  *out << options.plan.string() << ": " << count << " tasks for " << plan.images.size() << " images in chunks of "
       << options.chunk_images << std::endl;
}

PlannedScene::PlannedScene(const ReconstructOptions& options)
    : output_(options.output),
      scene_root_(options.scene),
      chunk_images_(options.chunk_images),
      frames_(scene_, MakeFrameOptions(options), options.MemoryBytes(options.kImageShare), FrameStore::Changes::kRead) {
}

std::vector<int> PlannedScene::Chunks() const {
  const std::optional<std::string> content = ReadWorkFile(ChunkList(output_));
  if (!content) throw InvalidInputError(Concat(output_.string(), ": has no plan: give --plan first"));
  return Json::parse(*content).get<std::vector<int>>();
}

void PlannedScene::Load(int chunk) {
  if (chunks_.count(chunk) > 0) return;
  const std::optional<std::string> content = ReadWorkFile(ChunkFile(output_, chunk));
  if (!content) {
    throw InvalidInputError(Concat(output_.string(), ": no plan of the images ", chunk * chunk_images_, "-",
                                   (chunk + 1) * chunk_images_ - 1, ": give --plan first"));
  }
  const Json json = Json::parse(*content);
  std::map<int, ImagePlan> images;  // all, by scene index
  for (ImagePlan& image : plan_.images) images[image.index] = std::move(image);
  for (const auto& [number, view] : json.at("views").items()) {
    const int index = std::stoi(number);
    if (static_cast<size_t>(index) >= scene_.images.size()) scene_.images.resize(static_cast<size_t>(index) + 1);
    scene_.images[static_cast<size_t>(index)] = ImageOf(view, scene_root_);
    geometry_[index] = view.at("geometry").get<uint64_t>();
    images.try_emplace(index, ImagePlan{index, {}, {}, view.at("no_map").get<std::string>()});
  }
  for (const Json& image : json.at("images")) {
    ImagePlan& plan = images.at(image.at("index").get<int>());
    plan.range = {image.at("range").at(0).get<float>(), image.at("range").at(1).get<float>()};
    plan.sources = image.at("sources").get<std::vector<int>>();
  }
  const std::vector<double> origin = json.at("origin").get<std::vector<double>>();
  std::copy_n(origin.begin(), 3, plan_.origin.data());
  plan_.images.clear();
  for (auto& [index, image] : images) plan_.images.push_back(std::move(image));
  std::map<int, int>& fused_before = chunks_[chunk];
  for (const Json& pair : json.at("fused_before")) fused_before[pair.at(0).get<int>()] = pair.at(1).get<int>();
}

std::vector<int> PlannedScene::ImagesRead(int index) {
  Load(ChunkOf(index));
  const auto image = std::lower_bound(plan_.images.begin(), plan_.images.end(), index,
                                      [](const ImagePlan& before, int wanted) { return before.index < wanted; });
  return plan_.ImagesRead(*image);
}

std::vector<int> PlannedScene::ImagesOf(int chunk) const {
  std::vector<int> indices;
  for (const ImagePlan& image : plan_.images) {
    if (ChunkOf(image.index) == chunk) indices.push_back(image.index);
  }
  return indices;
}

}  // namespace acmp
