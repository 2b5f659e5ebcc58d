#include "acmp_mapping/ros/diagnostics.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;

constexpr double kSilentS = 5;      ///< a stream that was silent so long is worth a word
constexpr double kRecentDropS = 5;  ///< drops and incidents that young are worth a word

long WholeSeconds(double seconds) { return std::lround(std::max(0.0, seconds)); }

bool IsSilent(const InputStatus& input, double now_s) {
  return input.received == 0 || now_s - input.last_received_s >= kSilentS;
}

/// Empty when messages arrive.
std::string DescribeSilence(const InputStatus& input, double now_s) {
  if (!IsSilent(input, now_s)) return "";
  const double silent_s = now_s - input.last_received_s;
  std::string publishers = Concat(input.publishers, " publisher(s)");
  if (input.publishers == 0 && input.received == 0) publishers = "nobody publishes it: check the remap";
  if (!input.advice.empty()) publishers = input.advice;
  if (input.publishers == 0 && input.received > 0) {
    publishers = Concat("after ", input.received,
                        " messages nobody publishes it any more: a recording has ended, or the "
                        "node that sent them");
  }
  return Concat(input.received == 0 ? "nothing yet on " : "nothing on ", input.topic, " for ", WholeSeconds(silent_s),
                " s (", publishers, ")");
}

std::string DescribeLatency(const LatencyWindow& latency) {
  const LatencyWindow::Quantiles quantiles = latency.quantiles();
  if (quantiles.count == 0) return "none yet";
  return Concat("median ", quantiles.median_ms, ", 99 % ", quantiles.p99_ms, ", greatest ", quantiles.max_ms,
                " of the last ", std::min(quantiles.count, LatencyWindow::kCapacity));
}

/// Where no image has become a map and none is to come; empty: some have, or may.
std::string DescribeAllDropped(const MapperSnapshot& snapshot) {
  if (snapshot.images_dropped == 0 || snapshot.worker.outputs.refined > 0 || ImagesUnderWay(snapshot) > 0) return "";
  const auto most = std::max_element(snapshot.drops.begin(), snapshot.drops.end(),
                                     [](const auto& a, const auto& b) { return a.second.count < b.second.count; });
  std::string text = Concat("all ", snapshot.images_dropped, " images were dropped");
  if (most != snapshot.drops.end()) {
    text += Concat(", most of them: ", most->first, " (", most->second.last_message, ")");
  }
  return text;
}

std::string PoseTopic(const MapperSnapshot& snapshot) {
  for (const InputStatus& input : snapshot.inputs) {
    if (input.kind == InputStatus::Kind::kPose) return input.topic;
  }
  return "";
}

}  // namespace

void AddIntake(const KeyframeIntake& intake, MapperSnapshot* snapshot) {
  snapshot->waiting_images = intake.waiting_images();
  snapshot->waiting_for = intake.DescribeWait(snapshot->now_s);
  snapshot->last_gap = intake.last_gap();
  snapshot->pose_use = intake.pose_use();
  snapshot->points_in_front = intake.share_in_front();
  snapshot->convention_warning = intake.convention_warning();
}

uint64_t ImagesUnderWay(const MapperSnapshot& snapshot) {
  const uint64_t received = ImagesReceived(snapshot.inputs);
  const uint64_t finished = snapshot.worker.outputs.refined + snapshot.images_dropped + snapshot.not_chosen;
  return received > finished ? received - finished : 0;  // the numbers are not of one moment
}

std::string AccountForImages(const MapperSnapshot& snapshot) {
  return Concat(ImagesReceived(snapshot.inputs), " received = ", snapshot.worker.outputs.refined, " refined + ",
                snapshot.images_dropped, " dropped + ", snapshot.not_chosen, " passed over + ",
                ImagesUnderWay(snapshot), " under way");
}

std::string DescribeDrops(const MapperSnapshot& snapshot) {
  std::vector<std::pair<uint64_t, std::string>> drops;
  for (const auto& [reason, entry] : snapshot.drops) {
    if (entry.images > 0) drops.emplace_back(entry.images, reason);
  }
  std::sort(drops.rbegin(), drops.rend());
  std::string text;
  for (const auto& [images, reason] : drops) text += Concat(text.empty() ? " (dropped: " : ", ", images, " ", reason);
  return text.empty() ? "" : text + ")";
}

