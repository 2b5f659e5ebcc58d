#include "acmp_mapping/pose_refinement/pose_refiner.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <chrono>
#include <future>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/thread_limit.h"
#include "acmp_mapping/keyframe/source_view_selection.h"
#include "bundle_refinement.h"
#include "matching.h"

namespace acmp {
namespace {

constexpr int kFirstSightings = 6;  // earlier keyframes in which a new landmark is measured
constexpr int kSearchViews = 3;     // earlier keyframes in which a new landmark's depth is looked for
constexpr size_t kMinKeyframes = 3;
constexpr size_t kMinResected = 10;  // landmarks from which the newest keyframe's pose follows
constexpr int kLostAfter = 3;        // keyframes in which a landmark was not found: given up

constexpr size_t kMinFixed = kMinForSimilarity;

/// Older keyframes stay where they are: maps were made with their poses, and what follows must connect to them.
size_t NumFixed(size_t keyframes) {
  constexpr size_t kFree = 8;
  return keyframes >= kFree + kMinFixed ? keyframes - kFree : 0;
}

}  // namespace

struct PoseRefiner::Impl {
  /// A known landmark in the newest keyframe.
  struct Tracked {
    Eigen::Vector2d pixel;
    double inverse_depth = 0;  ///< there
  };

  Impl(const PoseRefinementOptions& o, bool is_live) : options(o), live(is_live) {}

  /// The pose of the newest keyframe: the received motion from the last one, on top of its refined pose.
  ViewPose Predicted(const ViewPose& received) const {
    if (bundle.size() == 0) return received;
    const ViewPose &from = bundle.received.back(), &refined = bundle.poses.back();
    ViewPose pose;
    pose.rotation = (received.rotation * from.rotation.conjugate() * refined.rotation).normalized();
    const Eigen::Vector3d motion = (received.centre - from.centre) / scale;
    pose.centre = refined.centre + refined.rotation.conjugate() * (from.rotation * motion);
    return pose;
  }

  /// Whether the camera has not moved since the last keyframe: neither by its received pose nor by its image, in which
  /// four of five corners are found where they were: a turn may make up for a move at one depth, not at all.
  bool StandsSinceLast(const View& view, const ViewPose& pose, double depth) const {
    constexpr double kStill = 0.01;  // rad, and of the depth: half of what maps may lie apart
    constexpr double kStill_px = 0.5;
    if (bundle.size() == 0) return false;
    const ViewPose& last = bundle.received.back();
    if (RotationVector(pose.rotation * last.rotation.conjugate()).norm() > kStill) return false;
    if ((pose.centre - last.centre).norm() > kStill * depth) return false;
    const std::vector<Eigen::Vector2d> corners = PickCorners(view, CornerResponse(view), options.corners);
    std::vector<char> is_still(corners.size(), 0);
    tbb::parallel_for(size_t{0}, corners.size(), [&](size_t i) {
      const Alignment alignment =
          Align(view.pyramid, corners[i], Eigen::Matrix2d::Identity(), window.views.back().pyramid, corners[i]);
      is_still[i] = alignment.found && (alignment.pixel - corners[i]).norm() < kStill_px;
    });
    const auto still = static_cast<size_t>(std::count(is_still.begin(), is_still.end(), 1));
    return still >= kMinResected && 5 * still >= 4 * corners.size();
  }

  Eigen::Vector3d PointOf(const Landmark& landmark) const {
    const auto anchor = static_cast<size_t>(landmark.anchor);
    const ViewPose& pose = bundle.poses[anchor];
    return pose.rotation.conjugate() * bundle.cameras[anchor].Unproject(landmark.pixel, 1 / landmark.inverse_depth) +
           pose.centre;
  }

