#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/intake/reading_check.h"
#include "run.h"

namespace acmp {
namespace {

constexpr size_t kNeighbours = 12;  // images in a row

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

/// Of matches between each image and the next, those that lie where they should; 1 of too few.
double ShareOfNeighbours(const std::vector<FramePtr>& frames) {
  constexpr size_t kFewestMatches = 200, kFewestOfPair = 30;
  size_t near = 0, all = 0;
  std::optional<FeatureImage> before;
  for (const FramePtr& frame : frames) {
    const SmallImage small = MakeSmallImage(*frame);
    if (small.gray.empty()) return 1;
    FeatureImage image = FindFeatures(small);
    if (before) {
      const RigidTransform image_from_before = image.cam_from_world * before->cam_from_world.inverse();
      constexpr double kSamePlace = 1e-9;  // of a camera that stands matches say nothing
      const bool stands = image_from_before.translation().norm() < kSamePlace;
      std::vector<FeatureMatch> matches = MatchFeatures(*before, image);
      if (stands || matches.size() < kFewestOfPair) matches.clear();
      for (const FeatureMatch& match : matches) {
        ++all;
        near += EpipolarDistance(image_from_before, before->camera.Unproject(before->pixels[match.one], 1),
                                 image.camera.Unproject(image.pixels[match.other], 1), image.camera.fx) < 1;
      }
    }
    before = std::move(image);
  }
  return all < kFewestMatches ? 1 : static_cast<double>(near) / static_cast<double>(all);
}

}  // namespace

std::string DescribePoseDoubt(const Scene& scene, const std::vector<int>& indices, FrameStore* frames) {
  std::vector<int> ahead;
  for (int index : indices) {
    if (ImagesOfFile(scene, index).first == index) ahead.push_back(index);
  }
  const size_t count = std::min(kNeighbours, ahead.size()), first = (ahead.size() - count) / 2;
  ReadingCheck check(kNeighbours);
  std::vector<FramePtr> neighbours;
  for (size_t i = first; i < first + count; ++i) neighbours.push_back(frames->Get(ahead[i]));
  for (const FramePtr& frame : neighbours) check.Add(*frame);
  const ReadingVerdict verdict =
      check.Judge({PoseSemantics::Direction::kWorldFromCam, PoseSemantics::Child::kCameraOptical, OpenGlFromCamera()});
  constexpr double kSurelyWrong = 0.3;  // of few matches
  const bool is_of_few = !verdict.share.has_value();
  const double found = is_of_few ? ShareOfNeighbours(neighbours) : *verdict.share;
  if (found >= (is_of_few ? kSurelyWrong : ReadingVerdict::kFittingShare)) return "";
  const auto percent = [](double share) { return std::lround(100 * share); };
  const std::string share =
      Concat("the poses do not fit the images: ", percent(found),
             " % of the matches between neighbouring images lie where they should (of good poses 70 to 95 %); ");
  if (is_of_few) {
    return share +
           "they are inverted, of other axes than x right, y down, z forward, or those of other images, or the "
           "calibration is wrong";
  }
  if (verdict.fitting.empty()) {
    return share + "no other reading that was tried fits: poses or calibration are wrong, or are those of other images";
  }
  std::string fitting;
  for (const PoseReading& reading : verdict.fitting) {
    const std::string text = DescribeReading(reading);
    if (fitting.find(text) != std::string::npos) continue;  // an axis swapped there and back is the same
    fitting += Concat(fitting.empty() ? "" : "; or ", text, " (", percent(reading.share), " %)");
  }
  return Concat(share, "what fits is that they are ", fitting, ". Wanted: p_cam = R p_world + t");
}

}  // namespace acmp
