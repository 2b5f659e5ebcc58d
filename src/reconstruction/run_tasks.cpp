#include "run_tasks.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <thread>

#include "acmp_mapping/common/error.h"
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

constexpr int kUrgent = -1;  // rank of a task: before any step

/// The device that works on the image at a place of those worked on. Stretches of up to 16 images, of about the same
/// length, go to one device after the other: neighbours, which mostly see the same, are on the same one, and all
/// devices are at about the same place of the scene, so that few points wait for those of earlier images.
/// @param place below `images`; `devices` at least 1
/// @return the device's number, from 0
int DeviceOfPlace(size_t place, size_t images, size_t devices) {
  constexpr size_t kMaxLength = 16;  // of a stretch
  const size_t rounds = (images + kMaxLength * devices - 1) / (kMaxLength * devices);
  const size_t stretches = std::min(rounds * devices, images);
  const size_t stretch = ((place + 1) * stretches - 1) / images;  // s begins at s * images / stretches, rounded down
  return static_cast<int>(stretch % devices);
}

}  // namespace

int TaskGraph::Add(int pool, int rank, const std::vector<int>& after, std::function<void(int)> work) {
  const int number = static_cast<int>(tasks_.size());
  for (int other : after) {
    CheckRange("number of a task that another waits for", other, 0, number - 1);
    tasks_[static_cast<size_t>(other)].followers.push_back(number);
  }
  tasks_.push_back({static_cast<size_t>(pool), rank, static_cast<int>(after.size()), {}, std::move(work)});
  return number;
}

void TaskGraph::Run(const std::vector<int>& threads, const StopRequest& interrupt) {
  ready_.resize(threads.empty() ? 1 : threads.size());
  left_ = tasks_.size();
  for (size_t i = 0; i < tasks_.size(); ++i) {
    if (threads.empty()) tasks_[i].pool = 0;
    if (tasks_[i].waits_for == 0) MakeReady(static_cast<int>(i));
  }
  std::vector<std::thread> workers;
  try {
    for (size_t pool = 0; pool < threads.size(); ++pool) {
      for (int i = 0; i < threads[pool]; ++i) workers.emplace_back([=, &interrupt] { Work(pool, i, interrupt); });
    }
  } catch (...) {
    // The system gives no further thread. Those that run must be joined before the error may leave.
    Fail(std::current_exception());
  }
  if (threads.empty()) Work(0, 0, interrupt);
  for (std::thread& worker : workers) worker.join();
  if (failure_) std::rethrow_exception(failure_);
}

void TaskGraph::Work(size_t pool, int thread, const StopRequest& interrupt) {
  for (int number = Next(pool); number >= 0; number = Next(pool)) {
    try {
      interrupt.Check();
      std::function<void(int)> work = std::move(tasks_[static_cast<size_t>(number)].work);
      work(thread);
      interrupt.Check();
      work = nullptr;  // what it holds goes before others go on, and not under the mutex
      Finish(number);
    } catch (...) {
      Fail(std::current_exception());
    }
  }
}

void TaskGraph::MakeReady(int number) {
  const Task& task = tasks_[static_cast<size_t>(number)];
  ready_.at(task.pool).insert({task.rank, number});
}

/// A ready task of the pool; waits for one. -1: there will be none any more.
int TaskGraph::Next(size_t pool) {
  std::unique_lock<std::mutex> lock(mutex_);
  auto& ready = ready_[pool];
  changed_.wait(lock, [&] { return failure_ || left_ == 0 || !ready.empty(); });
  if (failure_ || ready.empty()) return -1;
  const int number = ready.begin()->second;
  ready.erase(ready.begin());
  return number;
}

void TaskGraph::Finish(int number) {
  const std::lock_guard<std::mutex> lock(mutex_);
  --left_;
  for (int follower : tasks_[static_cast<size_t>(number)].followers) {
    if (--tasks_[static_cast<size_t>(follower)].waits_for == 0) MakeReady(follower);
  }
  changed_.notify_all();
}

/// No further task is begun.
void TaskGraph::Fail(std::exception_ptr failure) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!failure_) failure_ = std::move(failure);
  changed_.notify_all();
}

RunTasks::RunTasks(ReconstructRun* run, int step, const std::set<int>& images)
    : run_(*run), final_step_(run->store.final_step()) {
  const std::set<StepOfImage> missing = MissingSteps(step, images);
  std::set<int> worked_on = images;
  for (const auto& [number, index] : missing) worked_on.insert(index);
  size_t place = 0;
  for (int index : worked_on) {
    device_of_[index] = DeviceOfPlace(place++, worked_on.size(), static_cast<size_t>(run_.devices.size()));
  }
  for (int device = 0; device < run_.devices.size(); ++device) {
    std::vector<DepthEstimator>& estimators = estimators_.emplace_back();
    for (int i = 0; i < run_.devices.NumEngines(device); ++i) {
      estimators.emplace_back(run_.devices.Engine(device, i).engine, run_.pipeline);
    }
  }
  for (const auto& [number, index] : missing) AddStep(number, *run_.plan.Find(index));
}

