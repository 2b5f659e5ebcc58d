#pragma once

#include <map>
#include <string>
#include <vector>

#include <diagnostic_updater/diagnostic_updater.h>

#include "acmp_mapping/intake/input_matcher.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {

/// Everything diagnostics are made of, taken at one moment.
struct MapperSnapshot {
  double now_s = 0;  ///< the clock of all the times below
  bool paused = false;
  std::vector<InputStatus> inputs;
  size_t waiting_images = 0;
  std::string waiting_for;  ///< what images wait for in vain; empty = all is well
  size_t queued = 0;
  uint64_t images_dropped = 0;  ///< drops that ended an image
  uint64_t matched = 0;         ///< keyframes handed to the worker
  uint64_t not_chosen = 0;      ///< posed images that the keyframe gate passed over
  std::optional<PoseGap> last_gap;
  double sync_tolerance_s = 0;
  std::optional<double> points_in_front;  ///< share of the first keyframes' sparse points, 0..1
  std::string convention_warning;         ///< why poses are probably read wrongly; empty: they are not
  WorkerStatus worker;
  uint32_t maps = 0;         ///< nodes that listen to keyframe_points
  uint64_t points_sent = 0;  ///< messages sent to them
  std::map<std::string, IncidentLog::Entry> drops;
};

/// Images that were received and have had no end yet: they wait for a pose, for the worker or for later keyframes.
uint64_t ImagesUnderWay(const MapperSnapshot& snapshot);

/// Every image that came is in one of these: "112 received = 90 refined + 12 dropped + 6 passed over + 4 under way".
std::string AccountForImages(const MapperSnapshot& snapshot);

/// For the log and the status: a sentence about PoseChecks::stamp_offset_s.
/// Where images show clearly more radial distortion than their calibration tells; empty: they do not.
/// @param shift_px PoseChecks::distortion_px
/// @param width of the images, px
std::string DescribeDistortion(double shift_px, int width, const LensDistortion& told);

std::string DescribeStampOffset(double offset_s);

/// For the log: the required inputs that never came or fell silent while others go on, and what images wait for in
/// vain. Empty: nothing, also when all have fallen silent, as after a recording, and while paused.
std::string DescribeMissing(const MapperSnapshot& snapshot);

/// One status each, without a master: "inputs", "matching", "mapping".
void DescribeInputs(const MapperSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);
void DescribeMatching(const MapperSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);
void DescribeMapping(const MapperSnapshot& snapshot, diagnostic_updater::DiagnosticStatusWrapper* status);

}  // namespace acmp
