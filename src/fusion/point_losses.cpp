#include "acmp_mapping/fusion/point_losses.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"

namespace acmp {
namespace {

constexpr int kMaxStep = 1000;

/// What one source says of a pixel: the first check that fails, in the order of the checks.
enum Outcome { kOutside, kSourceDepth, kReprojection, kRelativeDepth, kAngle, kAgrees, kNumOutcomes };

Outcome CheckSource(const FusionContext& context, const FusionSource& source, const ReferencePixel& pixel) {
  SourcePlace place;
  if (!LocateInSource(source, pixel.homogeneous, &place)) return kOutside;
  ViewAgreement agreement;
  if (source.view.IsUnconfirmed(place.col, place.row) ||
      !ProjectBack(source, context.limits.ByProbability(), pixel, place, &agreement)) {
    return kSourceDepth;
  }
  PixelMatch match;
  if (MatchAgreement(source, context.limits, context.current, pixel, agreement, &match)) return kAgrees;
  if (!(agreement.squared_px < context.limits.max_squared_px)) return kReprojection;
  return agreement.relative_depth < context.limits.max_relative_depth ? kAngle : kRelativeDepth;
}

void CountPixel(const FusionContext& context, int col, int row, PointLosses* losses) {
  ++losses->pixels;
  float confidence = 0;
  SurfacePoint point;
  if (CheckPixel(context, col, row, &confidence, &point)) {
    ++losses->points;
    return;
  }
  ReferencePixel pixel;
  if (!LoadReferencePixel(context, col, row, &pixel)) {
    ++losses->without_depth;
    return;
  }
  if (!MayBePoint(context, col, row)) {
    ++losses->unconfirmed;
    return;
  }
  std::array<int, kNumOutcomes> outcomes = {};
  for (int i = 0; i < context.num_sources; ++i) ++outcomes[CheckSource(context, context.sources[i], pixel)];
  size_t* const counts[kNumOutcomes] = {&losses->outside,        &losses->source_depth, &losses->reprojection,
                                        &losses->relative_depth, &losses->angle,        &losses->uneven};
  ++*counts[std::max_element(outcomes.begin(), outcomes.end()) - outcomes.begin()];
}

}  // namespace

PointLosses CountPointLosses(const FusionSetup& setup, int step) {
  CheckRange("step", step, 1, kMaxStep);
  PointLosses losses;
  FusionContext context = setup.Context(setup.sources().data());
  const Image<float> log_odds = MeasureOdds(context);
  context.log_odds = log_odds.View();
  for (int row = 0; row < log_odds.height(); row += step) {
    for (int col = 0; col < log_odds.width(); col += step) CountPixel(context, col, row, &losses);
  }
  return losses;
}

std::string Describe(const PointLosses& losses, const FusionOptions& options) {
  struct Loss {
    size_t count;
    std::string check;
    const char* cause;
  };
  constexpr char kPoses[] =
      "the views' depths contradict each other: check ~pose_is, ~pose_child, ~sync_tolerance and the calibration";
  constexpr char kUneven[] = "surfaces are uneven or poorly matched: blurred, noisy or very small images";
  std::vector<Loss> all = {
      {losses.without_depth, "no depth",
       "nothing matches within the range of depth: check the sparse points or "
       "~depth_min and ~depth_max"},
      {losses.unconfirmed, "filled in, and images speak against it",
       "the images do not match each other: check ~pose_is, ~pose_child, the stamps and the calibration"},
      {losses.outside, "outside the other images",
       "the views do not see the same: check ~pose_is and ~pose_child, or keyframes are too far apart"},
      {losses.source_depth, "no depth in the other images",
       "the images do not match each other: check ~pose_is, ~pose_child, the stamps and the calibration"},
      {losses.reprojection, Concat("reprojection (", options.max_reprojection_px, " px)"), kPoses},
      {losses.relative_depth, Concat("depth (", 100 * options.max_relative_depth, " %)"), kPoses},
      {losses.angle, Concat("angle of normals (", options.max_normal_angle_deg, " degrees)"), kUneven},
      {losses.uneven, Concat("confidence (", options.min_confidence, ") though views agree"), kUneven}};
  std::stable_sort(all.begin(), all.end(), [](const Loss& a, const Loss& b) { return a.count > b.count; });
  std::string text;
  for (const Loss& loss : all) {
    const long percent = std::lround(100.0 * static_cast<double>(loss.count) / std::max<double>(1, losses.pixels));
    if (percent >= 1) text += Concat(text.empty() ? "" : ", ", loss.check, " ", percent, " %");
  }
  return text.empty() ? "nothing is lost" : Concat(text, "; ", all.front().cause);
}

}  // namespace acmp
