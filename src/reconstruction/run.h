#pragma once

#include <map>
#include <mutex>
#include <set>
#include <string>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/common/timer.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/pipeline/depth_estimator.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "devices.h"
#include "engine_store.h"
#include "output_folder.h"
#include "plan.h"
#include "progress.h"

namespace acmp {

/// Wall time of this run in milliseconds, summed over images.
struct RunTimes {
  StageTimes stages;
  double run_ms = 0;  ///< the whole run, from the scene's files to the last one; not a sum
  int images = 0;     ///< whose steps are in here; fewer than all after an interruption
};

/// What all tasks of one run share. Everything outlives them.
struct ReconstructRun {
  Scene& scene;  ///< the online schedule puts refined poses into it
  const ReconstructOptions& options;
  ReconstructPlan& plan;
  const Devices& devices;
  FrameStore& frames;
  StopRequest& interrupt;
  Progress& progress;
  const OutputFolder* folder;  ///< null: results stay in memory
  EngineStore store = {&frames, options, folder ? folder->path() : std::filesystem::path(), plan, devices};
  const PipelineOptions pipeline = MakePipelineOptions(options);

  RunTimes times = {};
  std::map<int, std::string> prior_depth_rejections = {};  ///< why images' prior depth is not used, by scene index
  std::mutex mutex = {};                                   ///< of times and rejections
};

/// Camera of an image at the size of the run.
PinholeCamera CameraOf(const ReconstructRun& run, int index);

/// Feeds the images in the order of their index to a DenseMapper. Leaves final maps in the folder.
void RunOnlineSchedule(ReconstructRun* run);

/// Writes all results of a run whose results are files: of the offline schedule, whose missing steps are done
/// meanwhile, or of the final maps that the online one has left. Confidence, map files and pictures of every image that
/// gets a map; the cloud and the cameras. What earlier stages have written stays. Returns how many points there are.
size_t RunAndWriteResults(ReconstructRun* run);

/// Does what is missing before images have estimates of a step in files.
/// @param name of the stage, for the progress
/// @param images with a map, by scene index
/// @param maps also writes their map files and pictures; the step is then the final one
void RunStage(ReconstructRun* run, const std::string& name, int step, const std::set<int>& images, bool maps);

/// Writes a plan of stages to the output folder, and its tasks to the file options.plan:
/// {"complete": a finished run with the same settings and input is there, and nothing is to do,
///  "tasks": [{"stage": ..., "images": for --images, "after": numbers of the tasks that it waits for, from 0}, ...]}.
/// Throws InvalidInputError when the folder belongs to another plan.
/// @param frames gets the images without a map, which no stage may read: a damaged one is found now
void PlanStages(const Scene& scene, const ReconstructPlan& plan, const ReconstructOptions& options,
                const StopRequest& interrupt, FrameStore* frames, Progress* progress);

/// Writes the mesh of a finished run to options.mesh: of the maps in its folder, at the poses of its cameras.txt. A
/// line of what it is is a result. Throws InvalidInputError, ProcessingError or Interrupted.
/// @param origin of the coordinates that it is made in
/// @param frames for colours
void WriteSceneMesh(const ReconstructOptions& options, const Eigen::Vector3d& origin, const OutputFolder& folder,
                    const StopRequest& interrupt, FrameStore* frames, Progress* progress);

constexpr const char* kInputKey = "input (hash of images, masks, prior depth, cameras, poses, landmarks)";
constexpr const char* kDeviceKey = "device";

/// The options that decide the bits of the results, and which files there are.
RunRecord SettingsRecord(const ReconstructOptions& options);

/// Everything that does: the same with the input and the device.
/// @param device its name; empty: not known yet
RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash);

/// "NVIDIA H200 (cuda:0)" -> "NVIDIA H200": what decides the bits.
std::string DeviceModel(const std::string& device_name);

/// Says of a run that is there already that it is complete, and removes its work files. Throws ProcessingError where it
/// counts as failed.
/// @param prefix of the line
void ReportComplete(const OutputFolder& folder, const std::string& prefix, const ReconstructOptions& options,
                    Progress* progress);

/// What the number of points says of a run. Empty: nothing.
struct PointsJudgement {
  std::string warning;  ///< hardly any pixel became a point, or too few images have maps for any
  std::string failure;  ///< none did, though enough images have maps: the run counts as failed
};
PointsJudgement JudgePoints(const ReconstructRun& run, size_t points);

/// What neighbouring images say against the poses as given, and what fits: empty where they fit, or the images tell too
/// little. Takes some tenths of a second.
std::string DescribePoseDoubt(const Scene& scene, const ReconstructPlan& plan, FrameStore* frames);

/// A warning for each image that gets no map, with the reason.
void ReportImagesWithoutMap(const ReconstructPlan& plan, const Scene& scene, Progress* progress);

/// Of how many images the prior depth is not used, and why of one; empty: of none.
std::string DescribeUnusedPriorDepth(const ReconstructRun& run);

/// The list of files and the summary, which make the run complete. Throws ProcessingError where it counts as failed
/// though all is written.
/// @param device name of what computed it
/// @param timer of the whole run
void EndRun(ReconstructRun* run, const RunRecord& record, const std::string& device, const Timer& timer, size_t points);

}  // namespace acmp