std::string DescribeDistortion(double shift_px, int width, const LensDistortion& told) {
  constexpr double kClear = 0.01;  // of the width; a good calibration leaves a tenth of that
  if (std::abs(shift_px) < kClear * width) return "";
  return Concat(
      "the images show radial distortion that their calibration does not tell: near their corners pixels are ",
      std::round(std::abs(shift_px) * 10) / 10, " px of ", width, " too far ", shift_px < 0 ? "in" : "out", "; ",
      told.model == LensDistortion::Model::kNone
          ? "it has no distortion coefficients (D of camera_info): give those of the lens"
          : "calibrate again, or are the images rectified already (~rectified)?");
}

std::string DescribeCameraErrors(const CameraErrors& errors, const CameraCalibration& calibration) {
  constexpr double kClear = 0.001;  // of the width, at the corner: half a pixel of 540
  const int width = calibration.camera.width;
  const double corner_px = DistortionShift(calibration.camera, errors, 1);
  if (std::abs(corner_px) < kClear * width) return "";
  std::string coefficients;
  try {
    for (double value : WithRadialDistortion(calibration.MakeLens(), errors.k1, errors.k2).coefficients) {
      coefficients += Concat(coefficients.empty() ? "" : ", ", std::round(value * 1e6) / 1e6 + 0.0);  // never "-0"
    }
  } catch (const InvalidInputError&) {
    return "";  // no lens of this model has it
  }
  return Concat("the calibration leaves radial distortion of ", std::round(corner_px * 10) / 10, " px of ", width,
                " at the corners (and rows are read out in ", std::lround(errors.readout * 1e3),
                " ms): depth gets better with the distortion coefficients [", coefficients,
                calibration.distortion.model == LensDistortion::Model::kNone ? "] of a plumb_bob" : "]",
                " in calibration_file");
}

std::string DescribeStampOffset(double offset_s) {
  return Concat("the images were taken ", std::lround(std::abs(offset_s) * 1e3), " ms ",
                offset_s > 0 ? "before" : "after",
                " the poses of the same stamps: correct the stamps of the camera or of the poses");
}

void DescribeInputs(const MapperSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  status->summary(DiagnosticStatus::OK, "all inputs arrive");
  for (const InputStatus& input : snapshot.inputs) {
    const std::string silence = DescribeSilence(input, snapshot.now_s);
    status->add(input.topic, Concat(input.received, " received", silence.empty() ? "" : ": ", silence));
    if (!silence.empty() && (input.is_wanted() || !input.advice.empty()))
      status->mergeSummary(DiagnosticStatus::WARN, silence);
  }
  if (snapshot.paused) status->mergeSummary(DiagnosticStatus::WARN, "paused (~pause)");
}

std::string DescribeMissing(const MapperSnapshot& snapshot) {
  if (snapshot.paused) return "";
  const auto sends = [&](const InputStatus& input) { return input.required && !IsSilent(input, snapshot.now_s); };
  const bool some_send = std::any_of(snapshot.inputs.begin(), snapshot.inputs.end(), sends);
  std::string text;
  const auto add = [&](const std::string& sentence) { text += (text.empty() ? "" : "; ") + sentence; };
  for (const InputStatus& input : snapshot.inputs) {
    if (!(input.is_wanted() || !input.advice.empty()) || !IsSilent(input, snapshot.now_s)) continue;
    if (snapshot.now_s - input.last_received_s < kSilentS) continue;  // it has just begun to wait
    if (input.received == 0 || some_send) add(DescribeSilence(input, snapshot.now_s));
  }
  if (!snapshot.waiting_for.empty()) add(Concat(snapshot.waiting_images, " images wait: ", snapshot.waiting_for));
  return text;
}