  /// Known landmarks in the newest keyframe, whose pose then follows from them.
  std::vector<Tracked> TrackLandmarks() {
    const int newest = static_cast<int>(bundle.size()) - 1;
    std::vector<Alignment> alignments(bundle.landmarks.size());
    tbb::parallel_for(size_t{0}, bundle.landmarks.size(), [&](size_t i) {
      const Landmark& landmark = bundle.landmarks[i];
      const int last = landmark.sightings.back().view;  // sightings ascend but for those of its first keyframes
      if (newest - std::max(last, landmark.anchor) > kLostAfter) return;
      alignments[i] = FindInView(landmark, window.Posed(landmark.anchor), window.Posed(newest));
    });
    std::vector<SeenPoint> seen;
    for (size_t i = 0; i < alignments.size(); ++i) {
      const Landmark& landmark = bundle.landmarks[i];
      if (alignments[i].found && !landmark.held_out) seen.push_back({PointOf(landmark), alignments[i].pixel});
    }
    if (seen.size() >= kMinResected) bundle.poses.back() = Resect(seen, bundle.cameras.back(), bundle.poses.back());
    std::vector<Tracked> tracked;
    for (size_t i = 0; i < alignments.size(); ++i) {
      if (!alignments[i].found) continue;
      Landmark& landmark = bundle.landmarks[i];
      landmark.sightings.push_back({newest, alignments[i].pixel});
      const ViewPose& pose = bundle.poses.back();
      const double depth = (pose.rotation * (PointOf(landmark) - pose.centre)).z();
      if (depth > 0) tracked.push_back({alignments[i].pixel, 1 / depth});
    }
    return tracked;
  }

  /// Where a new landmark is looked for: about as far as known ones around it, or in all of `range`.
  DepthRange RangeAround(const Eigen::Vector2d& pixel, const std::vector<Tracked>& tracked,
                         const DepthRange& range) const {
    const double reach = 0.15 * bundle.cameras.back().width;
    double nearest = 0, farthest = 0;  // inverse depths
    int count = 0;
    for (const Tracked& t : tracked) {
      if (!(t.inverse_depth > 0) || (t.pixel - pixel).squaredNorm() > reach * reach) continue;
      nearest = count == 0 ? t.inverse_depth : std::max(nearest, t.inverse_depth);
      farthest = count == 0 ? t.inverse_depth : std::min(farthest, t.inverse_depth);
      ++count;
    }
    constexpr int kMinAround = 3;
    constexpr double kMargin = 1.5;
    if (count < kMinAround) return range;
    const DepthRange around = {std::max(range.min, static_cast<float>(1 / (kMargin * nearest))),
                               std::min(range.max, static_cast<float>(kMargin / farthest))};
    return around.min < around.max ? around : range;
  }

  void AddLandmarks(const std::vector<Tracked>& tracked, const Image<float>& response, const DepthRange& range) {
    const int newest = static_cast<int>(bundle.size()) - 1;
    if (newest < static_cast<int>(kMinSightings)) return;
    std::vector<int> searched;
    for (int i = newest - 1; i >= std::max(0, newest - kSearchViews); --i) searched.push_back(i);
    std::set<int> seen_by;
    for (int i = std::max(0, newest - kFirstSightings); i < newest; ++i) seen_by.insert(i);
    std::vector<Eigen::Vector2d> taken;
    taken.reserve(tracked.size());
    for (const Tracked& t : tracked) taken.push_back(t.pixel);
    const std::vector<Eigen::Vector2d> corners = PickCorners(window.views.back(), response, options.corners, taken);
    std::vector<std::optional<Landmark>> found(corners.size());
    tbb::parallel_for(size_t{0}, corners.size(), [&](size_t i) {
      found[i] = window.FindLandmark(newest, corners[i], RangeAround(corners[i], tracked, range), searched, seen_by);
    });
    for (std::optional<Landmark>& landmark : found) {
      if (landmark) bundle.landmarks.push_back(std::move(*landmark));
    }
  }

