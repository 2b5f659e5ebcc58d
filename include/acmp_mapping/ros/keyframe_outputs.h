#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/latency_window.h"

namespace acmp {

/// A keyframe's maps ready to be published.
struct KeyframeOutput {
  KeyframeOrigin origin;
  uint64_t run = 0;  ///< another number since the last jump of time or reset
  KeyframeDepthPtr maps;
  Image<unsigned char> keep;    ///< 1 where depth is to be published
  PointCloud points_in_camera;  ///< of maps->cam_from_world
};

/// What has been made of the keyframes.
struct OutputStatus {
  uint64_t fast = 0;
  uint64_t refined = 0;
  uint64_t refined_again = 0;
  uint64_t withdrawn = 0;  ///< refined ones whose points left the map, as poses contradict the images
  StageTimes times;        ///< of the last refined keyframe
  double consistency_ms = 0;
  PoseFit pose_fit;                             ///< of the last refined keyframe
  bool pose_refined = false;                    ///< and whether it was matched with another pose than received
  uint64_t run_without_points = 0;              ///< the newest refined keyframes, so many, have no points ...
  std::string no_points_reason;                 ///< ... and which check removes those of the last one
  LatencyWindow fast_latency, refined_latency;  ///< from the image's callback until its map was published
};

/// Makes what a DenseMapper's callbacks bring ready to be published: remembers where each keyframe came from, leaves
/// out what is not to be published, and counts. Maps come in the mapper's thread for outputs, drops in any; no hook
/// begins once Stop has been called.
///
/// One mutex guards the records and the status, and is held for a moment only, never while a hook runs.
class KeyframeOutputs {
 public:
  static constexpr uint64_t kRunWithoutPoints = 3;  ///< refined keyframes without points that are worth a word

  struct Hooks {
    // One at a time. What they throw goes to on_drop.
    std::function<void(const KeyframeOutput&)> on_fast;
    std::function<void(const KeyframeOutput&)> on_refined;
    std::function<void(const KeyframeOutput&)> on_refined_again;  ///< better maps of a keyframe that had its on_refined
    // These two from several threads at the same time: the mapper's, that for outputs, that of MapperWorker::Push.
    std::function<bool()> wants_refined_again;  ///< whether anybody would use them
    std::function<void(const RejectedInput&)> on_drop;
  };

  /// What is known of a keyframe beside its frame.
  struct Record {
    KeyframeOrigin origin;
    uint64_t run = 0;
  };

  explicit KeyframeOutputs(Hooks hooks) : hooks_(std::move(hooks)) {}

  /// For a mapper, which this must outlive.
  DenseMapper::Callbacks MakeCallbacks();

  /// Before the mapper gets the keyframe.
  void Add(int64_t id, Record record);
  /// Forgets finished keyframes but for the newest ones, so many.
  void Trim(size_t kept);
  /// Depth and points below are left out, 0..1.
  void set_min_depth_confidence(double confidence) { min_depth_confidence_ = confidence; }

  /// Tells the hook of an input that was not used.
  void ReportDrop(const RejectedInput& drop) const;
  void Stop() { stopping_ = true; }
  /// While set nobody wants better maps: a flush ends soon.
  void set_abandoned(bool abandoned) { abandoned_ = abandoned; }
  bool is_stopping() const { return stopping_; }

  OutputStatus status() const;

 private:
  using RecordPtr = std::shared_ptr<const Record>;
  using Records = std::map<int64_t, RecordPtr>;

  /// Null: none, or the hooks are to be silent.
  RecordPtr FindRecord(const Records& records, int64_t id) const;
  KeyframeOutput MakeOutput(const KeyframeDepthPtr& maps, const Record& record) const;
  /// How many points there were to publish; none when the hook threw.
  std::optional<size_t> Publish(const std::function<void(const KeyframeOutput&)>& hook, const KeyframeDepthPtr& maps,
                                const Record& record) const;
  /// Counts refined keyframes without points, and tells of a run of kRunWithoutPoints.
  void CountWithoutPoints(const KeyframeDepth& maps, const KeyframeOrigin& origin, size_t points);
  void HandleFast(const KeyframeDepthPtr& maps);
  void HandleRefined(const KeyframeDepthPtr& maps);
  void HandleRefinedAgain(const KeyframeDepthPtr& maps);
  void HandleWithdrawn(const KeyframeDepthPtr& maps, const std::string& message);
  void HandleDrop(const KeyframeDrop& drop);

  const Hooks hooks_;
  std::atomic<bool> stopping_{false}, abandoned_{false};
  std::atomic<double> min_depth_confidence_{0};
  mutable std::mutex mutex_;  ///< guards all below
  Records pending_;           ///< from Add to the keyframe's end
  Records refined_;           ///< that may be refined again: the mapper's window, and what has left it on its way out
  OutputStatus status_;
};

}  // namespace acmp
