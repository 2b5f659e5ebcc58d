#pragma once

#include <vector>

#include "acmp_mapping/keyframe/depth_range.h"
#include "patch_alignment.h"
#include "view.h"

namespace acmp {

/// A view and where it is thought to be.
struct PosedView {
  int index = 0;
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
Alignment FindInView(const Landmark& landmark, const PosedView& anchor, const PosedView& view,
                     const AlignmentOptions& options);

/// The inverse depth that fits the sightings best (robust); keeps the landmark's own where they say nothing.
void Triangulate(const std::vector<ViewPose>& poses, const std::vector<PinholeCamera>& cameras, Landmark* landmark);

/// Distance of a sighting from the epipolar line of the anchor's pixel, px.
double EpipolarDistance(const Landmark& landmark, const PinholeCamera& anchor_camera, const ViewPose& anchor,
                        const Eigen::Vector2d& pixel, const PinholeCamera& camera, const ViewPose& view);

}  // namespace acmp
