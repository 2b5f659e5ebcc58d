// What the mapper's callbacks do, in its thread for outputs: maps are made ready and published.

#include <cmath>
#include <exception>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {
namespace {

/// Pixels whose depth is published: known to the lens and confident enough.
Image<unsigned char> MakeKeepMask(const KeyframeDepth& maps, const cv::Mat& valid, double min_confidence) {
  Image<unsigned char> keep(maps.depth.width(), maps.depth.height(), 1);
  for (int row = 0; row < keep.height(); ++row) {
    for (int col = 0; col < keep.width(); ++col) {
      const bool known = valid.empty() || valid.at<uchar>(row, col) != 0;
      const bool confident = maps.confidence.empty() || maps.confidence(col, row) >= min_confidence;
      keep(col, row) = known && confident ? 1 : 0;
    }
  }
  return keep;
}

PointCloud KeptPoints(const KeyframeDepth& maps, ImageView<const unsigned char> keep, double min_confidence) {
  const PinholeCamera& camera = maps.frame->camera;
  PointCloud kept;
  kept.reserve(maps.points_in_camera.size());
  for (const SurfacePoint& point : maps.points_in_camera) {
    if (point.confidence < min_confidence) continue;
    const Eigen::Vector2d pixel = camera.Project({point.position.x, point.position.y, point.position.z});
    // Rounded as Contains does: -0.5 belongs to pixel 0.
    const int col = static_cast<int>(std::floor(pixel.x() + 0.5));
    const int row = static_cast<int>(std::floor(pixel.y() + 0.5));
    if (camera.Contains(pixel) && !keep(col, row)) continue;
    kept.push_back(point);
  }
  return kept;
}

}  // namespace

MapperWorker::RecordPtr MapperWorker::FindRecord(const Records& records, int64_t id) const {
  const std::lock_guard<std::mutex> lock(records_mutex_);
  const auto found = records.find(id);
  return found == records.end() ? nullptr : found->second;
}

KeyframeOutput MapperWorker::MakeOutput(const KeyframeDepthPtr& maps, const Record& record) const {
  const double min_confidence = min_confidence_;
  KeyframeOutput output;
  output.origin = record.origin;
  output.run = record.run;
  output.maps = maps;
  output.keep = MakeKeepMask(*maps, record.valid, min_confidence);
  output.points_in_camera = KeptPoints(*maps, output.keep.View(), min_confidence);
  return output;
}

void MapperWorker::HandleFast(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(pending_, maps->frame->id);
  if (stopping_ || !record) return;
  Publish(hooks_.on_fast, MakeOutput(maps, *record));
  const double latency_ms = LatencyMs(*record);
  UpdateStatus([&](WorkerStatus* status) {
    ++status->fast;
    status->fast_latency.Add(latency_ms);
  });
}

void MapperWorker::HandleRefined(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(pending_, maps->frame->id);
  if (stopping_ || !record) return;
  Publish(hooks_.on_refined, MakeOutput(maps, *record));
  const double latency_ms = LatencyMs(*record);
  {
    const std::lock_guard<std::mutex> lock(records_mutex_);
    refined_.insert(pending_.extract(maps->frame->id));
  }
  UpdateStatus([&](WorkerStatus* status) {
    ++status->refined;
    status->refined_latency.Add(latency_ms);
    status->times = maps->times;
    status->consistency_ms = maps->consistency_ms;
  });
}

/// For the map: each keyframe's depth and points are published once.
void MapperWorker::HandleRefinedAgain(const KeyframeDepthPtr& maps) {
  const RecordPtr record = FindRecord(refined_, maps->frame->id);
  if (stopping_ || !record) return;
  Publish(hooks_.on_refined_again, MakeOutput(maps, *record));
  UpdateStatus([](WorkerStatus* status) { ++status->refined_again; });
}

double MapperWorker::LatencyMs(const Record& record) { return (SteadySeconds() - record.origin.arrival_s) * 1e3; }

void MapperWorker::Publish(const std::function<void(const KeyframeOutput&)>& hook, const KeyframeOutput& output) const {
  try {
    hook(output);
  } catch (const std::exception& error) {  // the mapper's callbacks must not throw
    ReportDrop({"publish_error", Concat("image ", FormatStamp(output.origin.stamp_ns), ": ", error.what())});
  }
}

void MapperWorker::HandleDrop(const KeyframeDrop& drop) {
  const RecordPtr record = FindRecord(pending_, drop.id);
  const std::string stamp = record ? FormatStamp(record->origin.stamp_ns) : "?";
  if (record) {
    const std::lock_guard<std::mutex> lock(records_mutex_);
    pending_.erase(drop.id);
  }
  ReportDrop({drop.reason, Concat("image ", stamp, drop.had_fast ? " (refinement only): " : ": ", drop.message), true});
}

}  // namespace acmp
