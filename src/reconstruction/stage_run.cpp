#include <algorithm>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/pipeline/schedule.h"
#include "chunk_fusion.h"
#include "cloud_output.h"
#include "input_hash.h"
#include "map_writer.h"
#include "run_end.h"
#include "run_record.h"
#include "stage_run.h"
#include "stages.h"
#include "summary.h"
#include "work_blocks.h"

namespace acmp {
namespace {

using Key = EngineStore::Key;
using nlohmann::json;

class StageRun {
 public:
  StageRun(const ReconstructOptions& options, const OutputFolder& folder, PlannedScene* planned,
           const std::function<Devices*()>& devices, StopRequest* interrupt, std::ostream* out, Progress* progress)
      : options_(options),
        folder_(folder),
        devices_(devices),
        interrupt_(*interrupt),
        out_(*out),
        progress_(*progress),
        plans_(planned->plans),
        part_(planned->part),
        frames_(planned->frames),
        final_step_(static_cast<int>(ScheduleOf(MakePipelineOptions(options)).size()) - 1) {}

  void Run() {
    if (options_.stage == kFinishStage) return Finish();
    LoadChosen();
    if (options_.stage == kMapsStage) return WriteMaps();
    if (options_.stage == kFuseStage) return Fuse();
    for (int step = 0; step <= final_step_; ++step) {
      if (options_.stage == EngineStore::StepName(step, final_step_)) return DoStep(step);
    }
    std::string names;
    for (const std::string& name : StagesOfChunk(options_)) names += name + ", ";
    throw InvalidInputError(Concat("--stage ", options_.stage, ": must be one of ", names, kFinishStage));
  }

 private:
  /// Images of the range that take part.
  void LoadChosen() {
    const std::vector<int> chunks = plans_.Chunks();
    const int count = (chunks.back() + 1) * options_.chunk_images;
    if (options_.images.empty()) throw InvalidInputError("--stage: needs --images");
    std::set<int> chosen_chunks;
    for (int index : ParseImageIndices(options_.images, count)) {
      const int chunk = plans_.ChunkOf(index);
      if (!std::binary_search(chunks.begin(), chunks.end(), chunk)) continue;
      part_.Load(chunk);
      chosen_chunks.insert(chunk);
      chosen_.insert(index);
    }
    std::set<int> planned;
    for (int chunk : chosen_chunks) {
      for (int index : part_.ImagesOf(chunk)) planned.insert(index);
    }
    for (auto index = chosen_.begin(); index != chosen_.end();) {
      index = planned.count(*index) > 0 ? std::next(index) : chosen_.erase(index);
    }
    if (chosen_.empty()) {
      throw InvalidInputError(Concat("--images ", options_.images, ": the plan has none of these images"));
    }
    if (options_.stage != kFuseStage) return;
    for (int chunk : chosen_chunks) {
      for (int index : part_.ImagesOf(chunk)) {
        if (chosen_.count(index) > 0) continue;
        throw InvalidInputError(Concat("--stage ", kFuseStage, ": must have whole chunks of ", options_.chunk_images,
                                       " images, and --images ", options_.images, " lacks ", index));
      }
    }
  }

  /// Those chosen that get a map.
  std::set<int> Targets() {
    std::set<int> targets;
    for (int index : chosen_) {
      if (part_.plan().HasMap(index)) targets.insert(index);
    }
    return targets;
  }

  std::string NameOf(int index) { return part_.scene().images[static_cast<size_t>(index)].name; }

  /// That the chosen images are what they were when their first stage was done; writes that down for the first one.
  void CheckContent() {
    const std::vector<int> indices(chosen_.begin(), chosen_.end());
    tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
      interrupt_.Check();
      const ImageHashes hashes = HashesOf(part_.scene(), indices[i]);
      const std::string now = json({hashes.file, hashes.mask.value_or(0), hashes.prior_depth.value_or(0)}).dump();
      const std::filesystem::path file = folder_.WorkFile("input", indices[i]);
      const std::optional<std::string> before = ReadBlock(file);
      if (!before) {
        WriteBlock(file, now);
      } else if (*before != now) {
        throw InvalidInputError(
            Concat("image ", NameOf(indices[i]),
                   ": it, its mask or its prior depth has changed since its first stage: plan with --overwrite"));
      }
    });
    interrupt_.Check();
  }

  /// Steps that are to do before these images have estimates of a step.
  std::set<Key> ToDo(int step, const std::set<int>& targets) {
    const auto file_of = [&](const Key& key) {
      return folder_.WorkFile(EngineStore::StepName(key.first, final_step_), key.second);
    };
    return StepsToDo(
        step, targets, file_of, [&](int index) { return part_.ImagesRead(index); }, interrupt_,
        [&](const Key& key) { WarnOfDamage(file_of(key), NameOf(key.second), &progress_); });
  }

