#include "acmp_mapping/ros/keyframe_outputs.h"

#include <cmath>
#include <exception>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_sources.h"

namespace acmp {
namespace {

/// Pixels whose depth is published: not masked, and confident enough.
Image<unsigned char> MakeKeepMask(const KeyframeDepth& maps, double min_confidence) {
  Image<unsigned char> keep(maps.depth.width(), maps.depth.height(), 1);
  for (int row = 0; row < keep.height(); ++row) {
    for (int col = 0; col < keep.width(); ++col) {
      const bool used = maps.frame->mask.empty() || maps.frame->mask(col, row) != 0;
      const bool confident = maps.confidence.empty() || maps.confidence(col, row) >= min_confidence;
      keep(col, row) = used && confident ? 1 : 0;
    }
  }
  return keep;
}

/// Points that are not masked.
PointCloud KeptPoints(const KeyframeDepth& maps) {
  const ImageView<const unsigned char> mask = maps.frame->mask;
  if (mask.empty()) return maps.points_in_camera;
  const PinholeCamera& camera = maps.frame->camera;
  PointCloud kept;
  kept.reserve(maps.points_in_camera.size());
  for (const SurfacePoint& point : maps.points_in_camera) {
    const Eigen::Vector2d pixel = camera.Project({point.position.x, point.position.y, point.position.z});
    // Rounded as Contains does: -0.5 belongs to pixel 0.
    const int col = static_cast<int>(std::floor(pixel.x() + 0.5));
    const int row = static_cast<int>(std::floor(pixel.y() + 0.5));
    if (camera.Contains(pixel) && mask(col, row) == 0) continue;
    kept.push_back(point);
  }
  return kept;
}

double LatencyMs(const KeyframeOrigin& origin) { return (SteadySeconds() - origin.arrival_s) * 1e3; }

}  // namespace

DenseMapper::Callbacks KeyframeOutputs::MakeCallbacks() {
  DenseMapper::Callbacks callbacks;
  callbacks.on_fast = [this](const KeyframeDepthPtr& maps) { HandleFast(maps); };
  callbacks.on_refined = [this](const KeyframeDepthPtr& maps) { HandleRefined(maps); };
  callbacks.on_refined_again = [this](const KeyframeDepthPtr& maps) { HandleRefinedAgain(maps); };
  callbacks.on_withdrawn = [this](const KeyframeDepthPtr& maps, const std::string& message) {
    HandleWithdrawn(maps, message);
  };
  callbacks.wants_refined_again = [this] { return !stopping_ && !abandoned_ && hooks_.wants_refined_again(); };
  callbacks.on_drop = [this](const KeyframeDrop& drop) { HandleDrop(drop); };
  callbacks.on_problem = [this](const std::string& reason, const std::string& message) {
    ReportDrop({reason, message});
  };
  return callbacks;
}

void KeyframeOutputs::Add(int64_t id, Record record) {
  auto added = std::make_shared<const Record>(std::move(record));
  const std::lock_guard<std::mutex> lock(mutex_);
  pending_[id] = std::move(added);
}

void KeyframeOutputs::Trim(size_t kept) {
  const std::lock_guard<std::mutex> lock(mutex_);
  while (refined_.size() > kept) refined_.erase(refined_.begin());
}

OutputStatus KeyframeOutputs::status() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return status_;
}

KeyframeOutputs::RecordPtr KeyframeOutputs::FindRecord(const Records& records, int64_t id) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = records.find(id);
  return stopping_ || found == records.end() ? nullptr : found->second;
}

KeyframeOutput KeyframeOutputs::MakeOutput(const KeyframeDepthPtr& maps, const Record& record) const {
  KeyframeOutput output;
  output.origin = record.origin;
  output.run = record.run;
  output.maps = maps;
  output.keep = MakeKeepMask(*maps, min_depth_confidence_);
  output.points_in_camera = KeptPoints(*maps);
  return output;
}

