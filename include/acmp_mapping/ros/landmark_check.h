#pragma once

#include <optional>
#include <string>

#include "acmp_mapping/keyframe/frame.h"
#include "acmp_mapping/ros/pose_semantics.h"

namespace acmp {

/// Start-up check for the commonest wiring mistake, wrong pose conventions: with right ones most sparse points lie in
/// front of the camera.
class LandmarkCheck {
 public:
  static constexpr int kKeyframes = 5;  ///< looked at, those without landmarks not counted

  explicit LandmarkCheck(const PoseSemantics& semantics) : semantics_(semantics) {}

  /// A warning, once, when fewer than half of the first keyframes' landmarks are in front.
  std::optional<std::string> Add(const Frame& frame);

  /// 0..1; none before the first landmark.
  std::optional<double> share_in_front() const;

 private:
  PoseSemantics semantics_;
  int keyframes_ = 0;
  size_t in_front_ = 0;
  size_t landmarks_ = 0;
};

}  // namespace acmp
