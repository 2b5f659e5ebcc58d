#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/bags/bag_contents.h"

namespace acmp {

enum class Severity { kOk, kWarning, kError };

/// One sentence about the bag; warnings and errors say what to set or repair.
struct Finding {
  Severity severity = Severity::kOk;
  std::string message;
};

struct BagCheckOptions {
  TopicChoice topics;
  double sync_tolerance_s = 1e-3;   ///< the mapper's ~sync_tolerance
  double sparse_tolerance_s = 0.5;  ///< between points and their image, as in the mapper, s
  bool pose_is_cam_world = false;   ///< the mapper's ~pose_is: T_cam_world instead of T_world_cam
  bool pose_child_is_flu = false;   ///< the mapper's ~pose_child: camera_flu instead of camera_optical
};

struct BagReport {
  BagContents contents;
  std::vector<Finding> findings;

  size_t Count(Severity severity) const;
  /// No errors: the mapper can work with it, given the settings that warnings name.
  bool usable() const { return Count(Severity::kError) == 0; }
};

/// Throws InvalidInputError when the bag cannot be read at all or a topic in the options is not in it.
BagReport CheckBag(const std::filesystem::path& path, const BagCheckOptions& options);

}  // namespace acmp
