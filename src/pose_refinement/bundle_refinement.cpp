#include "bundle_refinement.h"

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"

namespace acmp {
namespace {

/// Of the camera's errors about what earlier bundles have found. At first wider than any camera's (a readout takes
/// less than the time from image to image); the more bundles, the surer; but lenses and clocks may drift.
CameraErrors CameraSigma(const Bundle& bundle, int bundles) {
  const double interval =
      bundle.size() < 2 ? 1 : (bundle.times.back() - bundle.times.front()) / static_cast<double>(bundle.size() - 1);
  const auto sigma = [bundles](double first, double least) { return std::max(first / (1 + bundles), least); };
  return {sigma(0.1, 0.003), sigma(0.1, 0.003), sigma(std::min(0.1, interval), 0.006 * interval)};
}

/// Median length of the errors of sightings that take part, px.
double MedianError(const Bundle& bundle) {
  std::vector<double> lengths;
  for (const Landmark& landmark : bundle.landmarks) {
    if (landmark.held_out) continue;
    for (const Eigen::Vector2d& error : ErrorsOf(landmark, bundle, bundle.poses)) lengths.push_back(error.norm());
  }
  return lengths.empty() ? 0 : Median(std::move(lengths));
}

/// Along an axis, px: the median length is 1.18 sigma for normal errors in two dimensions.
double PixelSigma(double median_error) {
  constexpr double kMin = 0.1, kMax = 1;
  return std::clamp(median_error / 1.18, kMin, kMax);
}

/// How far received poses may be off as long as nothing is known of them.
void ForgetExpectedPoses(double typical_depth, BundleWeights* weights) {
  weights->rotation_sigma = 0.02;
  weights->position_sigma = 0.02 * typical_depth;
  weights->turn_sigma = 0.01;
  weights->move_sigma = 0.01 * typical_depth;
}

/// Root mean square per axis.
struct Corrections {
  double rotation = 0, position = 0;
};
Corrections Between(const std::vector<ViewPose>& before, const std::vector<ViewPose>& poses) {
  Corrections sum;
  for (size_t i = 0; i < poses.size(); ++i) {
    sum.rotation += RotationVector(poses[i].rotation * before[i].rotation.conjugate()).squaredNorm();
    sum.position += (poses[i].centre - before[i].centre).squaredNorm();
  }
  const double axes = 3.0 * static_cast<double>(std::max<size_t>(poses.size(), 1));
  return {std::sqrt(sum.rotation / axes), std::sqrt(sum.position / axes)};
}

/// From each view to the next, in the frame of the first.
std::vector<ViewPose> MotionsBetween(const std::vector<ViewPose>& poses) {
  std::vector<ViewPose> motions;
  for (size_t i = 0; i + 1 < poses.size(); ++i) {
    motions.push_back({poses[i + 1].rotation * poses[i].rotation.conjugate(),
                       poses[i].rotation * (poses[i + 1].centre - poses[i].centre)});
  }
  return motions;
}

/// The standard deviations of the expected poses are the sizes of their last corrections. Motions get three times
/// theirs: there are as many motions as poses, and a prior that holds the poses makes the next corrections smaller, and
/// so itself stronger.
void WeighExpectedPoses(const Bundle& bundle, double typical_depth, BundleWeights* weights) {
  const Corrections corrections = Between(bundle.expected, bundle.poses);
  weights->rotation_sigma = std::clamp(corrections.rotation, 1e-4, 0.05);
  weights->position_sigma = std::clamp(corrections.position, 1e-4 * typical_depth, 0.1 * typical_depth);
  const Corrections motions = Between(MotionsBetween(bundle.expected), MotionsBetween(bundle.poses));
  constexpr double kCaution = 3;
  weights->turn_sigma = std::clamp(kCaution * motions.rotation, 1e-4, 0.05);
  weights->move_sigma = std::clamp(kCaution * motions.position, 1e-4 * typical_depth, 0.1 * typical_depth);
}

/// Landmarks as pinholes at `poses` see them.
struct Fitted {
  double cost = 0;                     ///< of held-out ones, robust (Cauchy)
  std::vector<double> inverse_depths;  ///< of all, in their order; 0: behind their anchor
};
Fitted Fit(const Bundle& bundle, const std::vector<ViewPose>& poses) {
  constexpr double kSigma_px = 0.3;
  Fitted fitted;
  for (Landmark landmark : bundle.landmarks) {
    Triangulate(poses, bundle.cameras, &landmark);
    fitted.inverse_depths.push_back(std::max(landmark.inverse_depth, 0.0));
    if (!landmark.held_out) continue;
    for (const Eigen::Vector2d& error : ErrorsOf(landmark, bundle, poses)) {
      fitted.cost += std::log1p(error.squaredNorm() / (kSigma_px * kSigma_px));
    }
  }
  return fitted;
}

/// What is left between the landmarks' depths where the scale has been fitted: median of the relative differences.
double ShapeDistance(const Fitted& a, const Fitted& b) {
  std::vector<double> ratios;
  for (size_t i = 0; i < a.inverse_depths.size(); ++i) {
    const double ratio = a.inverse_depths[i] / b.inverse_depths[i];
    if (ratio > 0 && std::isfinite(ratio)) ratios.push_back(std::log(ratio));
  }
  if (ratios.empty()) return 0;
  const double scale = Median(ratios);
  for (double& ratio : ratios) ratio = std::abs(ratio - scale);
  return Median(std::move(ratios));
}

struct FitSamples {
  std::vector<double> all;
  std::map<int, std::vector<double>> by_gap;  ///< by the gap's binary logarithm