  /// Compares models often until they tell, then once in a while. A comparison takes as long as several keyframes, so a
  /// thread of its own makes it. Its result is used a fixed number of keyframes later or, live, when it is ready. Where
  /// received poses turn out to be bent, or turn out not to be, refined poses begin anew.
  void CompareIfDue() {
    constexpr int kOften = 5, kSeldom = 30;
    constexpr size_t kMinCompared = 25;  // keyframes: over fewer a pinhole hardly bends anything
    if (compared.valid() && IsComparisonDue(IsSure(state.comparison) ? kOften : 1)) {
      state.comparison = compared.get();
      const bool bent = AreBentByWindows(state);
      if (bent != state.bent) BeginAnew(bent);
    }
    if (compared.valid() || bundle.size() < kMinCompared) return;
    if (state.bundles % (IsSure(state.comparison) ? kSeldom : kOften) != 0) return;
    compared_at = state.bundles;
    compared = std::async(std::launch::async, [now = bundle, weights = state.weights, before = state.comparison] {
      ModelComparison comparison = before;
      CompareModels(now, weights, &comparison);
      return comparison;
    });
  }

  bool IsComparisonDue(int bundles_later) const {
    if (live) return compared.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    return state.bundles >= compared_at + bundles_later;
  }

  void BeginAnew(bool bent) {
    constexpr int kIterations = 25;
    state.bent = bent;
    Bundle free = bundle;
    if (!RefineBundle(1, kIterations, 0, &free, &state)) return;
    bundle = std::move(free);
    refined = ResectViews(bundle, state.camera);
    ++world;
  }

  /// PoseRefiner::Add.
  bool Add(const Frame& frame, const DepthRange& range) {
    const std::string name = Concat("keyframe ", frame.id);
    CheckCamera(name, frame.camera);
    CheckPose(name.c_str(), frame.cam_from_world);
    CheckDepthRange(name.c_str(), range);
    stamped = frame.stamp_s > 0;
    const double time = stamped ? frame.stamp_s : static_cast<double>(frame.id);
    if (bundle.size() > 0 && frame.id <= bundle.ids.back()) {
      throw InvalidInputError(Concat(name, ": must come after ", bundle.ids.back()));
    }
    if (bundle.size() > 0 && stamped && time <= bundle.times.back()) {
      throw InvalidInputError(Concat(name, ": its stamp must be after that of keyframe ", bundle.ids.back()));
    }
    View view = MakeView(name, frame.camera, frame.gray, frame.mask);
    if (bundle.size() == 0) bundle.origin = ToViewPose(frame.cam_from_world).centre;
    const ViewPose received = bundle.FromOrigin(frame.cam_from_world);
    if (StandsSinceLast(view, received, TypicalDepth(range))) return false;
    refined.push_back(Predicted(received));
    bundle.Add(frame.id, time, frame.camera, frame.cam_from_world);
    bundle.poses.back() = refined.back();
    window.views.push_back(std::move(view));
    const auto to_window = static_cast<float>(scale);
    std::vector<Tracked> tracked;
    Image<float> response;
    tbb::parallel_invoke([&] { tracked = TrackLandmarks(); }, [&] { response = CornerResponse(window.views.back()); });
    AddLandmarks(tracked, response, {range.min / to_window, range.max / to_window});
    return true;
  }

  /// PoseRefiner::Refine.
  PoseRefinement Refine() {
    constexpr int kSureBundles = 10;  // after which the camera's errors hardly change
    if (options.refine == RefinePoses::kOff) return Unrefined(bundle, "refinement is off");
    if (bundle.size() < kMinKeyframes) {
      return Unrefined(bundle, Concat(bundle.size(), " keyframes: needs ", kMinKeyframes));
    }
    if (bundle.landmarks.empty()) return Unrefined(bundle, "no matches between the keyframes");
    constexpr int kIterations = 1;  // the newest pose is good already, and the next window goes on from here
    const size_t fixed = NumFixed(bundle.size());
    const double depth = TypicalDepth(bundle);
    bundle.expected =
        Moved(FitSimilarity(bundle.received, bundle.poses, fixed, scale * depth, 1 / scale), bundle.received);
    if (!RefineBundle(1, kIterations, fixed, &bundle, &state)) {
      bundle.landmarks.clear();
      bundle.poses = refined = bundle.received;
      state = {};
      compared = {};
      changed = false;
      scale = 1;
      ++world;
      return Unrefined(bundle, "the bundle adjustment found no solution");
    }
    CompareIfDue();
    const std::vector<ViewPose> free = ResectViews(bundle, state.camera, fixed);
    std::copy(free.begin(), free.end(), refined.begin() + static_cast<std::ptrdiff_t>(fixed));
    PoseRefinement result = JudgeRefinement(bundle, refined, state, options, changed);
    result.checks.contradiction = MeasureContradiction(bundle, scale);
    if (stamped) result.checks.stamp_offset_s = FindStampOffset(bundle);
    if (!result.checks.has_camera_errors && state.bundles < kSureBundles) result.checks.camera_errors.reset();
    changed = result.changed;
    const Similarity received_from_refined =
        FitSimilarity(bundle.poses, bundle.received, bundle.size(), TypicalDepth(bundle), scale);
    if (result.changed) {
      result.scale = received_from_refined.scale;
      SetPoses(bundle, refined, Moved(received_from_refined, refined), &result);
    } else {
      // As long as received poses are used the two worlds stay one.
      ++world;
      bundle.poses = Moved(received_from_refined, std::move(bundle.poses));
      refined = Moved(received_from_refined, std::move(refined));
      for (Landmark& landmark : bundle.landmarks) landmark.inverse_depth /= received_from_refined.scale;
    }
    scale = result.scale;
    result.world = world;
    TidyLandmarks();
    return result;
  }

