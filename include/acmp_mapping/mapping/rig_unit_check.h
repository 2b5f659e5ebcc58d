#pragma once

#include <array>
#include <optional>
#include <string>

#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// Whether the distance of a fixed second camera is in the unit of the poses, as it is not where a baseline in metres
/// meets the poses of a monocular frontend. Sparse points, which are in the poses' unit, are looked for in the second
/// image as if the distance were a tenth to ten times as long: windows around them look alike where it is right.
class RigUnitCheck {
 public:
  /// Takes the points of a keyframe and an image that was taken with it. Once, a warning: with another length clearly
  /// more of the points look alike.
  std::optional<std::string> Add(const Frame& keyframe, const Frame& companion);

 private:
  static constexpr int kLengths = 95;  ///< steps of 5 % around the given one, in the middle

  std::array<int, kLengths> alike_ = {};  ///< points whose windows look alike, with each length
  int points_ = 0;                        ///< that some length puts into the second image
  bool decided_ = false;
};

}  // namespace acmp
