#include <exception>
#include <map>
#include <utility>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/similarity.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "run.h"
#include "work_files.h"

namespace acmp {
namespace {

FinalMaps ToFinalMaps(const KeyframeDepth& keyframe) {
  return {keyframe.depth.Clone(), keyframe.normal.Clone(), keyframe.cost.Clone(), keyframe.confidence.Clone()};
}

/// Feeds the images to a mapper and keeps the last maps of each.
class OnlineSchedule {
 public:
  explicit OnlineSchedule(ReconstructRun* run)
      : run_(*run), mapper_(run->devices.Engine(0, 0).engine, MapperOptions(*run), Callbacks()) {}

  void Run() {
    Capture capture;  // of the faces of a wide image
    for (size_t i = 0; i < run_.plan.images.size(); ++i) {
      auto frame =
          std::make_shared<Frame>(LoadFrame(run_.scene, run_.plan.images[i].index, run_.options.max_image_size));
      // What a PointCloud2 carries is in float: with the same bits the nodelet's maps are the same.
      for (Eigen::Vector3d& p : frame->landmarks_in_world) p -= run_.plan.origin;
      frame->landmarks_in_world = RoundedToFloat(frame->landmarks_in_world);
      for (Eigen::Vector3d& p : frame->landmarks_in_world) p += run_.plan.origin;
      capture.keyframes.push_back(std::move(frame));
      const int last = ImagesOfFile(run_.scene, run_.plan.images[i].index).second;
      if (i + 1 < run_.plan.images.size() && run_.plan.images[i + 1].index < last) continue;
      mapper_.AddCapture(std::exchange(capture, {}));
      CheckOutcome();
      run_.progress.Step();
    }
    mapper_.Flush();
    CheckOutcome();
    PlaceRefined();
  }

 private:
  static DenseMapperOptions MapperOptions(const ReconstructRun& run) {
    std::vector<int> indices;
    for (const ImagePlan& image : run.plan.images) indices.push_back(image.index);
    return MakeMapperOptions(run.options, UnionOfDatasetRanges(run.scene, indices));
  }

  DenseMapper::Callbacks Callbacks() {
    DenseMapper::Callbacks callbacks;
    callbacks.on_refined = [this](const KeyframeDepthPtr& keyframe) {
      Try([&] {
        ++run_.times.images;
        Keep(*keyframe);
      });
    };
    callbacks.on_refined_again = [this](const KeyframeDepthPtr& keyframe) { Try([&] { Keep(*keyframe); }); };
    callbacks.on_withdrawn = [this](const KeyframeDepthPtr& keyframe, const std::string& message) {
      Try([&] { PlanOf(keyframe->frame->id).no_map = message; });
    };
    callbacks.on_drop = [this](const KeyframeDrop& drop) { Try([&] { Drop(drop); }); };
    callbacks.on_problem = [this](const std::string& reason, const std::string& message) {
      // With a failed second estimate the run would end in other maps.
      if (reason == "refine_again_failed") return Try([&] { throw ProcessingError(message); });
      run_.progress.Warn(message);
    };
    return callbacks;
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

  void CheckOutcome() const {
    run_.interrupt.Check();
    if (failure_) std::rethrow_exception(failure_);
  }

  void Keep(const KeyframeDepth& keyframe) {
    run_.times.stages += keyframe.times;
    ImagePlan& image = PlanOf(keyframe.frame->id);
    run_.prior_depth_rejections.erase(image.index);
    if (!keyframe.prior_depth_rejection.empty()) {
      run_.prior_depth_rejections[image.index] = keyframe.prior_depth_rejection;
    }
    image.no_map.clear();  // if it had been withdrawn
    run_.scene.images[static_cast<size_t>(image.index)].cam_from_world = keyframe.cam_from_world;
    refined_.erase(image.index);
    if (keyframe.refined_camera) {
      refined_[image.index] = {*keyframe.refined_camera, keyframe.frame->cam_from_world.inverse()};
    }
    image.sources.assign(keyframe.source_ids.begin(), keyframe.source_ids.end());
    WriteFinalMaps(run_.store.FileOf({run_.store.final_step(), image.index}), ToFinalMaps(keyframe));
  }

  /// As the map does with the nodelet's keyframes.
  void PlaceRefined() {
    std::vector<TrajectoryKeyframe> keyframes;
    std::vector<int> indices;
    for (const ImagePlan& image : run_.plan.images) {
      const auto refined = refined_.find(image.index);
      if (refined == refined_.end() || !image.no_map.empty()) continue;
      keyframes.push_back({ImagesOfFile(run_.scene, image.index).first, refined->second});
      indices.push_back(image.index);
    }
    const std::vector<std::optional<Similarity>> placed = PlaceAlong(keyframes);
    for (size_t i = 0; i < indices.size(); ++i) {
      if (!placed[i]) continue;
      run_.scene.images[static_cast<size_t>(indices[i])].cam_from_world = placed[i]->rigid.inverse();
      const std::filesystem::path file = run_.store.FileOf({run_.store.final_step(), indices[i]});
      FinalMaps maps = ReadFinalMaps(file);
      for (float& depth : maps.depth) depth *= static_cast<float>(placed[i]->scale);
      WriteFinalMaps(file, maps);
      run_.interrupt.Check();
    }
  }

  void Drop(const KeyframeDrop& drop) {
    if (drop.reason == "processing_error") throw ProcessingError(drop.message);
    ImagePlan& image = PlanOf(drop.frame->id);
    image.no_map = drop.message;
    if (drop.reason == "no_depth_range") image.no_map += " (give --depth-min and --depth-max)";
  }

  ImagePlan& PlanOf(int64_t id) {
    std::vector<ImagePlan>& images = run_.plan.images;
    return images.at(static_cast<size_t>(run_.plan.Find(static_cast<int>(id)) - images.data()));
  }

  ReconstructRun& run_;
  std::exception_ptr failure_;
  std::map<int, RefinedAndReceived> refined_;  ///< by image: as its maps were refined last
  DenseMapper mapper_;
};

}  // namespace

void RunOnlineSchedule(ReconstructRun* run) {
  run->progress.Begin("keyframe", static_cast<int>(run->plan.images.size()));
  OnlineSchedule(run).Run();
  CheckSomeImageGetsAMap(run->plan, run->scene);
}

}  // namespace acmp
