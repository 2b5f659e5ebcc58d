#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "acmp_mapping/pipeline/presets.h"
#include "plan.h"
#include "run.h"
#include "stages.h"
#include "task_graph.h"
#include "work_files.h"

namespace acmp {
namespace {

using Json = nlohmann::ordered_json;

std::filesystem::path PlanFile(const std::filesystem::path& output) {
  return OutputFolder::WorkFile(output, "plan", 0);
}

/// Below the root relative to it, so that machines may have it at different places.
std::string RelativePath(const std::filesystem::path& path, const std::filesystem::path& root) {
  const std::filesystem::path relative = path.lexically_relative(root);
  return relative.empty() || *relative.begin() == ".." ? path.string() : relative.string();
}

Json ToJson(const PinholeCamera& c) { return {c.width, c.height, c.fx, c.fy, c.cx, c.cy}; }

PinholeCamera CameraOf(const Json& json) {
  return {json.at(0), json.at(1), json.at(2), json.at(3), json.at(4), json.at(5)};
}

Json ToJson(const SceneImage& image, const std::filesystem::path& root) {
  const double* pose = image.cam_from_world.matrix().data();
  const double* placed = image.placed_from_world.matrix().data();
  const ReadoutMotion& readout = image.readout;
  Json json = {{"name", image.name},
               {"path", RelativePath(image.path, root)},
               {"mask", image.mask.string()},
               {"prior_depth", image.prior_depth.string()},
               {"camera", ToJson(image.camera)},
               {"distortion", static_cast<int>(image.distortion.model)},
               {"coefficients", image.distortion.coefficients},
               {"field_of_view", image.field_of_view},
               {"turn", std::vector<double>(readout.turn.begin(), readout.turn.end())},
               {"move", std::vector<double>(readout.move.begin(), readout.move.end())},
               {"pose", std::vector<double>(pose, pose + 16)},
               {"placed", std::vector<double>(placed, placed + 16)}};
  if (!image.face) return json;
  const double* rotation = image.face->lens_from_face.data();
  json["face"] = {{"file_camera", ToJson(image.face->file_camera)},
                  {"rotation", std::vector<double>(rotation, rotation + 9)}};
  return json;
}

SceneImage ImageOf(const Json& json, const std::filesystem::path& root) {
  SceneImage image;
  image.name = json.at("name").get<std::string>();
  image.path = root / json.at("path").get<std::string>();
  image.mask = json.at("mask").get<std::string>();
  image.prior_depth = json.at("prior_depth").get<std::string>();
  image.camera = CameraOf(json.at("camera"));
  image.distortion.model = static_cast<LensDistortion::Model>(json.at("distortion").get<int>());
  image.distortion.coefficients = json.at("coefficients").get<std::vector<double>>();
  image.field_of_view = json.at("field_of_view");
  if (json.contains("face")) {
    const Json& face = json.at("face");
    image.face.emplace().file_camera = CameraOf(face.at("file_camera"));
    const std::vector<double> rotation = face.at("rotation").get<std::vector<double>>();
    std::copy_n(rotation.begin(), 9, image.face->lens_from_face.data());
  }
  image.readout.turn = Eigen::Vector3d(json.at("turn").at(0), json.at("turn").at(1), json.at("turn").at(2));
  image.readout.move = Eigen::Vector3d(json.at("move").at(0), json.at("move").at(1), json.at("move").at(2));
  const std::vector<double> pose = json.at("pose").get<std::vector<double>>();
  std::copy_n(pose.begin(), 16, image.cam_from_world.matrix().data());
  const std::vector<double> placed = json.at("placed").get<std::vector<double>>();
  std::copy_n(placed.begin(), 16, image.placed_from_world.matrix().data());
  return image;
}

/// The content of the plan's file.
/// @param files HashOfFiles of each image of the plan
std::string FormatPlan(const Scene& scene, const ReconstructPlan& plan, const std::vector<uint64_t>& files,
                       const std::filesystem::path& root) {
  Json json = {{"origin", {plan.origin.x(), plan.origin.y(), plan.origin.z()}}, {"images", Json::array()}};
  for (size_t i = 0; i < plan.images.size(); ++i) {
    const ImagePlan& planned = plan.images[i];
    Json view = ToJson(scene.images[static_cast<size_t>(planned.index)], root);
    view.update({{"index", planned.index},
                 {"range", {planned.range.min, planned.range.max}},
                 {"sources", planned.sources},
                 {"no_map", planned.no_map},
                 {"files", files[i]}});
    json["images"].push_back(std::move(view));
  }
  return json.dump();
}

/// The tasks in the order in which one process would do what is ready: late stages first, so that chunks are finished
/// early.
Json ListOfTasks(const std::map<int, Chunk>& chunks, const ReconstructOptions& options) {
  using Task = std::pair<int, int>;  // -place of the stage among StagesOfChunk, chunk
  const std::vector<std::string> stages = StagesOfChunk(options);
  const int steps = static_cast<int>(std::find(stages.begin(), stages.end(), "final") - stages.begin()) + 1;
  std::map<Task, std::vector<Task>> after;
  for (const auto& [number, chunk] : chunks) {
    std::set<int> reads, fused_before;  // chunks
    for (int index : chunk.reads) reads.insert(index / options.chunk_images);
    for (const auto& [view, before] : chunk.fused_before) fused_before.insert(before);
    for (int stage = 0; stage < static_cast<int>(stages.size()); ++stage) {
      std::vector<Task>& waits_for = after[{-stage, number}];
      for (int read : stage > 0 ? reads : std::set<int>()) waits_for.emplace_back(1 - std::min(stage, steps), read);
      if (stages[static_cast<size_t>(stage)] != kFuseStage) continue;
      for (int before : fused_before) waits_for.emplace_back(-stage, before);
    }
  }
  Json list = Json::array();
  std::map<Task, int> numbers;
  std::vector<int> before_finish;
  for (const Task& task : InOrder(after)) {
    const std::string& stage = stages[static_cast<size_t>(-task.first)];
    const int number = numbers[task] = static_cast<int>(list.size());
    if (stage == kMapsStage || stage == kFuseStage) before_finish.push_back(number);
    Json others = Json::array();
    for (const Task& other : after.at(task)) others.push_back(numbers.at(other));
    const std::vector<const ImagePlan*>& images = chunks.at(task.second).images;
    list.push_back(
        {{"stage", stage}, {"images", Concat(images.front()->index, "-", images.back()->index)}, {"after", others}});
  }
  list.push_back({{"stage", kFinishStage}, {"images", ""}, {"after", before_finish}});
  return list;
}

/// Whether a finished run with these settings and this input is there.
bool IsComplete(const ReconstructOptions& options, const RunRecord& record) {
  if (options.overwrite || !OutputFolder::Exists(options.output)) return false;
  const OutputFolder folder(options.output, record, false, OutputFolder::Use::kStages);
  return folder.state() == OutputFolder::State::kComplete && folder.Setting(kChunkImagesKey) == "(none)";
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

void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options,
                const StopRequest& interrupt, FrameStore* frames, Progress* progress, std::ostream* out) {
  ReportImagesWithoutMap(plan, scene, progress);
  const std::vector<uint64_t> files = HashFiles(scene, plan.Indices(), interrupt, [&](int index) {
    if (!plan.HasMap(index)) frames->Get(index);
  });
  RunRecord record = MakeRecord(options, "", InputHash(scene, plan.Indices(), files));
  const bool complete = IsComplete(options, record);
  Json tasks = Json::array();
  if (!complete) {
    record.emplace_back(kChunkImagesKey, Concat(options.chunk_images));
    const OutputFolder folder(options.output, record, options.overwrite, OutputFolder::Use::kStages);
    const std::string content = FormatPlan(scene, plan, files, options.scene);
    if (ReadWorkFile(PlanFile(options.output)) != content) WriteWorkFile(PlanFile(options.output), content);
    tasks = ListOfTasks(CutIntoChunks(plan, options.chunk_images), options);
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

PlannedScene::PlannedScene(const ReconstructOptions& options)
    : frames(scene, MakeFrameOptions(options), options.MemoryBytes(options.kImageShare)) {
  const std::optional<std::string> content = ReadWorkFile(PlanFile(options.output));
  if (!content) throw InvalidInputError(Concat(options.output.string(), ": has no plan: give --plan first"));
  const Json json = Json::parse(*content);
  const std::vector<double> origin = json.at("origin").get<std::vector<double>>();
  std::copy_n(origin.begin(), 3, plan.origin.data());
  for (const Json& view : json.at("images")) {
    const Json& range = view.at("range");
    plan.images.push_back({view.at("index").get<int>(),
                           {range.at(0).get<float>(), range.at(1).get<float>()},
                           view.at("sources").get<std::vector<int>>(),
                           view.at("no_map").get<std::string>()});
    const int index = plan.images.back().index;
    scene.images.resize(static_cast<size_t>(index) + 1);
    scene.images.back() = ImageOf(view, options.scene);
    files[index] = view.at("files").get<uint64_t>();
  }
  chunks = CutIntoChunks(plan, options.chunk_images);
}

}  // namespace acmp
