#include "run_tasks.h"

#include <tbb/parallel_for.h>

#include <mutex>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/geometry/vector_conversion.h"

namespace acmp {
namespace {

/// The problem with the poses of coordinates that begin at the origin.
EngineProblem InLocalCoordinates(EngineProblem problem, const Eigen::Vector3d& origin) {
  if (origin.isZero(0)) return problem;
  const auto move = [&](EngineView* view) {
    RigidTransform pose = view->cam_from_world();
    pose.translation() += pose.linear() * origin;
    view->refined_pose = pose;
  };
  move(&problem.reference);
  for (EngineView& source : problem.sources) move(&source);
  return problem;
}

/// Moves a cloud of coordinates that begin at the origin.
void MoveCloud(const RigidTransform& motion, const Eigen::Vector3d& origin, PointCloud* cloud) {
  if (motion.matrix() == RigidTransform::Identity().matrix()) return;
  for (SurfacePoint& point : *cloud) {
    point.position = ToVec3f(motion * (ToEigen(point.position) + origin) - origin);
    point.normal = ToVec3f(motion.linear() * ToEigen(point.normal));
  }
}

}  // namespace

std::set<StepOfImage> StepsToDo(const std::filesystem::path& output, const ReconstructPlan& plan, const Scene& scene,
                                int step, int final_step, const std::set<int>& wanted, const StopRequest& interrupt,
                                Progress* progress) {
  std::set<StepOfImage> to_do;
  std::set<int> read = wanted;  // of the step's results, by scene index
  for (; step >= 0; --step) {
    const std::vector<int> images(read.begin(), read.end());
    const auto file_of = [&](size_t i) { return EngineStore::FileOf(output, {step, images[i]}, final_step); };
    std::vector<WorkFileState> files(images.size());
    tbb::parallel_for(size_t{0}, images.size(), [&](size_t i) {
      interrupt.Check();
      files[i] = CheckWorkFile(file_of(i));
    });
    read.clear();
    for (size_t i = 0; i < images.size(); ++i) {
      if (files[i] == WorkFileState::kWhole) continue;
      if (files[i] == WorkFileState::kDamaged) {
        progress->Warn(Concat("the work file ", file_of(i).string(), " is damaged: its step of image ",
                              scene.images[static_cast<size_t>(images[i])].name, " is computed again"));
      }
      to_do.insert({step, images[i]});
      for (int other : plan.ImagesRead(*plan.Find(images[i]))) read.insert(other);
    }
  }
  return to_do;
}

void RunTasks::AddSteps(const std::set<StepOfImage>& steps) {
  for (int device = 0; device < run_.devices.size(); ++device) {
    std::vector<DepthEstimator>& estimators = estimators_.emplace_back();
    for (int i = 0; i < run_.devices.NumEngines(device); ++i) {
      estimators.emplace_back(run_.devices.Engine(device, i).engine, run_.pipeline);
    }
  }
  using LateFirst = std::pair<int, int>;  // -step, scene index
  std::map<LateFirst, std::vector<LateFirst>> after;
  for (const auto& [step, index] : steps) {
    std::vector<LateFirst>& waits_for = after[{-step, index}];
    if (step == 0) continue;
    const ImagePlan& image = *run_.plan.Find(index);
    run_.store.AddReaders(image, step - 1, 1);
    for (int read : run_.plan.ImagesRead(image)) {
      if (steps.count({step - 1, read}) > 0) waits_for.emplace_back(1 - step, read);
    }
  }
  for (const auto& [late, index] : InOrder(after)) {
    const ImagePlan& image = *run_.plan.Find(index);
    const int device = run_.devices.DeviceOf(index);
    const auto work = [this, step = -late, &image, device](int thread) {
      DoStep(step, image, run_.devices.Engine(device, thread),
             &estimators_.at(static_cast<size_t>(device)).at(static_cast<size_t>(thread)));
    };
    steps_[{-late, index}] = graph_.Add(Devices::EnginePool(device), StepsRead(-late - 1, image), work);
  }
}

std::set<StepOfImage> RunTasks::AddMissingSteps() {
  std::set<int> all;
  for (const ImagePlan& image : run_.plan.images) {
    if (image.no_map.empty()) all.insert(image.index);
  }
  std::set<StepOfImage> steps = StepsToDo(run_.store.output(), run_.plan, run_.scene, final_step_, final_step_, all,
                                          run_.interrupt, &run_.progress);
  AddSteps(steps);
  return steps;
}

std::vector<int> RunTasks::StepsRead(int step, const ImagePlan& image) const {
  std::vector<int> tasks;
  for (int read : run_.plan.ImagesRead(image)) {
    if (const auto task = steps_.find({step, read}); task != steps_.end()) tasks.push_back(task->second);
  }
  return tasks;
}

std::vector<int> RunTasks::FinalStepsRead(const ImagePlan& image) const { return StepsRead(final_step_, image); }

void RunTasks::DoStep(int step, const ImagePlan& image, const DeviceEngine& engine, DepthEstimator* estimator) {
  Timer timer;
  const EngineProblem problem =
      step == 0 ? run_.store.Problem(image, engine) : run_.store.Problem(image, step - 1, engine);
  const double reading_ms = timer.Lap();
  run_.interrupt.Check();
  const EngineEstimatePtr estimate = estimator->Run(estimator->schedule()[static_cast<size_t>(step)], problem);
  run_.interrupt.Check();
  timer.Lap();
  run_.store.Keep(step, *problem.reference.frame, engine, estimate);
  {
    const std::lock_guard<std::mutex> lock(run_.mutex);
    run_.times.stages += estimator->last_times();
    if (step == final_step_ && !estimator->prior_depth_rejection().empty()) {
      run_.prior_depth_rejections[image.index] = estimator->prior_depth_rejection();
    }
    run_.times.images += step == 0 ? 1 : 0;
    run_.times.reading_ms += reading_ms;
    run_.times.keeping_ms += timer.Lap();
  }
  if (step > 0) run_.store.HasRead(image, step - 1);
  run_.progress.Step();
}

int RunTasks::AddConfidence(const ImagePlan& image, std::function<void(ConfidenceMap)> take) {
  run_.store.AddReaders(image, final_step_, 1);
  const int device = run_.devices.DeviceOf(image.index);
  const auto measure = [this, &image, device, take = std::move(take)](int thread) {
    const DeviceEngine engine = run_.devices.Engine(device, thread);
    const EngineProblem problem = run_.store.Problem(image, final_step_, engine);
    Timer timer;
    ConfidenceMap confidence =
        engine.engine->MeasureConfidence(problem.reference, problem.sources, run_.pipeline.fusion);
    run_.interrupt.Check();
    run_.store.HasRead(image, final_step_);
    run_.Count(&RunTimes::consistency_ms, timer.Lap());
    take(std::move(confidence));
  };
  return graph_.Add(Devices::EnginePool(device), FinalStepsRead(image), measure, true);
}

FusionStamps* RunTasks::stamps() {
  if (!stamps_) stamps_ = run_.devices.FusionEngine(0).engine->MakeFusionStamps();
  return stamps_.get();
}

int RunTasks::AddFusion(const ImagePlan& image, std::function<void(PointCloud)> take) {
  CheckRange("number of images to fuse", views_ + 1, 0, kMaxFusionViews);
  run_.store.AddReaders(image, final_step_, 1);
  std::vector<int> after = FinalStepsRead(image);
  const std::vector<int> frames = run_.plan.ImagesRead(image);
  for (int frame : frames) {
    if (const auto last = last_fused_.find(frame); last != last_fused_.end()) after.push_back(last->second);
  }
  const int device = run_.devices.DeviceOf(image.index);
  stamps();
  const auto points = std::make_shared<PointCloud>();
  const auto fuse = [this, &image, device, rank = views_++, points](int) {
    *points = Fuse(image, rank, run_.devices.FusionEngine(device));
  };
  const int fused = graph_.Add(run_.devices.FusionPool(device), after, fuse);
  for (int frame : frames) last_fused_[frame] = fused;
  return AddFileTask(
      {fused}, [points, take = std::move(take)] { take(std::move(*points)); }, true);
}

PointCloud RunTasks::Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine) {
  const EngineProblem problem = InLocalCoordinates(run_.store.Problem(image, final_step_, engine), run_.plan.origin);
  Timer timer;
  PointCloud cloud =
      engine.engine->FuseView(problem.reference, problem.sources, run_.pipeline.fusion, rank, stamps_.get());
  MoveCloud(run_.scene.images[static_cast<size_t>(image.index)].placed_from_world, run_.plan.origin, &cloud);
  run_.interrupt.Check();
  run_.store.HasRead(image, final_step_);
  run_.progress.Step();
  run_.Count(&RunTimes::fusion_ms, timer.Lap());
  return cloud;
}

void RunTasks::SetFusedPixels(const Frame& frame, const Image<unsigned char>& used) {
  run_.devices.FusionEngine(0).engine->SetFusedPixels(frame, used, stamps());
  views_ = 1;
}

Image<unsigned char> RunTasks::FusedPixels(const Frame& frame) {
  return run_.devices.FusionEngine(0).engine->FusedPixels(frame, stamps());
}

int RunTasks::AddFileTask(const std::vector<int>& after, std::function<void()> work, bool urgent) {
  return graph_.Add(
      Devices::kFilePool, after, [work = std::move(work)](int) { work(); }, urgent);
}

}  // namespace acmp