void DescribeMatching(const MapperSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  status->summary(DiagnosticStatus::OK, Concat(snapshot.matched, " images matched with a pose"));
  const IncidentLog::Entry* latest = nullptr;
  std::string latest_reason;
  for (const auto& [reason, entry] : snapshot.drops) {
    status->add("dropped: " + reason, Concat(entry.count, " (", entry.last_message, ")"));
    // Frontends that give poses to keyframes only leave most images without one.
    const bool usual = reason == "no_pose" && snapshot.matched > 0;
    if (usual || snapshot.now_s - entry.last_time_s > kRecentDropS) continue;
    if (latest && latest->last_time_s >= entry.last_time_s) continue;
    latest = &entry;
    latest_reason = reason;
  }
  if (latest) status->summary(DiagnosticStatus::WARN, Concat(latest_reason, ": ", latest->last_message));

  if (!snapshot.waiting_for.empty()) {
    status->summary(DiagnosticStatus::WARN, Concat(snapshot.waiting_images, " images wait: ", snapshot.waiting_for));
  }
  if (const std::string lost = DescribeAllDropped(snapshot); !latest && !lost.empty()) {
    status->summary(DiagnosticStatus::WARN, lost);
  }

  status->add("images", AccountForImages(snapshot));
  status->add("images waiting for a pose", snapshot.waiting_images);
  status->add("posed images passed over by the keyframe gate", snapshot.not_chosen);
  const PoseUse& use = snapshot.pose_use;
  if (use.between + use.nearest > 0) {
    status->add(
        "stamps of images and poses",
        Concat(use.same, " images have a pose of their stamp, ", use.between, " one between two poses, ", use.nearest,
               " the nearest; the nearest pose was up to ", static_cast<double>(use.farthest_ns) * 1e-6, " ms away",
               use.nearest > 0 ? "; ~sync_tolerance as long as the time between poses has them interpolated" : ""));
  }
  if (!snapshot.last_gap) return;
  const PoseGap& gap = *snapshot.last_gap;
  const std::string topic = PoseTopic(snapshot);
  std::string nearest = gap.problem.empty() ? Concat("no pose on ", topic) : gap.problem;
  if (gap.gap_ns) nearest = Concat("nearest is ", static_cast<double>(*gap.gap_ns) * 1e-6, " ms away on ", topic);
  status->add("last image without a pose", Concat(FormatStamp(gap.image_stamp_ns), ": ", nearest,
                                                  "; ~sync_tolerance is ", snapshot.sync_tolerance_s * 1e3, " ms"));
}

namespace {

/// Where poses are right a few tenths of a pixel remain; passes take 2 px for agreement between maps.
constexpr double kPoorFit_px = 1.0;

void DescribePoseFit(const OutputStatus& outputs, DiagnosticStatusWrapper* status) {
  const PoseFit& fit = outputs.pose_fit;
  if (fit.matches == 0) return;
  status->add("poses are refined", outputs.pose_refined ? "yes" : "no, received ones fit or there are few matches");
  std::string by_gap;
  for (const GapFit& gap : fit.by_gap) by_gap += Concat("; ", gap.gap, " to ", gap.last_gap, " apart: ", gap.median_px);
  status->add("poses fit the images to [px]",
              Concat(fit.median_px, " (median of ", fit.matches, " matches", by_gap, ")"));
  if (fit.median_px <= kPoorFit_px) return;
  status->mergeSummary(
      DiagnosticStatus::WARN,
      Concat("poses fit the images to ", fit.median_px,
             " px only, walls will be missing: check calibration, rolling shutter and stamps, or tracking is lost"));
}

void DescribePoseChecks(const PoseChecks& checks, DiagnosticStatusWrapper* status) {
  if (checks.contradiction) {
    status->add("poses contradict the images by [% of the depth]", 100 * *checks.contradiction);
  }
  if (!checks.stamp_offset_s) return;
  status->add("images are older than poses of the same stamps by [ms]", 1e3 * *checks.stamp_offset_s);
  status->mergeSummary(DiagnosticStatus::WARN, DescribeStampOffset(*checks.stamp_offset_s));
}

/// What was left out so that keyframes do not wait.
void DescribeLeftOut(const LeftOut& left_out, DiagnosticStatusWrapper* status) {
  status->add("left out for lack of time: keyframes whose pose was not refined", left_out.poses);
  status->add("left out for lack of time: keyframes that were not refined again", left_out.second_turns);
}

void DescribeRunWithoutPoints(const OutputStatus& outputs, DiagnosticStatusWrapper* status) {
  status->add("newest refined keyframes without points", outputs.run_without_points);
  if (outputs.run_without_points == 0) return;
  status->add("checks that remove the points of the last one", outputs.no_points_reason);
  const std::string text = outputs.DescribeRunWithoutPoints();
  if (!text.empty()) status->mergeSummary(DiagnosticStatus::WARN, text);
}

}  // namespace

