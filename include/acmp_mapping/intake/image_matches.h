#pragma once

#include <Eigen/Core>
#include <vector>

#include <opencv2/core.hpp>

#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// An image for matching: at most 640 px.
struct SmallImage {
  cv::Mat gray;  ///< 8 bits; empty: too small for ORB
  PinholeCamera camera;
  RigidTransform cam_from_world;
};
SmallImage MakeSmallImage(const Frame& frame);

/// What of an image is easily found again (ORB).
struct FeatureImage {
  PinholeCamera camera;
  RigidTransform cam_from_world;
  std::vector<Eigen::Vector2d> pixels;
  cv::Mat descriptors;  ///< a row for each pixel
};
FeatureImage FindFeatures(const SmallImage& image);

/// Places in the lists of pixels of two images that look alike, and like no other pixel (Lowe's ratio test).
struct FeatureMatch {
  size_t one = 0, other = 0;
};
std::vector<FeatureMatch> MatchFeatures(const FeatureImage& one, const FeatureImage& other);

/// Errors of good poses and matches, px.
double NearLine(double focal_length);

/// Whether the rays meet before both cameras, or are too near to parallel to tell.
/// @param least_parallax sine of the angle
bool AreBeforeBoth(const RigidTransform& other_from_one, const Eigen::Vector3d& ray, const Eigen::Vector3d& other_ray,
                   double least_parallax);

/// A match's distance from its epipolar line (Sampson's approximation), in units of NearLine; infinite for one that
/// would be behind a camera.
/// @param ray, other_ray with z = 1
double EpipolarDistance(const RigidTransform& other_from_one, const Eigen::Vector3d& ray,
                        const Eigen::Vector3d& other_ray, double focal_length);

}  // namespace acmp
