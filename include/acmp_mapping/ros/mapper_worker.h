#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/intake/keyframe_gate.h"
#include "acmp_mapping/mapping/auto_preset.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/frame_preparation.h"
#include "acmp_mapping/ros/keyframe_intake.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/output_publisher.h"
#include "acmp_mapping/ros/work_queue.h"

namespace acmp {

/// What the worker tells about itself.
struct WorkerStatus {
  bool ready = false;  ///< the backend exists
  bool on_cpu = false;
  std::string device_name;
  std::string fallback_reason;  ///< why device: auto took the CPU
  std::string device_error;     ///< why there is no backend at all
  std::string preset;           ///< of the options, as UsedPreset says
  uint64_t keyframes = 0;       ///< given to the mapper
  int width = 0, height = 0;    ///< matched size of the last keyframe, px
  double preparation_ms = 0;    ///< decoding and rectifying the last image
  double keyframe_ms = 0;       ///< the last keyframe in the matching thread, all in all
  std::string auto_preset;      ///< what preset: auto has chosen last and why; empty: nothing
  PoseChecks pose_checks;
  LeftOut left_out;
  std::string distortion;     ///< what the images say of the calibration's distortion; empty: nothing
  std::string camera_errors;  ///< of less distortion
  std::string rig;            ///< what the images say of where source cameras lie; empty: nothing
  OutputStatus outputs;
};

/// When inputs come.
class InputPace {
 public:
  /// @param now_s ascending, s
  void Add(double now_s);
  /// How long to wait before something is done that takes so long, so that it delays no input: 0 where it ends before
  /// the next one is due, else until that is clearly late.
  double WaitFor(double now_s, double takes_s) const;

 private:
  std::deque<double> newest_s_;
};

/// The one thread that matches: it makes the backend, prepares frames and drives the DenseMapper, which has threads of
/// its own for outputs and for poses. Hooks run in the worker's thread.
///
/// Locks: the queue's, that of the outputs and status_mutex_, each held for a moment and never together; mapper,
/// rectifier and window belong to the worker thread alone.
class MapperWorker {
 public:
  struct Hooks {
    std::function<void(const WorkerStatus&)> on_device;  ///< once, when the backend exists or cannot be made
    /// Of preset: auto, with what it says: first, before on_device, nothing.
    std::function<void(const AutoPreset&, const std::string&)> on_setting;
  };

  /// @param options outlive the worker, as `outputs` do
  /// @param fixed_mask of all images as sent; empty: none
  /// @param outputs publishes what the mapper makes, and tells of what is not used
  MapperWorker(const NodeOptions& node_options, const SharedOptions* options, Mask fixed_mask, OutputPublisher* outputs,
               Hooks hooks);
  /// Stops. Waits until the thread has ended.
  ~MapperWorker();
  MapperWorker(const MapperWorker&) = delete;
  MapperWorker& operator=(const MapperWorker&) = delete;

  /// Queues a posed image: where it may be dropped one that ~keyframe_mode takes, with overload: block any that fits
  /// into a quarter of the memory. Called by one thread at a time; does not wait.
  /// @param must_wait whatever overload says: nothing is lost that fits into memory
  void Push(KeyframeInput input, bool must_wait = false);

  /// Finishes all keyframes queued and pending: they have been published. Empty when done, else why not.
  std::string Flush();

  /// After all that is queued: finishes what is pending, then forgets the window. What comes later is another run.
  void StartOver();

  /// Forgets what is queued and the window. What comes later is another run. Empty when done, else why not.
  std::string Reset();

  /// Wakes all who wait and ends the thread soon, whatever it is at.
  void Stop();

  WorkerStatus status() const;
  /// Asks the images where source cameras lie: status().rig says it from then on, and an incident once. It may take
  /// some tenths of a second.
  /// @param at_end of RigCheck
  void JudgeRigs(bool at_end);
  size_t queued() const { return queue_.waiting_inputs(); }

 private:
  using Command = std::function<void()>;
  /// Whether ~keyframe_mode takes it. Asked before it is queued; with overload: block after all before it have been
  /// mapped, as the gate asks for the depth of these, and which images it takes must not depend on the timing.
  bool IsKeyframe(const KeyframeInput& input);
  void ResetGate();
  /// The mapper forgets what it has.
  void BeginRun();
  void Run();
  void MakeMapper();
  /// Gives the mapper the options of now. Better maps are for the map alone: without one it makes none.
  void UseOptions();
  void FlushMapper();
  void Process(const KeyframeInput& input);
  /// What `process` throws becomes a drop of this keyframe.
  void ProcessOrDrop(const KeyframeInput& input, void (MapperWorker::*process)(const KeyframeInput&));
  /// A keyframe that the mapper has no time for becomes a source view of others.
  void ProcessOvertaken(const KeyframeInput& input);
  /// After which time without work there is time to catch up; none: there is nothing to catch up with.
  std::optional<double> IdleWait() const;
  void CatchUp();
  /// Of preset: auto, after a keyframe that took so long.
  void ChooseSetting(double keyframe_ms);
  PreparationOptions HowToPrepare() const;
  /// Has the worker do `work` and waits for it. Empty when done, else why not.
  std::string RunCommand(bool urgent, const std::function<void()>& work);
  template <class Change>
  void UpdateStatus(const Change& change) {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    change(&status_);
  }

  const NodeOptions node_options_;
  const SharedOptions* const options_;
  OutputPublisher* const outputs_;
  const Hooks hooks_;
  FramePreparation preparation_;  ///< the worker's, but for its rigs
  StopRequest stop_;              ///< what the mapper is at shall end soon: a reset or the end waits for it
  WorkQueue<KeyframeInput, Command> queue_;

  mutable std::mutex status_mutex_;
  WorkerStatus status_;
  std::deque<int64_t> newest_stamps_ns_;  ///< of keyframes that were queued, also of those that get no maps
  InputPace pace_;                        ///< of the same
  KeyframeGate gate_;
  double scene_depth_ = 0;  ///< that the mapper knows; 0: none

  // Used by the worker thread alone.
  std::unique_ptr<DepthEngine> engine_;
  std::unique_ptr<DepthEngine> output_engine_;
  std::unique_ptr<DenseMapper> mapper_;
  std::string device_error_;
  std::optional<AutoPreset> auto_preset_;
  bool may_catch_up_ = false;  ///< something may have been put off
  double catch_up_s_ = 0.01;   ///< the longest that one thing of it has taken lately
  uint64_t run_ = 0;

  std::thread thread_;  // last: it starts when everything above exists
};

}  // namespace acmp