void DescribeMapping(const MapperSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  const WorkerStatus& worker = snapshot.worker;
  if (!worker.device_error.empty()) {
    status->summary(DiagnosticStatus::ERROR, "no device to match on: " + worker.device_error);
  } else if (!worker.ready) {
    status->summary(DiagnosticStatus::OK, "the device is being set up");
  } else {
    status->summary(DiagnosticStatus::OK, "mapping on " + worker.device_name);
    if (!worker.fallback_reason.empty()) status->add("why not on a GPU", worker.fallback_reason);
  }
  status->add("device", worker.device_name);
  if (!worker.outputs.pixels.empty()) status->add("pixels of the last refined keyframe", worker.outputs.pixels);
  status->add("keyframes", worker.keyframes);
  status->add("fast depth maps", worker.outputs.fast);
  status->add("refined depth maps", worker.outputs.refined);
  status->add("refined again for the map", worker.outputs.refined_again);
  status->add("withdrawn from the map, since poses contradict the images", worker.outputs.withdrawn);
  status->add("maps that get its points", snapshot.maps);
  status->add("messages sent to them", snapshot.points_sent);
  status->add("keyframes queued", snapshot.queued);
  status->add("matched size [px]", Concat(worker.width, "x", worker.height));
  status->add("last keyframe: decode and rectify [ms]", worker.preparation_ms);
  status->add("last keyframe: all in all [ms]", worker.keyframe_ms);
  if (!worker.auto_preset.empty()) status->add("preset auto", worker.auto_preset);
  status->add("latency of fast depth maps [ms]", DescribeLatency(worker.outputs.fast_latency));
  status->add("latency of refined depth maps [ms]", DescribeLatency(worker.outputs.refined_latency));
  status->add("photometric pass [ms]", worker.outputs.times.photometric_ms);
  status->add("prior construction [ms]", worker.outputs.times.prior_construction_ms);
  status->add("planar-prior pass [ms]", worker.outputs.times.planar_prior_ms);
  status->add("geometric passes [ms]", worker.outputs.times.geometric_ms);
  status->add("completion [ms]", worker.outputs.times.fill_ms);
  status->add("of these in kernels [ms]", worker.outputs.times.kernels_ms);
  status->add("consistency check [ms]", worker.outputs.consistency_ms);
  DescribeLeftOut(worker.left_out, status);
  DescribePoseFit(worker.outputs, status);
  DescribePoseChecks(worker.pose_checks, status);
  if (!worker.distortion.empty()) status->mergeSummary(DiagnosticStatus::WARN, worker.distortion);
  if (!worker.camera_errors.empty()) status->add("camera", worker.camera_errors);
  if (!worker.rig.empty()) status->mergeSummary(DiagnosticStatus::WARN, worker.rig);
  DescribeRunWithoutPoints(worker.outputs, status);
  if (!snapshot.points_in_front) return;
  status->add("sparse points in front of the first cameras [%]", 100 * *snapshot.points_in_front);
  if (!snapshot.convention_warning.empty()) status->mergeSummary(DiagnosticStatus::WARN, snapshot.convention_warning);
}

std::string DescribeMissing(const std::map<std::string, MapperTraffic>& mappers) {
  std::string text;
  for (const auto& [name, mapper] : mappers) {
    if (mapper.lost > 0) {
      text += Concat("; ", mapper.lost, " messages with points of ", name,
                     " were lost on the way, as the map server did not read them in time or the connection was cut");
    }
    if (mapper.images_under_way == 0) continue;
    text += Concat("; ", mapper.images_under_way, " images were still under way in ", name,
                   " when its last points came: its service flush finishes them, if it has not since");
  }
  return text;
}

namespace {

void DescribeMesh(const MapSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  constexpr double kLongS = 5;
  const LiveMeshStatistics& mesh = snapshot.mesh;
  if (snapshot.mesh_listeners == 0) return status->add("mesh", "nobody listens: nothing is computed");
  status->add("mesh", Concat(mesh.triangles, " triangles of ", mesh.keyframes, " keyframes in ", mesh.blocks,
                             " blocks, voxels of ", mesh.voxel_size, " take ", mesh.bytes / 1000000, " MB"));
  status->add("mesh: keyframes that are not in it yet", mesh.keyframes_to_add);
  status->add("mesh: blocks that have changed and wait to be published", mesh.to_tell);
  status->add("mesh: blocks to be made again, as their keyframes have changed", mesh.to_make_again);
  if (mesh.longest_wait_s < kLongS) return;
  status->mergeSummary(DiagnosticStatus::WARN,
                       Concat("the mesh is ", std::lround(mesh.longest_wait_s), " s behind: ~mesh_rate, ~mesh_time or ",
                              "the processors allow no more"));
}

}  // namespace

