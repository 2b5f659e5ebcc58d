#include <algorithm>
#include <exception>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "reconstruct_recorder.h"
#include "reconstruct_run.h"
#include "reconstruct_work_files.h"

namespace acmp {
namespace {

FinalMaps ToFinalMaps(const KeyframeDepth& keyframe) {
  FinalMaps maps;
  maps.depth = keyframe.depth.Clone();
  maps.normal = keyframe.normal.Clone();
  maps.cost = keyframe.cost.Clone();
  maps.confidence = keyframe.confidence.Clone();
  maps.color = keyframe.frame->color.Clone();
  maps.sources.assign(keyframe.source_ids.begin(), keyframe.source_ids.end());
  return maps;
}

class OnlineSchedule {
 public:
  explicit OnlineSchedule(ReconstructRun* run)
      : run_(*run),
        recorder_(run->engines.front().engine, &run->folder, &run->interrupt),
        mapper_(&recorder_, MapperOptions(*run),
                {{},
                 [this](const KeyframeDepthPtr& keyframe) { Try([&] { KeepFirst(*keyframe); }); },
                 [this](const KeyframeDrop& drop) { Try([&] { Drop(drop); }); },
                 [this](const KeyframeDepthPtr& keyframe) { Try([&] { Keep(*keyframe, true); }); },
                 {},
                 {},
                 [this](const std::string&, const std::string& message) { run_.progress.Warn(message); }}) {
    run_.folder.MakeWorkFolder("final");
  }

  void Run() {
    const PipelineOptions pipeline = MakePipelineOptions(run_.options);
    const double cost_of_image = TotalCost(run_.plan, pipeline) / static_cast<double>(run_.plan.images.size());
    run_.progress.Begin("keyframe", static_cast<int>(run_.plan.images.size()),
                        cost_of_image - StepCosts::kOutput - StepCosts::kFusion);
    const FrameOptions frame_options = MakeFrameOptions(run_.options);
    for (const ImagePlan& image : run_.plan.images) {
      run_.interrupt.Check();
      const int passes_before = recorder_.passes_run();
      Timer timer;
      auto frame = std::make_shared<Frame>(LoadFrame(run_.scene, image.index, frame_options));
      // What a PointCloud2 carries is in float: with the same bits the nodelet's maps are the same.
      frame->landmarks_in_world = RoundedToFloat(frame->landmarks_in_world);
      run_.times.reading_ms += timer.Lap();
      mapper_.AddKeyframe(std::move(frame));
      CheckOutcome();
      run_.progress.Step(recorder_.passes_run() == passes_before);
    }
    mapper_.Flush();
    CheckOutcome();
  }

 private:
  static DenseMapperOptions MapperOptions(const ReconstructRun& run) {
    std::vector<int> indices;
    for (const ImagePlan& image : run.plan.images) indices.push_back(image.index);
    return MakeMapperOptions(run.options, UnionOfDatasetRanges(run.scene, indices));
  }

  /// The mapper's callbacks must not throw, and a flush may bring more maps than there is memory for: they are written
  /// as they come, and the first failure is kept.
  template <class Work>
  void Try(const Work& work) {
    if (failure_) return;
    try {
      run_.interrupt.Check();  // a cancelled loop leaves unfinished maps
      work();
    } catch (...) {
      failure_ = std::current_exception();
    }
  }

  void CheckOutcome() {
    run_.interrupt.Check();
    if (failure_) std::rethrow_exception(failure_);
  }

  void KeepFirst(const KeyframeDepth& keyframe) {
    ++run_.times.images;
    Keep(keyframe, false);
  }

  /// @param anew the last ones are in the file, if it is not an earlier run's
  void Keep(const KeyframeDepth& keyframe, bool anew) {
    run_.times.Add(keyframe.times);
    run_.times.consistency_ms += keyframe.consistency_ms;
    PlanOf(keyframe.frame->id).sources.assign(keyframe.source_ids.begin(), keyframe.source_ids.end());
    const auto path = run_.folder.WorkFile("final", static_cast<int>(keyframe.frame->id));
    if (!anew && IsWholeWorkFile(path)) return;
    Timer timer;
    WriteFinalMaps(path, ToFinalMaps(keyframe));
    run_.times.keeping_ms += timer.Lap();
  }

  void Drop(const KeyframeDrop& drop) {
    if (drop.reason == "processing_error") throw ProcessingError(drop.message);
    ImagePlan& image = PlanOf(drop.id);
    image.no_map = drop.message;
    if (drop.reason == "no_depth_range") image.no_map += " (give --depth-min and --depth-max)";
  }

  ImagePlan& PlanOf(int64_t id) {
    const auto found = std::find_if(run_.plan.images.begin(), run_.plan.images.end(),
                                    [&](const ImagePlan& image) { return image.index == id; });
    if (found == run_.plan.images.end())
      throw ProcessingError(Concat("the mapper named image ", id, ", which it never got"));
    return *found;
  }

  ReconstructRun& run_;
  std::exception_ptr failure_;
  RecordingDepthEngine recorder_;
  DenseMapper mapper_;
};

void CheckSomeImageHasAMap(const ReconstructRun& run) {
  for (const ImagePlan& image : run.plan.images) {
    if (image.no_map.empty()) return;
  }
  throw InvalidInputError(Concat("none of the ", run.plan.images.size(), " images got a map; for example ",
                                 run.plan.images.front().no_map));
}

}  // namespace

void RunOnlineSchedule(ReconstructRun* run) {
  try {
    OnlineSchedule(run).Run();
  } catch (const RunAborted& aborted) {
    std::rethrow_exception(aborted.reason);
  }
  CheckSomeImageHasAMap(*run);
}

}  // namespace acmp
