#pragma once

#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "acmp_mapping/pipeline/dense_mapper.h"

namespace acmp {

/// An estimate that is there, or on its way from another shard.
struct EstimateSlot {
  EngineEstimatePtr estimate;  ///< null: none, or none yet
  bool settled = false;        ///< it is there or will never be

  void Settle(EngineEstimatePtr made) {
    estimate = std::move(made);
    settled = true;
  }
};
using EstimateSlotPtr = std::shared_ptr<EstimateSlot>;

/// What somebody reads of a keyframe, as it stood when the reader's turn came.
struct EstimateReading {
  EstimateStage stage = EstimateStage::kFast;
  EstimateSlotPtr slot;      ///< null: no estimate
  EstimateSlotPtr fallback;  ///< the fast one, which stands in for a refinement that failed; or null

  bool IsSettled() const {
    if (!slot || slot->estimate) return true;
    return slot->settled && (!fallback || fallback->settled);
  }
  EngineEstimatePtr Estimate() const {
    if (!slot || slot->estimate || !fallback) return slot ? slot->estimate : nullptr;
    return fallback->estimate;
  }
};

/// One keyframe of the window. A finished one stays as a source view of others until it is evicted, and then for those
/// refinements that wait and read it.
struct WindowKeyframe {
  enum class State {
    kPending,    ///< waits for source views
    kFast,       ///< the initial estimate is made (by another shard: is on its way), waits for later keyframes
    kScheduled,  ///< its refinement is made or has its place in the order of all, or the keyframe was dropped
  };
  FramePtr frame;
  DepthRange range;
  int shard = 0;  ///< whose it is
  State state = State::kPending;
  EngineImagePtr image;             ///< null until the keyframe is first used as reference or source view
  int image_levels = 0;             ///< levels it was loaded with
  std::optional<StageTimes> times;  ///< of the initial estimates, when they are made here

  /// What a refinement reads whose turn in the order of all keyframes is now; none: no estimate.
  std::optional<EstimateStage> stage;
  /// Refined before enough later keyframes had come to see what it sees. Geometric passes of others then go on reading
  /// its fast estimate, and `refined` is as the last pass left it, before completion.
  bool few_later = false;
  EstimateSlotPtr fast = std::make_shared<EstimateSlot>();  ///< the latest
  EstimateSlotPtr refined = std::make_shared<EstimateSlot>();
  int version = 0;                    ///< of `fast`: how often the keyframe has been estimated anew
  std::optional<double> views_score;  ///< sum over the source views of `fast`; none before they were chosen

  EstimateReading Read(std::optional<EstimateStage> read) const {
    if (!read) return {};
    if (*read == EstimateStage::kFast) return {*read, fast, nullptr};
    return {*read, refined, fast};
  }
  EstimateReading ReadInPasses() const { return Read(few_later ? EstimateStage::kFast : stage); }

  /// From now on others read a new fast estimate. Those whose turn came before go on with what they hold.
  void BeginNewFast() {
    if (!fast->settled) other_fast[version] = fast;
    ++version;
    const auto early = other_fast.find(version);
    fast = early == other_fast.end() ? std::make_shared<EstimateSlot>() : early->second;
    if (early != other_fast.end()) other_fast.erase(early);
    stage = EstimateStage::kFast;
    // Nobody reads the refined one from now on. Of another shard's keyframe it may have come before its turn.
    if (state == State::kScheduled && refined->settled) refined = SettledSlot();
  }

  void SettleFast(int of_version, EngineEstimatePtr estimate) {
    if (of_version == version) return fast->Settle(std::move(estimate));
    EstimateSlotPtr& slot = other_fast[of_version];
    if (!slot) slot = std::make_shared<EstimateSlot>();
    slot->Settle(std::move(estimate));
    if (of_version < version) other_fast.erase(of_version);
  }

  /// Nobody reads it from now on.
  void ForgetFast() { fast = SettledSlot(); }

 private:
  static EstimateSlotPtr SettledSlot() { return std::make_shared<EstimateSlot>(EstimateSlot{nullptr, true}); }

  std::map<int, EstimateSlotPtr> other_fast;  ///< by version: that came early, or have not come yet
};
using WindowKeyframePtr = std::shared_ptr<WindowKeyframe>;

/// A refinement with all that it reads, as it stood when its turn came.
struct ScheduledRefinement {
  struct Source {
    WindowKeyframePtr keyframe;
    EstimateReading in_passes;     ///< read by geometric passes
    EstimateReading after_passes;  ///< read by what comes after them: completion, consistency check

    /// The first stage that is still to come.
    std::optional<EstimateStage> Missing() const {
      for (const EstimateReading& reading : {in_passes, after_passes}) {
        if (!reading.IsSettled()) return reading.stage;
      }
      return std::nullopt;
    }
  };
  WindowKeyframePtr keyframe;
  EstimateSlotPtr start, result;  ///< the keyframe's own
  std::vector<Source> sources;    ///< best first
  std::vector<int64_t> source_ids;
};

}  // namespace acmp
