#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "acmp_mapping/common/stamp.h"
#include "acmp_mapping/geometry/rigid_transform.h"

namespace acmp {

struct EncodedImage;  // an image message, not yet decoded

// Stamps are nanoseconds: doubles cannot tell neighbouring stamps of today's clocks apart (they resolve 119 ns).

/// An image, or what belongs to one and is one itself, as it came: a mask (0 = ignore the image's pixel), depth from
/// outside, labels, the image of another camera.
struct ImageSample {
  int64_t stamp_ns = 0;
  std::shared_ptr<const EncodedImage> image;
  double arrival_s = 0;  ///< steady clock
};

/// A pose as its source gave it; what it means PoseResolver knows.
struct PoseSample {
  int64_t stamp_ns = 0;
  std::string world_frame;  ///< frame_id of the message
  RigidTransform received = RigidTransform::Identity();
  std::string child_frame;  ///< where the message names one, else empty
};

/// Sparse map points as they came, less those that are no points.
struct SparseCloud {
  int64_t stamp_ns = 0;
  std::string frame_id;
  std::vector<Eigen::Vector3d> points;  ///< in `frame_id`
  size_t not_finite = 0;                ///< left out
  size_t zero = 0;                      ///< left out: exactly (0, 0, 0), which frontends send for "no point"
};
using SparseCloudPtr = std::shared_ptr<const SparseCloud>;

/// Something that a user should know: what was received and not used, or not as a whole. `reason` is a short fixed key
/// for counting, `message` a sentence with the values for people.
struct RejectedInput {
  std::string reason;
  std::string message;
  bool ends_image = false;  ///< an image that was received, and gets no refined map
};

}  // namespace acmp
