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

// Values of the plan's file: Put writes one, Take reads it.

template <class T>
Json Put(const T& value) {
  return value;
}
template <class T>
void Take(const Json& json, T* value) {
  *value = json.get<T>();
}
Json Put(const std::filesystem::path& path) { return path.string(); }
void Take(const Json& json, std::filesystem::path* path) { *path = json.get<std::string>(); }
template <int rows, int cols>
Json Put(const Eigen::Matrix<double, rows, cols>& matrix) {
  return std::vector<double>(matrix.data(), matrix.data() + matrix.size());
}
template <int rows, int cols>
void Take(const Json& json, Eigen::Matrix<double, rows, cols>* matrix) {
  const auto numbers = json.get<std::vector<double>>();
  if (numbers.size() != static_cast<size_t>(matrix->size())) throw ProcessingError("the plan's file has another form");
  std::copy(numbers.begin(), numbers.end(), matrix->data());
}
Json Put(const PinholeCamera& c) { return {c.width, c.height, c.fx, c.fy, c.cx, c.cy}; }
void Take(const Json& json, PinholeCamera* camera) {
  *camera = {json.at(0), json.at(1), json.at(2), json.at(3), json.at(4), json.at(5)};
}
Json Put(const std::optional<FaceOfImage>& face) {
  return face ? Json{Put(face->file_camera), Put(face->lens_from_face)} : Json();
}
void Take(const Json& json, std::optional<FaceOfImage>* face) {
  if (json.is_null()) return;
  Take(json.at(0), &face->emplace().file_camera);
  Take(json.at(1), &(*face)->lens_from_face);
}

/// visit(name, value) for all that the plan's file has of an image.
/// @param path relative to the scene's root
/// @param files HashOfFiles
template <class Image, class Plan, class Path, class Hash, class Visit>
void VisitImage(Image* image, Plan* plan, Path* path, Hash* files, const Visit& visit) {
  visit("index", &plan->index);
  visit("near", &plan->range.min);
  visit("far", &plan->range.max);
  visit("sources", &plan->sources);
  visit("no_map", &plan->no_map);
  visit("files", files);
  visit("name", &image->name);
  visit("path", path);
  visit("mask", &image->mask);
  visit("prior_depth", &image->prior_depth);
  visit("camera", &image->camera);
  visit("distortion", &image->distortion.model);
  visit("coefficients", &image->distortion.coefficients);
  visit("field_of_view", &image->field_of_view);
  visit("face", &image->face);
  visit("turn", &image->readout.turn);
  visit("move", &image->readout.move);
  visit("pose", &image->cam_from_world.matrix());
  visit("placed", &image->placed_from_world.matrix());
}

/// The content of the plan's file.
/// @param files HashOfFiles of each image of the plan
std::string FormatPlan(const Scene& scene, const ReconstructPlan& plan, const std::vector<uint64_t>& files,
                       const std::filesystem::path& root) {
  Json json = {{"origin", Put(plan.origin)}, {"images", Json::array()}};
  for (size_t i = 0; i < plan.images.size(); ++i) {
    const SceneImage& image = scene.images[static_cast<size_t>(plan.images[i].index)];
    const std::string path = RelativePath(image.path, root);
    Json view;
    VisitImage(&image, &plan.images[i], &path, &files[i],
               [&](const char* name, const auto* value) { view[name] = Put(*value); });
    json["images"].push_back(std::move(view));
  }
  return json.dump();
}