  /// Brings what took no part up to date, and forgets what was adjusted to behind its anchor.
  void TidyLandmarks() {
    std::vector<Landmark> kept;
    for (Landmark& landmark : bundle.landmarks) {
      if (landmark.held_out) Triangulate(bundle.poses, bundle.cameras, &landmark);
      if (landmark.inverse_depth > 0) kept.push_back(std::move(landmark));
    }
    bundle.landmarks = std::move(kept);
  }

  const PoseRefinementOptions options;
  const bool live;
  ThreadLimit threads{kPoseRefinementThreads};
  ImageBundle window;  ///< of the keyframes, in their order
  Bundle& bundle = window.bundle;
  std::vector<ViewPose> refined;  ///< by resection; of keyframes that are fixed by now, when they were last free
  RefinementState state;
  std::future<ModelComparison> compared;  ///< of an earlier window
  int compared_at = 0;                    ///< RefinementState::bundles then
  bool stamped = false;                   ///< the last keyframe
  bool changed = false;                   ///< by the last Refine
  double scale = 1;                       ///< of the last Refine's result
  uint64_t world = 1;                     ///< PoseRefinement::world
};

PoseRefiner::PoseRefiner(const PoseRefinementOptions& options, bool live) {
  Validate(options);
  impl_ = std::make_unique<Impl>(options, live);
}

PoseRefiner::~PoseRefiner() = default;

bool PoseRefiner::Add(const Frame& frame, const DepthRange& range) {
  return impl_->threads.Run([&] { return impl_->Add(frame, range); });
}

void PoseRefiner::RemoveOldest() {
  Bundle& b = impl_->bundle;
  if (b.size() == 0) throw InvalidInputError("PoseRefiner::RemoveOldest: the window is empty");
  impl_->window.views.pop_front();
  const auto erase_first = [](auto&... lists) { (lists.erase(lists.begin()), ...); };
  erase_first(b.ids, b.times, b.cameras, b.cam_from_world, b.received, b.poses, impl_->refined);
  std::vector<Landmark> kept;
  for (Landmark& landmark : b.landmarks) {
    if (--landmark.anchor < 0) continue;
    std::vector<Sighting> sightings;
    for (Sighting sighting : landmark.sightings) {
      if (--sighting.view >= 0) sightings.push_back(sighting);
    }
    landmark.sightings = std::move(sightings);
    if (!landmark.sightings.empty()) kept.push_back(std::move(landmark));
  }
  b.landmarks = std::move(kept);
}

PoseRefinement PoseRefiner::Refine() {
  return impl_->threads.Run([&] { return impl_->Refine(); });
}

void PoseRefiner::Reset() {
  const uint64_t world = impl_->world;
  impl_ = std::make_unique<Impl>(impl_->options, impl_->live);
  impl_->world = world + 1;
}

size_t PoseRefiner::size() const { return impl_->bundle.size(); }

}  // namespace acmp
