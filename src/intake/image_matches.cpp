#include "acmp_mapping/intake/image_matches.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace acmp {

SmallImage MakeSmallImage(const Frame& frame) {
  constexpr int kOrbPatchSize = 31;  // px: ORB throws for images that hold none
  constexpr int kSmallSize = 640;    // px, of the longer side
  const PinholeCamera& camera = frame.camera;
  const double scale = std::min(1.0, static_cast<double>(kSmallSize) / std::max(camera.width, camera.height));
  SmallImage image;
  if (scale * std::min(camera.width, camera.height) < kOrbPatchSize + 1) return image;
  cv::Mat(camera.height, camera.width, CV_32F, const_cast<float*>(frame.gray.data())).convertTo(image.gray, CV_8U);
  if (scale < 1) cv::resize(image.gray, image.gray, {}, scale, scale, cv::INTER_AREA);
  image.camera = camera.Resized(image.gray.cols, image.gray.rows);
  image.cam_from_world = frame.cam_from_world;
  return image;
}

FeatureImage FindFeatures(const SmallImage& image) {
  constexpr int kMostFeatures = 1000;
  FeatureImage features = {image.camera, image.cam_from_world, {}, {}};
  std::vector<cv::KeyPoint> points;
  cv::ORB::create(kMostFeatures)->detectAndCompute(image.gray, cv::noArray(), points, features.descriptors);
  for (const cv::KeyPoint& point : points) features.pixels.emplace_back(point.pt.x, point.pt.y);
  return features;
}

std::vector<FeatureMatch> MatchFeatures(const FeatureImage& one, const FeatureImage& other) {
  constexpr float kUnique = 0.8f;  // Lowe's ratio
  std::vector<std::vector<cv::DMatch>> candidates;
  if (!one.descriptors.empty() && !other.descriptors.empty()) {
    cv::BFMatcher(cv::NORM_HAMMING).knnMatch(one.descriptors, other.descriptors, candidates, 2);
  }
  std::vector<FeatureMatch> matches;
  for (const std::vector<cv::DMatch>& nearest : candidates) {
    if (nearest.size() < 2 || nearest[0].distance > kUnique * nearest[1].distance) continue;
    matches.push_back({static_cast<size_t>(nearest[0].queryIdx), static_cast<size_t>(nearest[0].trainIdx)});
  }
  return matches;
}

double NearLine(double focal_length) { return std::clamp(0.006 * focal_length, 1.5, 3.0); }

bool AreBeforeBoth(const RigidTransform& other_from_one, const Eigen::Vector3d& ray, const Eigen::Vector3d& other_ray,
                   double least_parallax) {
  const Eigen::Vector3d turned = other_from_one.linear() * ray, normal = turned.cross(other_ray);
  if (normal.norm() < least_parallax * turned.norm() * other_ray.norm()) return true;
  const Eigen::Vector3d& shift = other_from_one.translation();  // depth * turned + shift = other_depth * other_ray
  return other_ray.cross(shift).dot(normal) > 0 && turned.cross(shift).dot(normal) > 0;
}

double EpipolarDistance(const RigidTransform& other_from_one, const Eigen::Vector3d& ray,
                        const Eigen::Vector3d& other_ray, double focal_length) {
  const double unit = NearLine(focal_length) / focal_length;
  const Eigen::Vector3d shift = other_from_one.translation();
  const Eigen::Vector3d line = shift.cross(other_from_one.linear() * ray);
  const Eigen::Vector3d back = other_from_one.linear().transpose() * other_ray.cross(shift);
  const double norm = std::sqrt(line.head<2>().squaredNorm() + back.head<2>().squaredNorm());
  const bool before = AreBeforeBoth(other_from_one, ray, other_ray, unit);
  return norm > 0 && before ? std::abs(other_ray.dot(line)) / (norm * unit) : HUGE_VAL;
}

}  // namespace acmp
