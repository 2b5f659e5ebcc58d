#include "run_end.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/output_file.h"
#include "summary.h"

namespace acmp {
namespace {

std::string DescribeFiles(const CloudSize& cloud) {
  if (!cloud.tiles) return "fused.ply";
  return Concat(*cloud.tiles, *cloud.tiles == 1 ? " tile" : " tiles");
}

}  // namespace

PointsJudgement JudgePoints(const ScheduleRun& run, size_t points) {
  constexpr double kHardlyAny = 0.01;
  constexpr char kCauses[] =
      ": poses, cameras (made for images of this size?) or the range of depths may be wrong, or images too small; "
      "confidence and cost show where";
  int64_t pixels = 0;
  int images = 0;
  for (const ImagePlan& image : run.plan.images) {
    if (!image.no_map.empty()) continue;
    const PinholeCamera camera = CameraOf(run, image.index);
    pixels += static_cast<int64_t>(camera.width) * camera.height;
    ++images;
  }
  const int views = MakePipelineOptions(run.options).fusion.min_consistent_views;
  if (images <= views) {
    if (points > 0) return {};
    return {Concat("no points: for one ", views, " source views must agree in this preset, and ", images,
                   " images have maps"),
            ""};
  }
  if (points == 0) return {"", Concat("none of the ", pixels, " pixels became a point", kCauses)};
  if (static_cast<double>(points) >= kHardlyAny * static_cast<double>(pixels)) return {};
  return {Concat("only ", points, " of ", pixels, " pixels became points", kCauses), ""};
}

void ReportUnusedPriorDepth(const ReconstructRun& run) {
  const std::map<int, std::string>& rejections = run.prior_depth_rejections;
  if (rejections.empty()) return;
  const auto& [index, reason] = *rejections.begin();
  run.progress.Warn(Concat("the prior depth of ", rejections.size(), " images is not used, for example of ",
                           run.scene.images[static_cast<size_t>(index)].name, ": ", reason));
}

std::string EndRun(ReconstructRun* run, const RunRecord& record, const std::string& device, const Timer& timer,
                   const CloudSize& cloud, std::ostream* out) {
  Timer sync;
  run->folder.WriteFileList();
  SyncFolder(run->folder.path());
  run->times.syncing_ms = sync.Lap();
  run->times.run_ms = timer.Elapsed();
  const PointsJudgement judgement = JudgePoints(*run, cloud.points);
  if (!judgement.warning.empty()) run->progress.Warn(judgement.warning);
  std::string failure = judgement.failure.empty() ? "" : Concat(run->folder.path().string(), ": ", judgement.failure);
  WriteFileAtomically(run->folder.SummaryFile(), FormatSummary(*run, record, device, cloud, failure),
                      Durability::kPowerCut);
  if (!run->options.keep_work) run->folder.RemoveWork();
  if (!run->options.quiet) {
    *out << run->folder.path().string() << ": " << cloud.points << " points in " << DescribeFiles(cloud) << "; took "
         << FormatDuration(run->times.run_ms / 1000) << " on " << device << std::endl;
  }
  if (run->options.timings) *out << FormatTimings(run->times) << std::flush;
  return failure;
}

}  // namespace acmp
