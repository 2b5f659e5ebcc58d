#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/bags/bag_check.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/intake/sensor_samples.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {

/// An image without its pixels.
struct BagImage {
  int64_t stamp_ns = 0;
  std::string frame;
  std::string encoding;  ///< "jpeg" and the like for compressed images
  int width = 0;         ///< px
  int height = 0;        ///< px
};

/// A mask without its pixels.
struct BagMask {
  int64_t stamp_ns = 0;
  int width = 0;   ///< px
  int height = 0;  ///< px
  bool ignores_all = false;
};

struct BagCalibration {
  CameraCalibration calibration;
  bool names_a_model = true;  ///< of distortion
};

/// What the mapper makes of a topic's messages.
template <class T>
struct BagStream {
  std::vector<T> samples;
  size_t refused = 0;
  std::string refusal;  ///< why, of the first one

  template <class Convert>
  void Add(const Convert& convert) {
    try {
      samples.push_back(convert());
    } catch (const InvalidInputError& error) {
      if (refused++ == 0) refusal = error.what();
    }
  }
  size_t size() const { return samples.size() + refused; }
};

struct BagContents {
  std::vector<BagTopic> topics;
  TopicChoice chosen;
  std::optional<RigidTransform> body_from_cam;  ///< of tf_static, where the poses are another frame's than the images
  std::string pose_from_tf;                     ///< "world -> camera" when the poses come from tf, empty otherwise
  BagStream<BagImage> images;
  BagStream<BagCalibration> calibrations;
  BagStream<PoseSample> poses;
  BagStream<BagMask> masks;
  BagStream<SparseCloud> clouds;  ///< after the first millions of points some 1000 of each, evenly spread
  size_t whole_points = 0;        ///< of all clouds so far

  const BagTopic* Find(const std::string& name) const;
};

/// "/camera/image" of "/camera/image/compressed".
std::string WithoutCompressed(const std::string& topic);

/// Types that the mapper takes, in order of preference.
const std::vector<std::string>& ImageTypes();
const std::vector<std::string>& CameraInfoTypes();
const std::vector<std::string>& PoseTypes();
const std::vector<std::string>& CloudTypes();

/// Reads a bag. Throws InvalidInputError that says what is wrong when it is missing, not a bag, not indexed or
/// truncated, or when a chosen topic is not in it.
BagContents ReadBagContents(const std::filesystem::path& path, const TopicChoice& wanted);

}  // namespace acmp