/// The tasks, stage by stage.
Json ListOfTasks(const ReconstructPlan& plan, const ReconstructOptions& options) {
  struct Chunk {
    int first = 0, last = 0;  // scene indices
    std::set<int> reads;      // chunks whose estimates its own ones are made of
  };
  std::map<int, Chunk> chunks;
  for (const ImagePlan& image : plan.images) {
    Chunk& chunk = chunks.try_emplace(image.index / options.chunk_images, Chunk{image.index, 0, {}}).first->second;
    chunk.last = image.index;
    if (!image.no_map.empty()) continue;
    for (int read : plan.ImagesRead(image)) chunk.reads.insert(read / options.chunk_images);
  }
  Json list = Json::array(), last = Json::array();
  std::map<int, int> before, now;  // numbers of the tasks of a stage, by chunk
  for (const std::string& stage : StagesOfChunk(options)) {
    last = Json::array();
    for (const auto& [number, chunk] : chunks) {
      Json after = Json::array();
      for (int read : before.empty() ? std::set<int>() : chunk.reads) after.push_back(before.at(read));
      now[number] = static_cast<int>(list.size());
      last.push_back(list.size());
      list.push_back({{"stage", stage}, {"images", Concat(chunk.first, "-", chunk.last)}, {"after", after}});
    }
    before = now;
  }
  list.push_back({{"stage", kFinishStage}, {"images", ""}, {"after", last}});
  return list;
}

}  // namespace

std::vector<std::string> StagesOfChunk(const ReconstructOptions& options) {
  const int final_step = static_cast<int>(ScheduleOf(MakePipelineOptions(options)).size()) - 1;
  std::vector<std::string> stages;
  for (int step = 0; step <= final_step; ++step) stages.push_back(EngineStore::StepName(step, final_step));
  if (!options.maps.empty()) stages.emplace_back(kMapsStage);
  return stages;
}

void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options,
                const StopRequest& interrupt, FrameStore* frames, Progress* progress, std::ostream* out) {
  ReportImagesWithoutMap(plan, scene, progress);
  const std::vector<uint64_t> files = HashFiles(scene, plan.Indices(), interrupt, [&](int index) {
    if (!plan.HasMap(index)) frames->Get(index);
  });
  const RunRecord record = MakeRecord(options, "", InputHash(scene, plan.Indices(), files));
  const OutputFolder folder(options.output, record, options.overwrite, OutputFolder::Use::kStages);
  const bool complete = folder.state() == OutputFolder::State::kComplete;
  if (!complete && folder.Setting(kDeviceKey) != "(none)" && !std::filesystem::exists(PlanFile(options.output))) {
    throw InvalidInputError(Concat(options.output.string(),
                                   ": holds an interrupted run of one process: the same command ",
                                   "without --plan goes on, --overwrite starts afresh"));
  }
  const Json tasks = complete ? Json::array() : ListOfTasks(plan, options);
  WriteFileAtomically(options.plan, Json({{"complete", complete}, {"tasks", tasks}}).dump() + "\n");
  if (complete) return ReportComplete(folder, options.plan.string() + ": ", options, out);
  const std::string content = FormatPlan(scene, plan, files, options.scene);
  if (ReadWorkFile(PlanFile(options.output)) != content) WriteWorkFile(PlanFile(options.output), content);
  if (options.quiet) return;
  *out << options.plan.string() << ": " << tasks.size() << " tasks for " << plan.images.size()
       << " images in chunks of " << options.chunk_images << std::endl;
}

PlannedScene::PlannedScene(const ReconstructOptions& options)
    : frames(scene, MakeFrameOptions(options), options.MemoryBytes(options.kImageShare)) {
  const std::optional<std::string> content = ReadWorkFile(PlanFile(options.output));
  if (!content) throw InvalidInputError(Concat(options.output.string(), ": has no plan: give --plan first"));
  const Json json = Json::parse(*content);
  Take(json.at("origin"), &plan.origin);
  for (const Json& view : json.at("images")) {
    SceneImage image;
    uint64_t hash = 0;
    std::string path;
    VisitImage(&image, &plan.images.emplace_back(), &path, &hash,
               [&](const char* name, auto* value) { Take(view.at(name), value); });
    image.path = options.scene / path;
    const int index = plan.images.back().index;
    files[index] = hash;
    scene.images.resize(static_cast<size_t>(index) + 1);
    scene.images.back() = std::move(image);
  }
}

}  // namespace acmp