  /// A run of what is loaded so far.
  template <class Work>
  void OnDevices(const std::set<Key>& to_do, const Work& work) {
    std::set<int> worked_on = chosen_;
    for (const auto& [step, index] : to_do) worked_on.insert(index);
    Devices& devices = *devices_();
    devices.ShareOut({worked_on.begin(), worked_on.end()});
    CheckDevice(devices.name());
    EngineStore store(&frames_, options_, &folder_, part_.plan(), devices, ScheduleOf(MakePipelineOptions(options_)));
    ReconstructRun run{{part_.scene(), options_, part_.plan(), devices, store, interrupt_, progress_, {}, {}, {}},
                       folder_};
    work(&run);
    interrupt_.Check();
    ReportUnusedPriorDepth(run);
  }

  /// All stages must be done by devices of one model: others make other bits.
  void CheckDevice(const std::string& name) const {
    const std::filesystem::path file = folder_.WorkFile("device", 0);
    if (!ReadBlock(file)) WriteBlock(file, name);
    const std::string first = ReadBlock(file).value_or(name);
    if (DeviceModel(first) != DeviceModel(name)) {
      throw InvalidInputError(Concat("--device: the first stage was done by ", DeviceModel(first), ", and this is ",
                                     DeviceModel(name), ", which makes other bits"));
    }
  }

  void DoStep(int step) {
    CheckContent();
    const std::set<Key> to_do = ToDo(step, Targets());
    std::set<int> only_checked;  // images without a map are read once, so that a damaged one is found
    for (int index : chosen_) {
      if (step == 0 && !part_.plan().HasMap(index)) only_checked.insert(index);
    }
    if (to_do.empty() && only_checked.empty()) return;
    OnDevices(to_do, [&](ReconstructRun* run) {
      for (int index : only_checked) frames_.Get(index);
      TaskGraph graph;
      AddOfflineSteps(run, to_do, &graph);
      progress_.Begin(options_.stage, static_cast<int>(to_do.size()));
      graph.Run(run->devices.PoolThreads(), interrupt_);
    });
  }

  /// The tasks after which the final estimates that the image's maps and points are made of are there.
  std::vector<int> Finals(const ImagePlan& image, const std::map<Key, int>& steps) {
    std::vector<int> after;
    for (int read : part_.plan().ImagesRead(image)) {
      if (const auto task = steps.find({final_step_, read}); task != steps.end()) after.push_back(task->second);
    }
    return after;
  }

  std::set<int> AllRead(const std::set<int>& targets) {
    std::set<int> all;
    for (int index : targets) {
      for (int read : part_.ImagesRead(index)) all.insert(read);
    }
    return all;
  }

  std::filesystem::path MapsRecord(int index) const { return folder_.WorkFile(kMapsStage, index); }

  /// Whether an image's files are as they were written.
  bool HasMaps(int index) const {
    const std::optional<std::string> record = ReadBlock(MapsRecord(index));
    if (!record) return false;
    const json files = json::parse(*record);
    for (const auto& [name, checksum] : files.items()) {
      const std::optional<uint32_t> now = ChecksumOfFile(folder_.path() / name);
      if (!now || *now != checksum.get<uint32_t>()) return false;
    }
    return true;
  }

  void RecordMaps(int index, const ImageFiles& files) const {
    json record = json::object();
    for (const std::filesystem::path& file : files.FilesOf(index)) {
      record[std::filesystem::relative(file, folder_.path()).string()] = ChecksumOfFile(file).value_or(0);
    }
    WriteBlock(MapsRecord(index), record.dump());
  }

  void WriteMaps() {
    std::set<int> targets;
    for (int index : Targets()) {
      if (!HasMaps(index)) targets.insert(index);
    }
    if (targets.empty()) return;
    CheckContent();
    const std::set<Key> to_do = ToDo(final_step_, AllRead(targets));
    OnDevices(to_do, [&](ReconstructRun* run) {
      TaskGraph graph;
      const std::map<Key, int> steps = AddOfflineSteps(run, to_do, &graph);
      MapWriter writer(run);
      for (const ImagePlan& image : run->plan.images) {
        if (targets.count(image.index) == 0) continue;
        const int written = writer.AddTasks(image, Finals(image, steps), &graph);
        graph.Add(Devices::kFilePool, {written}, [&, index = image.index](int) { RecordMaps(index, writer.files()); });
      }
      progress_.Begin(options_.stage, static_cast<int>(to_do.size() + targets.size()));
      graph.Run(run->devices.PoolThreads(), interrupt_);
      writer.WarnOfDepthsTooFar();
    });
  }

