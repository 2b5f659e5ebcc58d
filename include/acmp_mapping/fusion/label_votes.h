#pragma once

#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/posed_camera.h"
#include "acmp_mapping/image/label.h"

namespace acmp {

bool HasLabels(const PointCloud& points);

/// Adds up votes for labels.
class LabelVotes {
 public:
  /// Unknown (0) is no vote.
  void Add(Label label, double weight) {
    if (label != 0) AddVote(label, weight);
  }
  /// The label with the most votes, of those with equally many the first one; 0 without votes.
  Label Winner() const;
  void Clear() { votes_.clear(); }

 private:
  void AddVote(Label label, double weight);

  struct Votes {
    Label label;
    double weight;
  };
  std::vector<Votes> votes_;
};

/// A view with labels, at the pose of its depth.
struct LabeledView {
  PosedCamera camera;
  const LabelImage* labels = nullptr;  ///< of the camera's size
  DepthMap depth = {};                 ///< the same; z, 0: unknown
  bool is_own = false;                 ///< it is that of the points
};

/// Gives each point the label of most of the views' pixels that show it: those where the view's depth is the point's
/// within a share of it; of the points' own view the 3 x 3 around it. Of labels with equally many that
/// which comes first.
/// @param reference the camera whose frame the points are in
/// @param max_relative_depth (0, 1)
void VoteForLabels(const std::vector<LabeledView>& views, const PosedCamera& reference, double max_relative_depth,
                   PointCloud* points_in_camera);

}  // namespace acmp