  void Add(int gap, double residual) {
    all.push_back(residual);
    by_gap[std::ilogb(gap)].push_back(residual);
  }
  PoseFit Fit() {
    PoseFit fit;
    fit.matches = static_cast<int>(all.size());
    fit.median_px = all.empty() ? 0 : Median(all);
    for (auto& [exponent, residuals] : by_gap) {
      fit.by_gap.push_back({1 << exponent, (2 << exponent) - 1, static_cast<int>(residuals.size()), Median(residuals)});
    }
    return fit;
  }
};

/// Fits of all views, then of each one.
struct Fits {
  explicit Fits(size_t views) : of_view(views) {}
  FitSamples all;
  std::vector<FitSamples> of_view;
};

/// Of a sighting from the epipolar line of the anchor's pixel, px.
double FromEpipolarLine(const Landmark& landmark, const PinholeCamera& anchor_camera, const ViewPose& anchor,
                        const Eigen::Vector2d& pixel, const PinholeCamera& camera, const ViewPose& view) {
  const Eigen::Vector3d at_infinity =
      view.rotation * (anchor.rotation.conjugate() * anchor_camera.Unproject(landmark.pixel));
  const Eigen::Vector3d epipole = view.rotation * (anchor.centre - view.centre);
  const Eigen::Vector3d normal = at_infinity.cross(epipole);  // of the epipolar plane
  // The line in pixels: n.x (u - cx) / fx + n.y (v - cy) / fy + n.z = 0.
  const Eigen::Vector2d direction(normal.x() / camera.fx, normal.y() / camera.fy);
  const double distance =
      direction.x() * (pixel.x() - camera.cx) + direction.y() * (pixel.y() - camera.cy) + normal.z();
  return std::abs(distance) / direction.norm();
}

void Collect(const Bundle& bundle, const std::vector<ViewPose>& poses, Fits* fits) {
  for (const Landmark& landmark : bundle.landmarks) {
    if (!landmark.held_out) continue;
    const auto anchor = static_cast<size_t>(landmark.anchor);
    for (const Sighting& sighting : landmark.sightings) {
      const auto view = static_cast<size_t>(sighting.view);
      const double distance = FromEpipolarLine(landmark, bundle.cameras[anchor], poses[anchor], sighting.pixel,
                                               bundle.cameras[view], poses[view]);
      if (!std::isfinite(distance)) continue;  // no baseline, no line
      const int gap = std::abs(sighting.view - landmark.anchor);
      fits->all.Add(gap, distance);
      fits->of_view[anchor].Add(gap, distance);
      fits->of_view[view].Add(gap, distance);
    }
  }
}

/// Of received and refined poses, px. The median over all matches does not see single images that are far off.
std::pair<double, double> MeanOfMedians(const PoseRefinement& result) {
  constexpr int kMinMatches = 10;  // of an image
  double before = 0, after = 0;
  int count = 0;
  for (const RefinedPose& pose : result.poses) {
    if (pose.received_fit.matches < kMinMatches) continue;
    before += pose.received_fit.median_px;
    after += pose.refined_fit.median_px;
    ++count;
  }
  return {before / std::max(count, 1), after / std::max(count, 1)};
}

/// @param focal_length of the images, px
std::string WhyUnchanged(const PoseRefinement& result, const PoseRefinementOptions& options, double focal_length,
                         bool bent, bool was_changed) {
  constexpr int kMinMatches = 50, kMinLandmarks = 50;
  if (result.landmarks < kMinLandmarks || result.received_fit.matches < kMinMatches) {
    return Concat("few matches: ", result.landmarks, " landmarks, ", result.received_fit.matches,
                  " matches held out; needs ", kMinLandmarks, " and ", kMinMatches);
  }
  if (options.refine == RefinePoses::kOn || bent) return "";
  const auto [before, after] = MeanOfMedians(result);
  // By so much the mean of the images' median residuals must fall. Half of it is enough to go on with refined poses.
  // Corners are found to 0.05 px. With a baseline of a tenth of the depth, 1e-4 rad are 0.1 % of the depth, a third of
  // what depths may lie apart to confirm each other: no map shows that.
  constexpr double kNeededShare = 0.2, kNeeded_px = 0.05, kNeeded_rad = 1e-4;
  const double needed = std::max({kNeededShare * before, kNeeded_px, kNeeded_rad * focal_length});
  if (before - after >= (was_changed ? needed / 2 : needed)) return "";
  return Concat("poses fit well enough: refined ones would lower the mean of the images' median residuals from ",
                before, " to ", after, " px");
}

}  // namespace

OptionList OptionsOf(PoseRefinementOptions* options) {
  OptionList list;
  list.Group("refinement of poses");
  list.Choice("refine_poses", &options->refine, {"off", "on", "auto"},
              "Whether received poses are replaced by those of a bundle adjustment over matches between the images; "
              "auto: where matches that took no part then fit clearly better, or where an adjustment that took the "
              "camera for an ideal one has bent received poses");
  return list;
}

void Validate(const PoseRefinementOptions& options) { CheckRange("corners", options.corners, 50, 5000); }

double TypicalDepth(const Bundle& bundle) {
  std::vector<double> inverse_depths;
  for (const Landmark& landmark : bundle.landmarks) inverse_depths.push_back(landmark.inverse_depth);
  const double median = inverse_depths.empty() ? 0 : Median(std::move(inverse_depths));
  return median > 0 ? 1 / median : 1;
}

bool RefineBundle(int rounds, int max_iterations, size_t fixed_views, Bundle* bundle, RefinementState* state) {
  const double typical_depth = TypicalDepth(*bundle);
  if (state->bundles == 0 || state->bent) ForgetExpectedPoses(typical_depth, &state->weights);
  state->weights.camera_sigma = CameraSigma(*bundle, state->bundles++);
  if (state->bent) {
    constexpr int kMany = 1000;  // bundles: the camera's errors are told by all of them
    state->camera = state->comparison.camera;
    state->weights.camera_sigma = CameraSigma(*bundle, kMany);
  }
  for (int round = 0; round < rounds; ++round) {
    if (!AdjustBundle(state->weights, max_iterations, fixed_views, bundle, &state->camera)) return false;
    const double error = MedianError(*bundle);
    state->weights.pixel_sigma = PixelSigma(error);
    WeighExpectedPoses(*bundle, typical_depth, &state->weights);
    // Priors that hold poses make themselves surer, also of wrong poses. Where poses are right, at most half of this is
    // left.
    constexpr double kHeldByPriors_rad = 0.002;
    if (error > kHeldByPriors_rad * bundle->cameras.back().fx) ForgetExpectedPoses(typical_depth, &state->weights);
  }
  return true;
}

bool IsSure(const ModelComparison& comparison) {
  constexpr int kEnough = 2000;  // of two full windows indoors
  return comparison.sightings >= kEnough;
}

bool HasCameraErrors(const ModelComparison& comparison) {
  // Rolling shutters of hand-held cameras gain 5 to 21 %, errors found where there are none 1 %.
  constexpr double kNeededGain = 1.03;
  return IsSure(comparison) && comparison.pinhole_cost > kNeededGain * comparison.camera_cost;
}

bool AreBent(const ModelComparison& comparison, double nearer) {
  // Where the errors hardly move the scene, its shape tells nothing (0.69 with a depth sensor): a quarter of what
  // depths may lie apart to be fused. There it is 0.43 %, of bent poses that matter 0.7 to 1.9 %.
  constexpr double kLeastBend = 0.0055;
  return HasCameraErrors(comparison) && comparison.to_pinhole < nearer * comparison.to_camera &&
         comparison.to_camera > kLeastBend * comparison.bundles;
}

bool AreBentByWindows(const RefinementState& state) {
  return AreBent(state.comparison, state.bent ? kNearerOfAll : kNearerOfWindows);
}

std::optional<Bundle> CompareModels(const Bundle& bundle, BundleWeights weights, ModelComparison* comparison) {
  constexpr double kNone = 1e-9;
  ForgetExpectedPoses(TypicalDepth(bundle), &weights);
  const auto adjust = [&](const CameraErrors& camera_sigma, Bundle* adjusted, CameraErrors* camera) {
    BundleWeights with_camera = weights;
    with_camera.camera_sigma = camera_sigma;
    constexpr int kIterations = 25;
    return AdjustBundle(with_camera, kIterations, 0, adjusted, camera);
  };
  Bundle pinhole = bundle, free = bundle;
  CameraErrors none, camera = comparison->camera;
  bool solved_pinhole = false, solved_free = false;
  tbb::parallel_invoke(
      [&] {
        solved_pinhole = adjust({kNone, kNone, kNone}, &pinhole, &none);
      },
      [&] { solved_free = adjust(CameraSigma(bundle, comparison->bundles), &free, &camera); });
  if (!solved_pinhole || !solved_free) return std::nullopt;
  const Fitted by_received = Fit(bundle, bundle.received), by_pinhole = Fit(bundle, pinhole.poses),
               by_camera = Fit(FreedFrom(camera, free), free.poses);
  ++comparison->bundles;
  for (const Landmark& landmark : bundle.landmarks) {
    if (landmark.held_out) comparison->sightings += static_cast<int>(landmark.sightings.size());
  }
  comparison->pinhole_cost += by_pinhole.cost;
  comparison->camera_cost += by_camera.cost;
  comparison->to_pinhole += ShapeDistance(by_received, by_pinhole);
  comparison->to_camera += ShapeDistance(by_received, by_camera);
  comparison->camera = camera;
  return free;
}

PoseRefinement JudgeRefinement(const Bundle& bundle, const std::vector<ViewPose>& refined, const RefinementState& state,
                               const PoseRefinementOptions& options, bool was_changed) {
  PoseRefinement result = Unrefined(bundle, "");
  result.checks.has_camera_errors = HasCameraErrors(state.comparison);
  // Poses that hold the bundle hold down what state.camera takes up.
  result.checks.camera_errors = result.checks.has_camera_errors ? state.comparison.camera : state.camera;
  result.bent = state.bent;
  Fits before(bundle.size()), after(bundle.size());
  tbb::parallel_invoke([&] { Collect(bundle, bundle.received, &before); }, [&] { Collect(bundle, refined, &after); });
  result.received_fit = before.all.Fit();
  result.refined_fit = after.all.Fit();
  result.landmarks = static_cast<int>(std::count_if(bundle.landmarks.begin(), bundle.landmarks.end(),
                                                    [](const Landmark& landmark) { return !landmark.held_out; }));
  for (size_t i = 0; i < bundle.size(); ++i) {
    result.poses[i].received_fit = before.of_view[i].Fit();
    result.poses[i].refined_fit = after.of_view[i].Fit();
  }
  result.reason = WhyUnchanged(result, options, bundle.cameras.back().fx, state.bent, was_changed);
  result.changed = result.reason.empty();
  return result;
}

PoseRefinement Unrefined(const Bundle& bundle, std::string reason) {
  PoseRefinement result;
  result.reason = std::move(reason);
  for (size_t i = 0; i < bundle.size(); ++i) {
    RefinedPose& pose = result.poses.emplace_back();
    pose.id = bundle.ids[i];
    pose.cam_from_world = pose.cam_from_received = bundle.cam_from_world[i];
  }
  return result;
}

void SetPoses(const Bundle& bundle, const std::vector<ViewPose>& refined, const std::vector<ViewPose>& placed,
              PoseRefinement* result) {
  for (size_t i = 0; i < bundle.size(); ++i) {
    result->poses[i].cam_from_world = bundle.FromWorld(refined[i]);
    result->poses[i].cam_from_received = bundle.FromWorld(placed[i]);
  }
}

}  // namespace acmp