  void Fuse() {
    std::map<int, std::vector<int>> chunks;  // images with maps
    for (int index : Targets()) chunks[plans_.ChunkOf(index)].push_back(index);
    for (auto chunk = chunks.begin(); chunk != chunks.end();) {
      chunk = HasChunkPoints(folder_, chunk->first, chunk->second) ? chunks.erase(chunk) : std::next(chunk);
    }
    if (chunks.empty()) return;
    CheckContent();
    std::set<int> read;
    for (const auto& [number, images] : chunks) read.merge(AllRead({images.begin(), images.end()}));
    const std::set<Key> to_do = ToDo(final_step_, read);
    OnDevices(to_do, [&](ReconstructRun* run) {
      TaskGraph graph;
      AddOfflineSteps(run, to_do, &graph);
      progress_.Begin(options_.stage, static_cast<int>(to_do.size() + chosen_.size()));
      graph.Run(run->devices.PoolThreads(), interrupt_);
      for (const auto& [number, images] : chunks) {
        FuseChunk(run, &frames_, number, images, part_.FusedBefore(number));
      }
    });
  }

  void Finish() {
    const Timer timer;
    for (int chunk : plans_.Chunks()) part_.Load(chunk);
    std::vector<ImageHashes> hashes;
    for (const ImagePlan& image : part_.plan().images) {
      const std::optional<std::string> input = ReadBlock(folder_.WorkFile("input", image.index));
      if (!input) FailUnfinished(EngineStore::StepName(0, final_step_), image.index);
      const json content = json::parse(*input);
      hashes.push_back(
          {image.index, content.at(0).get<uint64_t>(), std::nullopt, std::nullopt, part_.GeometryOf(image.index)});
      const SceneImage& scene_image = part_.scene().images[static_cast<size_t>(image.index)];
      if (!scene_image.mask.empty()) hashes.back().mask = content.at(1).get<uint64_t>();
      if (!scene_image.prior_depth.empty()) hashes.back().prior_depth = content.at(2).get<uint64_t>();
    }
    const std::string device = ReadBlock(folder_.WorkFile("device", 0)).value_or("");
    const RunRecord record = MakeRecord(options_, device, InputHash(hashes));
    std::string failure;
    OnDevices({}, [&](ReconstructRun* run) {
      const CloudSize cloud = WriteCloudAndCameras(*run);
      failure = EndRun(run, record, device, timer, cloud, &out_);
    });
    folder_.Rewrite(record);
    folder_.RemoveWork();
    if (!failure.empty()) throw ProcessingError(failure);
  }

  CloudSize WriteCloudAndCameras(const ReconstructRun& run) {
    std::vector<int> images;
    CloudOutput cloud(options_, &folder_, run.plan.origin);
    progress_.Begin(options_.stage, static_cast<int>(run.plan.images.size()));
    for (const ImagePlan& image : run.plan.images) {
      interrupt_.Check();
      progress_.Step();
      if (!image.no_map.empty()) continue;
      images.push_back(image.index);
      if (!options_.maps.empty() && !std::filesystem::exists(MapsRecord(image.index))) {
        FailUnfinished(kMapsStage, image.index);
      }
      const std::optional<PointCloud> points = ReadPointsOfView(folder_, image.index);
      if (!points) FailUnfinished(kFuseStage, image.index);
      cloud.WriteAt(cloud.Reserve(points->size()), *points);
    }
    cloud.Commit(interrupt_);
    WriteCameraList(folder_.path() / "cameras.txt", Cameras(run, images));
    return cloud.size();
  }

  [[noreturn]] void FailUnfinished(const std::string& stage, int index) {
    throw ProcessingError(Concat("--stage ", kFinishStage, ": stage ", stage, " of image ", NameOf(index), " (index ",
                                 index, ") is not done, or its files are damaged"));
  }

  const ReconstructOptions& options_;
  const OutputFolder& folder_;
  const std::function<Devices*()>& devices_;
  StopRequest& interrupt_;
  std::ostream& out_;
  Progress& progress_;
  const ChunkPlans& plans_;
  ScenePart& part_;
  FrameStore& frames_;
  const int final_step_;
  std::set<int> chosen_;  ///< images that the stage is for, by scene index
};

}  // namespace

void DoStage(const ReconstructOptions& options, const OutputFolder& folder, PlannedScene* planned,
             const std::function<Devices*()>& devices, StopRequest* interrupt, std::ostream* out, Progress* progress) {
  StageRun(options, folder, planned, devices, interrupt, out, progress).Run();
}

}  // namespace acmp
