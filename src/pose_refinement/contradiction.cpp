#include "contradiction.h"

#include <algorithm>

#include "acmp_mapping/common/median.h"
#include "align_views.h"
#include "bundle_refinement.h"
#include "rotation_vector.h"

namespace acmp {
namespace {

constexpr size_t kMinViewsToJudge = 6;
// Among these views: where there are fewer, refined poses follow the received ones.
constexpr int kMinSightingsToJudge = 250;

int NumSightings(const Bundle& bundle, int first) {
  int sightings = 0;
  for (const Landmark& landmark : bundle.landmarks) {
    if (landmark.anchor < first) continue;
    sightings += static_cast<int>(std::count_if(landmark.sightings.begin(), landmark.sightings.end(),
                                                [first](const Sighting& sighting) { return sighting.view >= first; }));
  }
  return sightings;
}

}  // namespace

std::optional<double> MeasureContradiction(const Bundle& bundle) {
  const size_t views = std::min(kContradictionImages, bundle.size());
  const size_t first = bundle.size() - views;
  if (views < kMinViewsToJudge || NumSightings(bundle, static_cast<int>(first)) < kMinSightingsToJudge)
    return std::nullopt;
  const auto last = [first](const std::vector<ViewPose>& poses) {
    return std::vector<ViewPose>(poses.begin() + static_cast<std::ptrdiff_t>(first), poses.end());
  };
  const std::vector<ViewPose> received = last(bundle.received);
  const Similarity received_from_refined = FitSimilarity(last(bundle.poses), received, views);
  const std::vector<ViewPose> refined = Moved(received_from_refined, last(bundle.poses));
  std::vector<double> angles, distances;
  for (size_t i = 0; i < views; ++i) {
    angles.push_back(RotationVector(refined[i].rotation * received[i].rotation.conjugate()).norm());
    distances.push_back((refined[i].centre - received[i].centre).norm());
  }
  return Median(std::move(angles)) +
         Median(std::move(distances)) / (received_from_refined.scale * TypicalDepth(bundle));
}

}  // namespace acmp