/// @param read images whose estimates after the step are wanted
std::set<RunTasks::StepOfImage> RunTasks::MissingSteps(int step, std::set<int> read) const {
  std::set<StepOfImage> missing;
  for (; step >= 0; --step) {
    const std::vector<int> images(read.begin(), read.end());
    std::vector<WorkFileState> files(images.size());
    tbb::parallel_for(size_t{0}, images.size(), [&](size_t i) {
      run_.interrupt.Check();
      files[i] = run_.store.FindFile({step, images[i]});
    });
    read.clear();
    for (size_t i = 0; i < images.size(); ++i) {
      if (files[i] == WorkFileState::kWhole) continue;
      if (files[i] == WorkFileState::kDamaged) {
        run_.progress.Warn(Concat("the work file ", run_.store.FileOf({step, images[i]}).string(),
                                  " is damaged: its step of image ",
                                  run_.scene.images[static_cast<size_t>(images[i])].name, " is computed again"));
      }
      missing.insert({step, images[i]});
      for (int other : run_.plan.ImagesRead(*run_.plan.Find(images[i]))) read.insert(other);
    }
  }
  return missing;
}

void RunTasks::AddStep(int step, const ImagePlan& image) {
  if (step > 0) run_.store.AddReader(image, step - 1);
  const int device = device_of_.at(image.index);
  const auto work = [this, step, &image, device](int thread) {
    DoStep(step, image, run_.devices.Engine(device, thread),
           &estimators_.at(static_cast<size_t>(device)).at(static_cast<size_t>(thread)));
  };
  steps_[{step, image.index}] =
      graph_.Add(Devices::EnginePool(device), final_step_ - step, StepsRead(step - 1, image), work);
}

std::vector<int> RunTasks::StepsRead(int step, const ImagePlan& image) const {
  std::vector<int> tasks;
  for (int read : run_.plan.ImagesRead(image)) {
    if (const auto task = steps_.find({step, read}); task != steps_.end()) tasks.push_back(task->second);
  }
  return tasks;
}

void RunTasks::DoStep(int step, const ImagePlan& image, const DeviceEngine& engine, DepthEstimator* estimator) {
  const EngineProblem problem = run_.store.Problem(image, step - 1, engine);
  run_.interrupt.Check();
  const EngineEstimatePtr estimate = estimator->Run(estimator->schedule()[static_cast<size_t>(step)], problem);
  run_.interrupt.Check();
  run_.store.Keep(step, *problem.reference.frame, engine, estimate);
  {
    const std::lock_guard<std::mutex> lock(run_.mutex);
    run_.times.stages += estimator->last_times();
    if (step == final_step_ && !estimator->prior_depth_rejection().empty()) {
      run_.prior_depth_rejections[image.index] = estimator->prior_depth_rejection();
    }
    run_.times.images += step == 0 ? 1 : 0;
  }
  if (step > 0) run_.store.HasRead(image, step - 1);
  run_.progress.Step();
}

int RunTasks::AddMaps(const ImagePlan& image, bool measure, std::function<void(FinalMaps)> take) {
  run_.store.AddReader(image, final_step_);
  const int device = device_of_.at(image.index);
  const auto fetch = [this, &image, device, measure, take = std::move(take)](int thread) {
    const DeviceEngine engine = run_.devices.Engine(device, thread);
    const EngineProblem problem = run_.store.Problem(image, final_step_, engine);
    EstimateMaps maps = engine.engine->Download(problem.reference.estimate);
    ConfidenceMap confidence;
    if (measure) {
      confidence = engine.engine->MeasureConfidence(problem.reference, problem.sources, run_.pipeline.fusion);
    }
    run_.interrupt.Check();
    run_.store.HasRead(image, final_step_);
    take({std::move(maps.depth), std::move(maps.normal), std::move(maps.cost), std::move(confidence)});
  };
  return graph_.Add(Devices::EnginePool(device), kUrgent, StepsRead(final_step_, image), fetch);
}

int RunTasks::AddFusion(const ImagePlan& image, std::vector<int> after, std::function<void(PointCloud)> take) {
  CheckRange("number of images to fuse", views_ + 1, 0, kMaxFusionViews);
  run_.store.AddReader(image, final_step_);
  for (int step : StepsRead(final_step_, image)) after.push_back(step);
  const std::vector<int> frames = run_.plan.ImagesRead(image);
  for (int frame : frames) {
    if (const auto last = last_fused_.find(frame); last != last_fused_.end()) after.push_back(last->second);
  }
  const int device = device_of_.at(image.index);
  if (!stamps_) stamps_ = run_.devices.FusionEngine(0).engine->MakeFusionStamps();
  const auto fuse = [this, &image, device, rank = views_++, take = std::move(take)](int) {
    take(Fuse(image, rank, run_.devices.FusionEngine(device)));
  };
  const int fused = graph_.Add(run_.devices.FusionPool(device), kUrgent, after, fuse);
  for (int frame : frames) last_fused_[frame] = fused;
  return fused;
}

PointCloud RunTasks::Fuse(const ImagePlan& image, int rank, const DeviceEngine& engine) {
  const EngineProblem problem = InLocalCoordinates(run_.store.Problem(image, final_step_, engine), run_.plan.origin);
  PointCloud cloud =
      engine.engine->FuseView(problem.reference, problem.sources, run_.pipeline.fusion, rank, stamps_.get());
  MoveCloud(run_.scene.images[static_cast<size_t>(image.index)].placed_from_world, run_.plan.origin, &cloud);
  run_.interrupt.Check();
  run_.store.HasRead(image, final_step_);
  run_.progress.Step();
  return cloud;
}

int RunTasks::AddFileTask(const std::vector<int>& after, std::function<void()> work, bool urgent) {
  return graph_.Add(Devices::kFilePool, urgent ? kUrgent : 0, after, [work = std::move(work)](int) { work(); });
}

}  // namespace acmp
