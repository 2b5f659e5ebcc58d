#include "acmp_mapping/intake/rig_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <Eigen/Dense>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/keyframe/landmark_visibility.h"

namespace acmp {
namespace {

constexpr size_t kKeptPairs = 8;
constexpr uint64_t kFirstPairs = 5;
constexpr size_t kMostLandmarks = 2000;  // of an image
constexpr size_t kFewestRigMatches = 60;
constexpr double kFits = 0.5;                // share of the matches: those of good calibrations are 0.7 to 0.95
constexpr double kFitsNowhere = 0.4;         // as chance and repeated texture bring
constexpr double kClearlyMoreMatches = 1.5;  // times as many

double ShareThatFits(const RigMatches& matches, const RigidTransform& source_from_cam) {
  size_t near = 0;
  for (size_t i = 0; i < matches.rays.size(); ++i) {
    near += EpipolarDistance(source_from_cam, matches.rays[i], matches.other_rays[i], matches.focal_length) < 1;
  }
  return static_cast<double>(near) / static_cast<double>(std::max<size_t>(1, matches.rays.size()));
}

/// The place that most matches fit, of any (the essential matrix), with a distance of 1.
std::optional<RigidTransform> FitPlace(const RigMatches& matches) {
  constexpr double kSure = 0.999;
  std::vector<cv::Point2d> rays, other_rays;
  for (size_t i = 0; i < matches.rays.size(); ++i) {
    rays.emplace_back(matches.rays[i].x(), matches.rays[i].y());
    other_rays.emplace_back(matches.other_rays[i].x(), matches.other_rays[i].y());
  }
  const cv::Mat essential = cv::findEssentialMat(rays, other_rays, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, kSure,
                                                 NearLine(matches.focal_length) / matches.focal_length);
  if (essential.rows != 3 || essential.cols != 3) return std::nullopt;
  cv::Mat rotation, shift;
  constexpr double kAnyDistance = 1e9;  // baselines: by default OpenCV counts nothing beyond 50
  cv::recoverPose(essential, rays, other_rays, cv::Mat::eye(3, 3, CV_64F), rotation, shift, kAnyDistance);
  Eigen::Matrix3d linear;
  Eigen::Vector3d translation;
  cv::cv2eigen(rotation, linear);
  cv::cv2eigen(shift, translation);
  return Eigen::Translation3d(translation) * RigidTransform(linear);
}

double DegreesBetween(const RigidTransform& a, const RigidTransform& b) {
  return Eigen::AngleAxisd(a.linear() * b.linear().transpose()).angle() * 180 / M_PI;
}

std::string Rounded(const Eigen::Vector3d& place, double parts) {
  const Eigen::Vector3d rounded = (parts * place).array().round() / parts + 0.0;  // never "-0"
  return Concat("(", rounded.x(), ", ", rounded.y(), ", ", rounded.z(), ")");
}

long PerCent(double share) { return std::lround(100 * share); }

/// Depth of a match by the poses of both images; none where it does not fit them, or the rays are nearly parallel.
std::optional<double> Triangulated(const RigidTransform& other_from_one, const Eigen::Vector3d& ray,
                                   const Eigen::Vector3d& other_ray, double focal_length) {
  constexpr double kLeastLines = 2;  // parallax, in NearLines: of less the depth is off by a third and more
  const double least_parallax = kLeastLines * NearLine(focal_length) / focal_length;
  const Eigen::Vector3d turned = other_from_one.linear() * ray, normal = turned.cross(other_ray);
  if (EpipolarDistance(other_from_one, ray, other_ray, focal_length) >= 1) return std::nullopt;
  if (normal.norm() < least_parallax * turned.norm() * other_ray.norm()) return std::nullopt;
  return other_ray.cross(other_from_one.translation()).dot(normal) / normal.squaredNorm();
}

/// The length of the baseline in that which is declared, by matches of known depth; none where these tell too little or
/// contradict each other.
std::optional<double> FindLength(const RigMatches& matches, const RigidTransform& source_from_cam) {
  constexpr size_t kFewest = 20;
  constexpr double kAgree = 0.2, kMostAgree = 0.5;  // of the ratio; of the matches
  std::vector<double> ratios;
  for (size_t i = 0; i < matches.rays.size(); ++i) {
    if (!matches.depths[i]) continue;
    const auto depth = Triangulated(source_from_cam, matches.rays[i], matches.other_rays[i], matches.focal_length);
    if (depth && *depth > 0) ratios.push_back(*matches.depths[i] / *depth);
  }
  if (ratios.size() < kFewest) return std::nullopt;
  const double middle = Median(ratios);
  const auto agree =
      std::count_if(ratios.begin(), ratios.end(), [&](double ratio) { return std::abs(ratio / middle - 1) < kAgree; });
  if (static_cast<double>(agree) < kMostAgree * static_cast<double>(ratios.size())) return std::nullopt;
  return middle;
}

/// A small turn of the source camera, and the length of the baseline in that which is declared.
struct RigFit {
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();  ///< rad, about the source camera's axes
  double length = 1;
  double share = 0;  ///< of the matches that lie where they should: at their known depths, else on their lines
};

RigidTransform Turned(const RigidTransform& source_from_cam, const RigFit& fit) {
  RigidTransform place = source_from_cam;
  place.translation() *= fit.length;
  const double angle = fit.turn.norm();
  if (angle > 0) place = Eigen::AngleAxisd(angle, fit.turn / angle) * place;
  return place;
}

/// How far a match is from where its depth puts it in the source camera, else from its line; z = 1.
Eigen::Vector2d MissOf(const RigMatches& matches, size_t i, const RigidTransform& place) {
  const Eigen::Vector3d& other = matches.other_rays[i];
  if (matches.depths[i]) {
    const Eigen::Vector3d point = place * (*matches.depths[i] * matches.rays[i]);
    return point.z() > 0 ? Eigen::Vector2d((other - point / point.z()).head<2>()) : Eigen::Vector2d(HUGE_VAL, HUGE_VAL);
  }
  const Eigen::Vector3d line = place.translation().cross(place.linear() * matches.rays[i]);
  const double norm = line.head<2>().norm();
  return {norm > 0 ? other.dot(line) / norm : HUGE_VAL, 0};
}

/// By Gauss and Newton, with Cauchy's weights, whose reach shrinks.
/// @param turns false: the length alone
RigFit FitRig(const RigMatches& matches, bool turns) {
  constexpr double kReach = 0.1, kShrinks = 1.5;  // rad
  constexpr int kIterations = 20;
  constexpr double kStep = 1e-6, kDamping = 1e-3;
  const RigidTransform& declared = matches.source_from_cam;
  const double near = NearLine(matches.focal_length) / matches.focal_length;
  RigFit fit;
  fit.length = FindLength(matches, declared).value_or(1);
  double reach = kReach;
  for (int iteration = 0; iteration < kIterations; ++iteration, reach = std::max(near, reach / kShrinks)) {
    Eigen::Matrix4d normal = kDamping * Eigen::Matrix4d::Identity();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    const RigidTransform place = Turned(declared, fit);
    std::array<RigidTransform, 4> changed;
    for (int k = 0; k < 4; ++k) {
      RigFit other = fit;
      if (k == 3) other.length *= 1 + kStep;
      if (k < 3 && turns) other.turn[k] += kStep;
      changed[static_cast<size_t>(k)] = Turned(declared, other);
    }
    for (size_t i = 0; i < matches.rays.size(); ++i) {
      const Eigen::Vector2d miss = MissOf(matches, i, place);
      Eigen::Matrix<double, 2, 4> slopes;
      for (int k = 0; k < 4; ++k) slopes.col(k) = (MissOf(matches, i, changed[static_cast<size_t>(k)]) - miss) / kStep;
      if (!slopes.allFinite()) continue;
      const double weight = std::pow(1 + miss.squaredNorm() / (reach * reach), -2);
      normal += weight * slopes.transpose() * slopes;
      right -= weight * slopes.transpose() * miss;
    }
    const Eigen::Vector4d step = normal.ldlt().solve(right);
    constexpr double kMost = 2;
    fit.length *= std::clamp(1 + step[3], 1 / kMost, kMost);
    fit.turn += step.head<3>();
  }
  const RigidTransform place = Turned(declared, fit);
  size_t count = 0;
  for (size_t i = 0; i < matches.rays.size(); ++i) count += MissOf(matches, i, place).norm() < near;
  fit.share = static_cast<double>(count) / static_cast<double>(matches.rays.size());
  return fit;
}

size_t CountDepths(const RigMatches& matches) {
  return static_cast<size_t>(
      std::count_if(matches.depths.begin(), matches.depths.end(), [](const auto& depth) { return depth.has_value(); }));
}

/// A turn of a degree and more that explains the matches; empty: there is none. Along the baseline only known depths
/// tell it, and only where the declared length is right with it: else they may be of something else beside a pixel.
std::string DescribeTurn(const RigMatches& matches, const RigFit& unturned, const RigFit& turned) {
  constexpr double kLeast = M_PI / 180;
  constexpr double kMore = 0.05, kMoreAlong = 0.02;  // of the matches
  constexpr size_t kFewestDepths = 20;
  constexpr double kSameLength = 1.4;
  const double more = turned.share - unturned.share;
  const Eigen::Vector3d axis = Eigen::Vector3d::UnitZ().cross(matches.source_from_cam.translation()).normalized();
  const Eigen::Vector3d along = turned.turn.dot(axis) * axis, across = turned.turn - along;
  const bool tells_along = CountDepths(matches) >= kFewestDepths && more > kMoreAlong && along.norm() > kLeast &&
                           turned.length < kSameLength && turned.length > 1 / kSameLength;
  const bool tells_across = more > kMore && across.norm() > kLeast;
  if (turned.share < kFits || (!tells_along && !tells_across)) return "";
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  if (tells_along) turn += along;
  if (tells_across) turn += across;
  turn *= 180 / M_PI;
  return Concat("where it is declared, ", PerCent(unturned.share), " % of ", matches.rays.size(),
                " matches between images of one instant fit, and ", PerCent(turned.share), " % if it were turned by ",
                std::round(10 * turn.norm()) / 10, " degrees more, ", Rounded(turn, 10),
                " about its axes: the calibration is off, or images are not rectified as the camera_infos have it");
}

/// Depths of an image's pixels, by the landmark next to each, else by matches with the image before.
std::vector<std::optional<double>> KnownDepths(const FeatureImage& image,
                                               const std::vector<Eigen::Vector3d>& landmarks_in_world,
                                               const std::optional<FeatureImage>& before) {
  constexpr double kBeside_px = 8;
  std::vector<std::optional<double>> depths(image.pixels.size());
  if (before) {
    const RigidTransform before_from_image = before->cam_from_world * image.cam_from_world.inverse();
    for (const FeatureMatch& match : MatchFeatures(image, *before)) {
      depths[match.one] = Triangulated(before_from_image, image.camera.Unproject(image.pixels[match.one], 1),
                                       before->camera.Unproject(before->pixels[match.other], 1), before->camera.fx);
    }
  }
  const LandmarksInView seen = FindLandmarksInView(landmarks_in_world, image.camera, image.cam_from_world);
  std::vector<double> nearest(image.pixels.size(), kBeside_px);
  const size_t step = 1 + seen.depths.size() / kMostLandmarks;
  for (size_t i = 0; i < seen.depths.size(); i += step) {
    const Eigen::Vector2d pixel = image.camera.Project(image.cam_from_world * seen.points_in_world[i]);
    for (size_t j = 0; j < nearest.size(); ++j) {
      const double distance = (pixel - image.pixels[j]).norm();
      if (distance < nearest[j]) nearest[j] = distance, depths[j] = seen.depths[i];
    }
  }
  return depths;
}

bool IsSamePlace(const RigidTransform& a, const RigidTransform& b) {
  constexpr double kSame = 0.01;  // of the baseline, and rad
  const RigidTransform moved = a * b.inverse();
  return moved.translation().norm() <= kSame * b.translation().norm() &&
         Eigen::AngleAxisd(moved.linear()).angle() <= kSame;
}

std::string DescribeLength(double length) {
  constexpr double kSame = 1.18;  // within 15 % it is what calibrations are off by
  if (length < kSame && length > 1 / kSame) return "";
  constexpr double kUnit = 1.2;  // a monocular scale is there by chance only
  std::string why = "Poses of a monocular frontend without an IMU are not in metres";
  for (const auto& [factor, unit] : {std::pair<double, const char*>{1e-3, "millimetres"}, {1e-2, "centimetres"}}) {
    if (length > factor / kUnit && length < factor * kUnit) why = Concat("The baseline is in ", unit);
  }
  return Concat(
      "the baseline is not in the unit of the poses: matches of known depth fit if it were ",
      std::round(length * 10000) / 10000, " times as long. ", why,
      ": multiply the translation of ~T_cam_source (or P[3] of the camera_infos) by that, or go without source "
      "cameras");
}

}  // namespace

std::string JudgeRig(const RigMatches& matches) {
  if (matches.rays.size() < kFewestRigMatches) return "";
  const RigidTransform& declared = matches.source_from_cam;
  const double share = ShareThatFits(matches, declared);
  const std::string at = Concat("where it is declared, ", PerCent(share), " % of ", matches.rays.size(),
                                " matches between images of one instant fit; ");
  const auto fits = [&](double other) { return other >= kFits && other > kClearlyMoreMatches * share; };
  RigidTransform other_side = declared;
  other_side.translation() *= -1;
  for (const RigidTransform& place : {other_side, declared.inverse()}) {
    const double share_there = ShareThatFits(matches, place);
    if (!fits(share_there)) continue;
    return Concat(
        at, PerCent(share_there), " % fit at ", Rounded(place.inverse().translation(), 1000),
        " of the camera: the sign of P[3] of the camera_infos is wrong, ~T_cam_source is inverted, or the two "
        "cameras are swapped");
  }
  const auto place = share < kFits ? FitPlace(matches) : std::nullopt;
  const double share_of_place = place ? ShareThatFits(matches, *place) : 0;
  const Eigen::Vector3d lies = declared.inverse().translation().normalized();
  constexpr double kSameDirection = 0.9;  // cosine
  const bool lies_elsewhere =
      fits(share_of_place) && place->inverse().translation().normalized().dot(lies) < kSameDirection;
  const RigFit unturned = FitRig(matches, false), turned = FitRig(matches, true);
  std::string turn = lies_elsewhere ? "" : DescribeTurn(matches, unturned, turned);
  if (!turn.empty()) return turn;
  if (fits(share_of_place)) {
    const double degrees = DegreesBetween(*place, declared);
    return Concat(
        at, PerCent(share_of_place), " % fit if it were turned by ", std::round(10 * degrees) / 10,
        " degrees more and lay in direction ", Rounded(place->inverse().translation(), 100),
        " of the camera: the images are not rectified as the camera_infos have it (or are already: ~rectified), or "
        "the calibration is that of another rig");
  }
  const double share_at_depths = CountDepths(matches) < kFewestRigMatches ? 1 : std::max(unturned.share, turned.share);
  if (std::min(share, share_at_depths) < kFitsNowhere) {
    return Concat(at, share < kFitsNowhere ? "" : Concat(PerCent(share_at_depths), " % at depths known otherwise; "),
                  "no other place fits either: the images are not of the same instant (~source_tolerance), or the "
                  "calibration of one camera is wrong (are the images rectified already, or not? ~rectified)");
  }
  const auto length = share >= kFits ? FindLength(matches, declared) : std::nullopt;
  return length ? DescribeLength(*length) : "";
}

void RigCheck::Add(const Frame& keyframe, const Frame& companion) {
  Pair pair = {MakeSmallImage(keyframe), MakeSmallImage(companion), keyframe.landmarks_in_world};
  if (pair.image.gray.empty() || pair.other.gray.empty()) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  pairs_.push_back(std::make_shared<const Pair>(std::move(pair)));
  if (pairs_.size() > kKeptPairs) pairs_.pop_front();
  ++added_;
}

void RigCheck::Clear() {
  const std::lock_guard<std::mutex> lock(mutex_);
  pairs_.clear();
  added_ = judged_ = 0;
  verdict_.clear();
  ++cleared_;
}

std::string RigCheck::Judge(bool at_end) {
  std::unique_lock<std::mutex> lock(mutex_);
  if (at_end ? added_ == judged_ : added_ < std::max(kFirstPairs, 2 * judged_)) return verdict_;
  judged_ = added_;
  const Pairs pairs = pairs_;
  const uint64_t cleared = cleared_;
  lock.unlock();  // the mapper adds pairs meanwhile
  const std::string verdict = JudgeRig(Match(pairs));
  lock.lock();
  if (cleared == cleared_) verdict_ = verdict;
  return verdict_;
}

RigMatches RigCheck::Match(const Pairs& pairs) {
  RigMatches all;
  std::optional<FeatureImage> before;
  for (const auto& kept : pairs) {
    const Pair& pair = *kept;
    const RigidTransform source_from_cam = pair.other.cam_from_world * pair.image.cam_from_world.inverse();
    if (!before) all.source_from_cam = source_from_cam;
    FeatureImage image = FindFeatures(pair.image);
    const FeatureImage other = FindFeatures(pair.other);
    const std::vector<std::optional<double>> depths = KnownDepths(image, pair.landmarks_in_world, before);
    if (!IsSamePlace(source_from_cam, all.source_from_cam)) break;  // on a joint: those before it moved tell
    for (const FeatureMatch& match : MatchFeatures(image, other)) {
      all.rays.emplace_back(image.camera.Unproject(image.pixels[match.one], 1));
      all.other_rays.emplace_back(other.camera.Unproject(other.pixels[match.other], 1));
      all.depths.push_back(depths[match.one]);
    }
    all.focal_length = other.camera.fx;
    before = std::move(image);
  }
  return all;
}

}  // namespace acmp
