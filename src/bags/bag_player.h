#pragma once

#include <deque>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <rosbag/view.h>

#include "acmp_mapping/backend/make_depth_engine.h"
#include "acmp_mapping/bags/bag_check.h"
#include "acmp_mapping/intake/keyframe_gate.h"
#include "acmp_mapping/intake/reading_check.h"
#include "acmp_mapping/ros/diagnostics.h"
#include "acmp_mapping/ros/frame_preparation.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/tf_lookup.h"

namespace acmp {

/// The mapper without ROS: its inputs, tf, intake, gate, preparation of frames and checks take recorded messages at the
/// times at which they were recorded. The first keyframes are mapped, small and by the CPU, so that it shows which get
/// maps.
class BagPlayer {
 public:
  static constexpr uint64_t kTried = 16;  ///< keyframes that are mapped

  /// @param options outlive it
  /// @param remaps topics of the inputs by their names; others are where our launch files have them
  /// @param published types of what was recorded, by topic
  /// @param start_s when the recording begins
  /// @param trial_size px of the longer side of images that are mapped
  BagPlayer(const NodeOptions& options, const std::map<std::string, std::string>& remaps,
            std::map<std::string, std::string> published, double start_s, int trial_size);

  /// Of these topics the messages are taken.
  std::vector<std::string> Topics() const;
  /// All of a recording. Once.
  void Play(const rosbag::View& records);

  /// What diagnostics are made of, as it is at the end.
  MapperSnapshot Snapshot() const;
  /// What was told beside incidents.
  const std::vector<Finding>& told() const { return told_; }
  /// Of the images, for the poses as configured.
  const ReadingVerdict& verdict() const { return verdict_; }
  const KeyframeIntake& intake() const { return intake_; }
  uint64_t taken() const { return taken_; }  ///< images that were matched and could be read
  uint64_t tried() const { return tried_; }
  uint64_t mapped() const { return mapped_.size(); }  ///< of these

 private:
  InputSink MakeSink();
  bool IsPublished(const InputSource& source) const;
  DenseMapper::Callbacks MakeCallbacks();
  void Dispatch(IntakeEvent event);
  void TakeKeyframe(const KeyframeInput& input);
  void FindReading();
  void StartOver();
  void JudgeRigs();
  void Report(RejectedInput rejected);

  const NodeOptions& options_;
  const std::map<std::string, std::string> published_;
  const int trial_size_;
  double now_s_;
  IncidentLog incidents_;
  TfLookup tf_{[this](const std::string& text) { Report({"bad_tf", text}); }};
  KeyframeIntake intake_;
  InputSources sources_;
  FramePreparation preparation_;
  KeyframeGate gate_;
  ReadingCheck readings_;
  ReadingVerdict verdict_;
  DepthEngineBackend backend_ = MakeDepthEngine(Device::kCpu, 0);
  DenseMapper mapper_;
  uint64_t matched_ = 0, taken_ = 0, not_chosen_ = 0, tried_ = 0, next_reading_ = 10;
  std::set<int64_t> mapped_;  ///< ids of frames that have refined maps
  std::string rig_;
  std::vector<Finding> told_;
};

}  // namespace acmp
