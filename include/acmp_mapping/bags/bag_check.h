#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "acmp_mapping/ros/options.h"

namespace acmp {

enum class Severity { kOk, kWarning, kError };

/// One sentence about the recording; warnings and errors say what to set or repair.
struct Finding {
  Severity severity = Severity::kOk;
  std::string message;
};

/// Topics the mapper would be given; an empty name is filled in from the recording by type.
struct TopicChoice {
  std::string image;
  std::string camera_info;
  std::string pose;  ///< empty in a report when the poses come from tf
  std::string sparse_points;
  std::string mask, labels;  ///< filled in by name: Image topics that end in "mask", "labels"
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
  NodeOptions mapper;  ///< all but what the recording tells: pose_source, world_frame, image_transport, keyframe_mode,
                       ///< source_cameras; and another reading of the poses, where images say that it fits
  int trial_size = 160;  ///< px of the longer side at which the first keyframes are mapped
};

struct BagReport {
  std::vector<BagTopic> topics;
  TopicChoice chosen;
  std::vector<Finding> findings;
  std::string
      launch;  ///< what starts the mapper as it was tried; empty where it gets no maps or poses are read wrongly

  size_t Count(Severity severity) const;
  /// No errors: the mapper makes maps of it, given the settings that warnings name.
  bool usable() const { return Count(Severity::kError) == 0; }
};

/// Plays a recording, of one bag or several (`rosbag record --split`), to the mapper's own inputs, intake and checks,
/// maps its first keyframes, and reports what these say. Throws InvalidInputError when a bag cannot be read at all or a
/// topic in the options is not in it.
BagReport CheckBags(const std::vector<std::filesystem::path>& paths, const BagCheckOptions& options);

}  // namespace acmp
