#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "bundle.h"

namespace acmp {

/// Grey images of 8 bits, each half as large as the one before: pixel u of level l lies at (u + 0.5) 2^l - 0.5 of
/// level 0.
class GrayPyramid {
 public:
  static constexpr int kLevels = 4;

  GrayPyramid() = default;
  /// Grey values are rounded to whole numbers of 0..255. Levels smaller than 32 px are left out.
  explicit GrayPyramid(const ImageView<const float>& gray);

  int levels() const { return static_cast<int>(levels_.size()); }
  const Image<uint8_t>& level(int l) const { return levels_[static_cast<size_t>(l)]; }

 private:
  std::vector<Image<uint8_t>> levels_;
};

/// A pixel of level 0 in level l, and back.
inline double ToLevel(double u, int l) { return (u + 0.5) / (1 << l) - 0.5; }
inline double FromLevel(double u, int l) { return (u + 0.5) * (1 << l) - 0.5; }

/// Bilinear; the caller makes sure that 0 <= col < width - 1 and 0 <= row < height - 1.
inline float Sample(const Image<uint8_t>& image, float col, float row) {
  const int c = static_cast<int>(col), r = static_cast<int>(row);
  const float a = col - static_cast<float>(c), b = row - static_cast<float>(r);
  const uint8_t* p = image.data() + static_cast<size_t>(r) * image.width() + c;
  const uint8_t* q = p + image.width();
  const auto upper = static_cast<float>(p[0]) + a * static_cast<float>(p[1] - p[0]);
  const auto lower = static_cast<float>(q[0]) + a * static_cast<float>(q[1] - q[0]);
  return upper + b * (lower - upper);
}

/// An image to find landmarks in.
struct View {
  PinholeCamera camera;
  GrayPyramid pyramid;
  MaskDistanceMap mask_distance;  ///< of its mask; empty: all pixels count

  /// Whether the mask ignores no pixel within `reach` px of a place in the image, along both axes.
  bool IsClear(const Eigen::Vector2d& pixel, double reach) const;
};

/// Throws InvalidInputError unless the image has the camera's size. `name` starts messages.
View MakeView(const std::string& name, const PinholeCamera& camera, const GrayImage& gray, const Mask& mask);

/// At each pixel the smaller eigenvalue of the gradients' covariance over 5 x 5 px (Shi and Tomasi 1994), as
/// cv::cornerMinEigenVal scales it.
Image<float> CornerResponse(const View& view);

/// Local maxima of the response, the strongest of each cell of a grid of about `corners` cells, cells row by row; none
/// near the image's border or what its mask ignores. Cells that hold one of `taken` are left out.
std::vector<Eigen::Vector2d> PickCorners(const View& view, const Image<float>& response, int corners,
                                         const std::vector<Eigen::Vector2d>& taken = {});

/// Where the surroundings of a pixel are found in another image.
struct Alignment {
  bool found = false;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< in the other image, to a fraction of a pixel
  double ncc = -1;                                  ///< normalised cross-correlation there
};

/// Of a patch from its middle to its rim, px, at every level: 13 x 13 px.
constexpr int kPatchHalfWidth = 6;

/// Finds the patch around `pixel` of `image` in `other`, at most 12 px from `start`, by inverse compositional
/// Lucas-Kanade alignment (Baker and Matthews 2004) of the two coordinates, insensitive to brightness and contrast,
/// from coarse to fine. The patch is warped first.
/// @param warp affine: what moves by d in `image` moves by warp * d in `other`
Alignment Align(const GrayPyramid& image, const Eigen::Vector2d& pixel, const Eigen::Matrix2d& warp,
                const GrayPyramid& other, const Eigen::Vector2d& start);

/// A view and where it is thought to be.
struct PosedView {
  const View* view = nullptr;
  ViewPose pose;
};

/// Depth of a pixel by a search along its ray: the inverse depth at which the pixels of the other views look most like
/// those around it (mean normalised correlation). Returns 0 where no depth stands out. What masks ignore is not
/// compared.
/// @param others at most 8 are of use
double SearchInverseDepth(const PosedView& anchor, const Eigen::Vector2d& pixel, const DepthRange& range,
                          const std::vector<PosedView>& others);

/// Measures where the landmark is seen in a view: predicted by its depth, then aligned to a fraction of a pixel in both
/// directions, so that the pose's error shows. Not found near what the view's mask ignores.
Alignment FindInView(const Landmark& landmark, const PosedView& anchor, const PosedView& view);

/// A bundle with its images, in which its landmarks are found.
struct ImageBundle {
  Bundle bundle;
  std::deque<View> views;

  PosedView Posed(int view) const {
    return {&views[static_cast<size_t>(view)], bundle.poses[static_cast<size_t>(view)]};
  }

  /// Where these views see the landmark.
  std::vector<Sighting> FindSightings(const Landmark& landmark, const std::set<int>& seen_by) const;

  /// A landmark at a corner of the anchor, if at least kMinSightings views see it. One in five is held out: always the
  /// same.
  /// @param range where its depth is looked for, in the views `searched`
  std::optional<Landmark> FindLandmark(int anchor, const Eigen::Vector2d& corner, const DepthRange& range,
                                       const std::vector<int>& searched, const std::set<int>& seen_by) const;
};
constexpr size_t kMinSightings = 2;  ///< fewer say nothing about depth and poses together

}  // namespace acmp