void DescribeMap(const MapSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  const MapStatistics& map = snapshot.map;
  status->summary(DiagnosticStatus::OK, Concat(map.keyframes, " keyframes in the map"));
  status->add("keyframes", map.keyframes);
  status->add("points held", map.points);
  status->add("keyframes that got better points", map.replaced);
  status->add("better points of keyframes that were not in the map", map.not_replaced);
  status->add("keyframes evicted (~max_keyframes)", map.evicted);
  status->add("keyframes evicted (~map_radius)", map.evicted_by_radius);
  status->add("points that later keyframes looked through", map.looked_through);
  status->add("keyframes that have yet to look through the points of others", map.yet_to_look);
  status->add("keyframes that were evicted before they looked", map.never_looked);
  status->add("keyframes evicted (~on_time_jump)", map.evicted_by_run);
  status->add("images kept (~keep_images of the mappers)",
              Concat(map.images, ", ", map.image_bytes / 1000000, " MB",
                     map.image_stride > 1 ? Concat("; of one image in ", map.image_stride,
                                                   ", as they would take over half of the free disk")
                                          : ""));
  status->add("voxel size [unit of the poses]", map.voxel_size);
  status->add("optimized paths", Concat(map.paths, " received on ", snapshot.optimized_path_topic, " (",
                                        snapshot.optimized_path_publishers, " publisher(s))"));
  if (snapshot.optimized_path_is_named && snapshot.optimized_path_publishers == 0 && map.paths == 0 &&
      map.keyframes > 0) {
    status->mergeSummary(DiagnosticStatus::WARN, Concat("nobody publishes ", snapshot.optimized_path_topic,
                                                        " (optimized_path): the map follows no loop closures"));
  }
  status->add("loop corrections (paths that moved keyframes)", map.corrections);
  status->add("keyframes re-posed, all corrections together", map.reposed);
  status->add("scales of keyframes by optimized paths", Concat(map.smallest_scale, " to ", map.largest_scale));
  status->add("poses of the last optimized path without a keyframe",
              Concat(map.path_unmatched, " of ", map.path_poses));
  status->add("keyframes that the last optimized path would put too far away", map.path_too_far);
  if (map.path_too_far > 0) {
    status->mergeSummary(
        DiagnosticStatus::WARN,
        Concat(map.path_too_far, " keyframes stay where they are: by the last optimized path they ",
               "would go farther than ", kMaxMapVoxels, " voxels of size ", map.voxel_size, " from the origin"));
  }
  DescribeMesh(snapshot, status);
  for (const auto& [reason, entry] : snapshot.incidents) {
    const std::string text = Concat(entry.count, " (", entry.last_message, ")");
    status->add("incident: " + reason, text);
    if (snapshot.now_s - entry.last_time_s <= kRecentDropS) status->mergeSummary(DiagnosticStatus::WARN, text);
  }
}

void DescribeMappers(const MapSnapshot& snapshot, DiagnosticStatusWrapper* status) {
  status->summary(DiagnosticStatus::OK, Concat("keyframes of ", snapshot.mappers.size(), " mapper(s)"));
  status->add("publishers of " + snapshot.keyframe_topic, snapshot.keyframe_publishers);
  if (snapshot.keyframe_publishers == 0) {
    status->mergeSummary(DiagnosticStatus::WARN,
                         Concat("nobody publishes ", snapshot.keyframe_topic, ": is a mapper running?"));
  }
  for (const auto& [name, mapper] : snapshot.mappers) {
    const long silent_s = std::lround(std::max(0.0, snapshot.now_s - mapper.last_received_s));
    status->add(name, Concat(mapper.received, " messages, the last ", silent_s, " s ago; ", mapper.lost,
                             " lost; images under way then: ", mapper.images_under_way));
  }
}

}  // namespace acmp