std::optional<size_t> KeyframeOutputs::Publish(const std::function<void(const KeyframeOutput&)>& hook,
                                               const KeyframeDepthPtr& maps, const Record& record) const {
  try {
    const KeyframeOutput output = MakeOutput(maps, record);
    hook(output);
    return output.points_in_camera.size();
  } catch (const std::exception& error) {  // the mapper's callbacks must not throw
    ReportDrop({"publish_error", Concat("image ", FormatStamp(record.origin.stamp_ns), ": ", error.what())});
    return std::nullopt;
  }
}

void KeyframeOutputs::CountWithoutPoints(const KeyframeDepth& maps, const KeyframeOrigin& origin, size_t points) {
  OutputStatus now;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    status_.run_without_points = points > 0 ? 0 : status_.run_without_points + 1;
    status_.no_points_reason = "";
    if (points == 0) {
      status_.no_points_reason =
          maps.no_points_reason.value_or(Concat("all ", maps.points_in_camera.size(), " are masked"));
    }
    now = status_;
  }
  if (now.run_without_points < kRunWithoutPoints) return;
  ReportDrop({"no_points", Concat("the last ", now.run_without_points, " refined keyframes have no points; of image ",
                                  FormatStamp(origin.stamp_ns), " these checks remove them: ", now.no_points_reason)});
}

void KeyframeOutputs::HandleFast(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(pending_, maps->frame->id);
  if (!record) return;
  Publish(hooks_.on_fast, maps, *record);
  const std::lock_guard<std::mutex> lock(mutex_);
  ++status_.fast;
  status_.fast_latency.Add(LatencyMs(record->origin));
}

void KeyframeOutputs::HandleRefined(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(pending_, maps->frame->id);
  if (!record) return;
  {
    // First: what is published says how many images are still under way.
    const std::lock_guard<std::mutex> lock(mutex_);
    refined_.insert(pending_.extract(maps->frame->id));
    ++status_.refined;
    status_.times = maps->times;
    status_.consistency_ms = maps->consistency_ms;
    status_.pose_fit = maps->pose_fit;
    status_.pose_refined = maps->cam_from_world.matrix() != maps->frame->cam_from_world.matrix();
  }
  const std::optional<size_t> points = Publish(hooks_.on_refined, maps, *record);
  if (points) CountWithoutPoints(*maps, record->origin, *points);
  if (!maps->prior_depth_rejection.empty()) {
    ReportDrop({"unused_prior_depth", Concat("image ", FormatStamp(record->origin.stamp_ns),
                                             ": its prior depth is not used: ", maps->prior_depth_rejection)});
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  status_.refined_latency.Add(LatencyMs(record->origin));
}

/// For the map: each keyframe's depth and points are published once.
void KeyframeOutputs::HandleRefinedAgain(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(refined_, maps->frame->id);
  if (!record) return;
  Publish(hooks_.on_refined_again, maps, *record);
  const std::lock_guard<std::mutex> lock(mutex_);
  ++status_.refined_again;
}

/// Better points for the map: none.
void KeyframeOutputs::HandleWithdrawn(const KeyframeDepthPtr& maps, const std::string& message) {
  const RecordPtr record = FindRecord(refined_, maps->frame->id);
  if (!record) return;
  Publish(hooks_.on_refined_again, maps, *record);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++status_.withdrawn;
  }
  ReportDrop({"withdrawn", Concat("image ", FormatStamp(record->origin.stamp_ns), " leaves the map: ", message)});
}

void KeyframeOutputs::HandleDrop(const KeyframeDrop& drop) {
  const RecordPtr record = FindRecord(pending_, drop.id);
  if (record) {
    const std::lock_guard<std::mutex> lock(mutex_);
    pending_.erase(drop.id);
  }
  ReportDrop({drop.reason,
              Concat("image ", record ? FormatStamp(record->origin.stamp_ns) : "?",
                     drop.had_fast ? " (refinement only): " : ": ", drop.message),
              true});
}

void KeyframeOutputs::ReportDrop(const RejectedInput& drop) const {
  if (!stopping_) hooks_.on_drop(drop);
}

}  // namespace acmp
