#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include <opencv2/core.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/intake/reading_check.h"
#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/pose_refinement/pose_refiner.h"
#include "run.h"

namespace acmp {
namespace {

constexpr size_t kNeighbours = 12;   // images in a row
constexpr size_t kFewestImages = 6;  // of which depths of neighbours are compared

/// A small image, and where its surfaces are looked for.
struct Neighbour {
  Frame frame;
  DepthRange range;
};

Neighbour MakeNeighbour(const Frame& frame, const DepthRange& range) {
  constexpr int kSmallSize = 640;  // px, of the longer side
  int width = frame.camera.width, height = frame.camera.height;
  LimitSize(kSmallSize, &width, &height);
  Neighbour small;
  small.range = range;
  small.frame.camera = frame.camera.Resized(width, height);
  small.frame.cam_from_world = frame.cam_from_world;
  small.frame.gray = Resize(frame.gray, width, height);
  if (!frame.mask.empty()) small.frame.mask = ResizeMask(frame.mask, width, height);
  return small;
}

/// Which pose goes with which image, and how an image is stored.
struct Pairing {
  std::string text;
  int later = 0;                           ///< images by which the pose's place in the list comes later
  bool reversed = false;                   ///< the poses
  std::optional<int> flip = std::nullopt;  ///< code of cv::flip
};

/// x right, y up, z backward.
RigidTransform OpenGlFromCamera() {
  RigidTransform transform = RigidTransform::Identity();
  transform.linear().diagonal() << 1, -1, -1;
  return transform;
}

/// What poses of this reading have in place of those that are wanted.
std::string DescribeReading(const PoseReading& reading) {
  std::string text;
  if (reading.semantics.direction == PoseSemantics::Direction::kCamFromWorld) text = "inverted";
  if (reading.semantics.child == PoseSemantics::Child::kCameraOptical) return text;
  if (!text.empty()) text += ", and ";
  text += "of a camera with other axes than x right, y down, z forward: ";
  if (reading.semantics.child == PoseSemantics::Child::kCameraFlu) return text + "x forward, y left, z up";
  const Eigen::Matrix3d axes = ChildFromCamera(reading.semantics).linear();
  constexpr double kSame = 0.1;
  if ((axes - OpenGlFromCamera().linear()).cwiseAbs().maxCoeff() < kSame) {
    return text + "x right, y up, z backward, as OpenGL, Blender and NeRF have them";
  }
  const Eigen::Matrix3d rounded = (100 * axes).array().round() / 100 + 0.0;  // never "-0"
  return Concat(text, "turned by about [", rounded.row(0), "; ", rounded.row(1), "; ", rounded.row(2), "]");
}

/// Of matches between all these images, those that lie where they should; 1 of too few.
double ShareOfAll(const std::vector<Neighbour>& neighbours) {
  constexpr size_t kFewestMatches = 200, kFewestOfPair = 30;
  size_t near = 0, all = 0;
  std::vector<FeatureImage> images;
  for (const Neighbour& neighbour : neighbours) {
    const SmallImage small = MakeSmallImage(neighbour.frame);
    if (small.gray.empty()) return 1;
    FeatureImage image = FindFeatures(small);
    for (const FeatureImage& before : images) {
      const RigidTransform image_from_before = image.cam_from_world * before.cam_from_world.inverse();
      constexpr double kSamePlace = 1e-9;  // of a camera that stands matches say nothing
      const bool stands = image_from_before.translation().norm() < kSamePlace;
      std::vector<FeatureMatch> matches = MatchFeatures(before, image);
      if (stands || matches.size() < kFewestOfPair) matches.clear();
      for (const FeatureMatch& match : matches) {
        ++all;
        near += EpipolarDistance(image_from_before, before.camera.Unproject(before.pixels[match.one], 1),
                                 image.camera.Unproject(image.pixels[match.other], 1), image.camera.fx) < 1;
      }
    }
    images.push_back(std::move(image));
  }
  return all < kFewestMatches ? 1 : static_cast<double>(near) / static_cast<double>(all);
}

/// PoseChecks::contradiction, the greatest along a row of images. None: too few landmarks are found along their poses.
std::optional<double> MeasureContradiction(const std::vector<Neighbour>& neighbours, const Pairing& pairing) {
  PoseRefiner refiner{PoseRefinementOptions()};
  std::optional<double> greatest;
  const int count = static_cast<int>(neighbours.size());
  for (int i = 0; i < count; ++i) {
    const int place = (pairing.reversed ? count - 1 - i : i) + pairing.later;
    if (place < 0 || place >= count) continue;
    const Neighbour &image = neighbours[static_cast<size_t>(i)], &posed = neighbours[static_cast<size_t>(place)];
    Frame frame;
    frame.id = i;
    frame.camera = image.frame.camera;
    frame.cam_from_world = posed.frame.cam_from_world;
    frame.gray = image.frame.gray.Clone();
    frame.mask = image.frame.mask.Clone();
    if (pairing.flip) cv::flip(AsMat(frame.gray), AsMat(frame.gray), *pairing.flip), frame.mask = {};
    refiner.Add(frame, posed.range);
    const std::optional<double> found = refiner.Refine().checks.contradiction;
    if (found) greatest = std::max(greatest.value_or(0), *found);
  }
  return greatest;
}

/// The pairing that fits best, in words. Empty: none that was tried contradicts the images by less than the limit.
std::string FindPairing(const std::vector<Neighbour>& neighbours, double limit) {
  constexpr int kMostLate = 3;
  std::vector<Pairing> pairings = {{"the images are in reverse order", 0, true},
                                   {"the images are mirrored", 0, false, 1},
                                   {"the images are mirrored upside down", 0, false, 0},
                                   {"the images are turned by 180 degrees", 0, false, -1}};
  for (int later = 1; later <= kMostLate; ++later) {
    pairings.push_back({Concat("the pose of each image is that of the image ", later, " later in the list"), later});
    pairings.push_back({Concat("the pose of each image is that of the image ", later, " before in the list"), -later});
  }
  std::string best;
  for (const Pairing& pairing : pairings) {
    const std::optional<double> found = MeasureContradiction(neighbours, pairing);
    if (found && *found < limit) limit = *found, best = pairing.text;
  }
  return best;
}

long Percent(double share) { return std::lround(100 * share); }

constexpr char kDoubt[] = "the poses do not fit the images: ";

std::string DescribeShare(double share) {
  return Concat(kDoubt, Percent(share),
                " % of the matches between neighbouring images lie where they should (of good poses 70 to 95 %); ");
}

std::string DescribeContradiction(double contradiction) {
  return Concat(kDoubt, "depths of neighbouring images lie ", std::lround(1000 * contradiction) / 10.0,
                " % of the depth apart (of good poses 0 to 0.3 %, as trackers publish them up to 1.5 %); ");
}

/// What readings of the poses fit.
std::string DescribeFitting(const ReadingVerdict& verdict) {
  std::string fitting;
  std::set<std::string> told;
  for (const PoseReading& reading : verdict.fitting) {
    const std::string text = DescribeReading(reading);
    if (!told.insert(text).second) continue;  // an axis swapped there and back is the same
    fitting += Concat(fitting.empty() ? "" : "; or ", text, " (", Percent(reading.share), " %)");
  }
  return Concat("what fits is that they are ", fitting, ". Wanted: p_cam = R p_world + t");
}

}  // namespace

std::string DescribePoseDoubt(const Scene& scene, const ReconstructPlan& plan, FrameStore* frames) {
  std::vector<const ImagePlan*> ahead;
  for (const ImagePlan& image : plan.images) {
    if (ImagesOfFile(scene, image.index).first == image.index) ahead.push_back(&image);
  }
  const size_t count = std::min(kNeighbours, ahead.size()), first = (ahead.size() - count) / 2;
  ReadingCheck check(kNeighbours);
  std::vector<Neighbour> neighbours;
  bool has_ranges = count >= kFewestImages;
  for (size_t i = first; i < first + count; ++i) {
    neighbours.push_back(MakeNeighbour(*frames->Get(ahead[i]->index), ahead[i]->range));
    check.Add(neighbours.back().frame);
    has_ranges = has_ranges && ahead[i]->range.max > 0;
  }
  const ReadingVerdict verdict =
      check.Judge({PoseSemantics::Direction::kWorldFromCam, PoseSemantics::Child::kCameraOptical, OpenGlFromCamera()});
  constexpr double kSurelyWrong = 0.3;  // of few matches
  constexpr double kGood = 0.7;         // where too few landmarks are found along the poses
  const double share = verdict.share ? *verdict.share : ShareOfAll(neighbours);
  std::string doubt;
  if (share < (verdict.share ? ReadingVerdict::kFittingShare : kSurelyWrong)) doubt = DescribeShare(share);
  if (!verdict.fitting.empty()) return DescribeShare(share) + DescribeFitting(verdict);
  const double limit = DenseMapperOptions().max_contradiction;
  std::optional<double> contradiction;
  if (has_ranges && doubt.empty()) {
    contradiction = MeasureContradiction(neighbours, {});
    if (contradiction.value_or(0) > limit) doubt = DescribeContradiction(*contradiction);
    if (!contradiction && share < kGood) doubt = DescribeShare(share);
  }
  // What contradicts less than the limit may be noise, but not where another pairing removes most of it.
  constexpr double kNoise = 0.1, kRemoved = 0.2;  // of the limit; of the contradiction
  if (doubt.empty() && contradiction.value_or(0) <= kNoise * limit) return "";
  const std::string pairing = has_ranges ? FindPairing(neighbours, kRemoved * contradiction.value_or(limit)) : "";
  if (doubt.empty() && pairing.empty()) return "";
  if (doubt.empty()) doubt = DescribeContradiction(*contradiction);
  if (!pairing.empty()) return Concat(doubt, "what fits is that ", pairing);
  return doubt +
         "no other reading that was tried fits: they are of other axes than x right, y down, z forward, or those of "
         "other images (in another order?), or the calibration is wrong";
}

}  // namespace acmp
