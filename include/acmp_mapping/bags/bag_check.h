#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/ros/options.h"

namespace acmp {

enum class Severity { kOk, kWarning, kError };

/// One sentence about the bag; warnings and errors say what to set or repair.
struct Finding {
  Severity severity = Severity::kOk;
  std::string message;
};

/// Topics the mapper would be given; an empty name is filled in from the bag by type.
struct TopicChoice {
  std::string image;
  std::string camera_info;
  std::string pose;  ///< empty in a report when the poses come from tf
  std::string sparse_points;
  std::string mask;  ///< filled in by name: an Image topic that ends in "mask"
  /// Of source cameras, one camera_info for each; not filled in.
  std::vector<std::string> source_images, source_camera_infos;
};

struct BagTopic {
  std::string name;
  std::string type;
  size_t messages = 0;
  double duration_s = 0;  ///< from the first message to the last one, as they were received
};

struct BagCheckOptions {
  TopicChoice topics;
  NodeOptions mapper;               ///< all but its pose_source, world_frame and source_cameras, which the bag tells
  bool semantics_declared = false;  ///< false: another reading is used where images, or frames and tf, say that it fits
};

struct BagReport {
  std::vector<BagTopic> topics;
  TopicChoice chosen;
  std::vector<Finding> findings;
  std::string launch;  ///< what starts the mapper for these topics; empty where there are no images or no poses

  size_t Count(Severity severity) const;
  /// No errors: the mapper can work with it, given the settings that warnings name.
  bool usable() const { return Count(Severity::kError) == 0; }
};

/// Feeds the bag to the mapper's own intake, decodes its images, matches some of them as the mapper does to see whether
/// poses are read as they are meant, and reports what became of them. Throws InvalidInputError when the bag cannot be
/// read at all or a topic in the options is not in it.
BagReport CheckBag(const std::filesystem::path& path, const BagCheckOptions& options);

}  // namespace acmp
