#pragma once

#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "acmp_mapping/image/rectifier.h"
#include "acmp_mapping/intake/rig_check.h"
#include "acmp_mapping/ros/keyframe_outputs.h"
#include "acmp_mapping/ros/label_file.h"

namespace acmp {

struct PreparationOptions {
  uint64_t run = 0;  ///< of CaptureOrigin
  double size = 1;   ///< of images, as a share of what ~max_image_size allows
  bool uses_prior_depth = true;
};

/// Makes frames of posed images: decodes and rectifies them, with what belongs to them. An image that cannot be used is
/// an InvalidInputError; a mask, prior depth, labels or a source image are told and left out. One thread prepares; rigs
/// may be judged by another.
class FramePreparation {
 public:
  /// Throws InvalidInputError as LabelTable does.
  /// @param options outlive it
  /// @param fixed_mask of all images as sent; empty: none
  /// @param report told of what is left out and of what was assumed
  FramePreparation(const NodeOptions& options, Mask fixed_mask, std::function<void(const RejectedInput&)> report);

  /// ReceivedFrames: one, or the faces of a wide image; with the source cameras' images that were taken with it.
  Capture Prepare(const KeyframeInput& input, const PreparationOptions& how);
  /// The same of an image that is only a source view: without companions, and without what ~keep_images keeps.
  std::vector<FramePtr> PrepareSource(const KeyframeInput& input, const PreparationOptions& how) {
    return PrepareFrames(input, how, 0);
  }

  /// What the images say of where source cameras lie; empty: nothing. It may take some tenths of a second.
  /// @param at_end of RigCheck
  std::string JudgeRigs(bool at_end);
  void ForgetRigs();

 private:
  /// A camera's images on their way to frames.
  struct Camera {
    CalibrationPtr calibration;
    ImageDecoder decoder;
    std::deque<Rectifier> rectifiers;  ///< one, or one for each face of a wide image
  };
  cv::Mat Decode(const EncodedImage& image, const CalibrationPtr& calibration, Camera* camera);
  /// At which a face of a camera's images is matched, px of the longer side: the limit is that of the largest face.
  int SizeOf(const PinholeCamera& face, const Camera& camera, double share) const;
  /// @param keep_images px; 0: none
  std::vector<FramePtr> PrepareFrames(const KeyframeInput& input, const PreparationOptions& how, int keep_images);
  std::vector<FramePtr> PrepareCompanions(const KeyframeInput& input, const Frame& keyframe,
                                          const PreparationOptions& how);
  /// Of the image as sent: what the mask of all images, its own and its labels leave.
  Mask MaskOf(const KeyframeInput& input, const LabelImage& labels);
  /// Of the image as sent; empty: it has none.
  LabelImage LabelsOf(const KeyframeInput& input);
  /// Of the image as sent; empty: it has none.
  DepthMap PriorDepthOf(const KeyframeInput& input, bool is_used);
  RigCheck& RigCheckOf(const std::string& topic);

  const NodeOptions& options_;
  const Mask fixed_mask_;
  const LabelTable label_table_;
  const std::function<void(const RejectedInput&)> report_;
  Camera camera_;
  std::map<std::string, Camera> source_cameras_;  ///< by topic
  int64_t next_id_ = 0;                           ///< never goes back, whatever stamps do
  std::mutex rigs_mutex_;
  std::map<std::string, RigCheck> rig_checks_;  ///< by topic; the map grows under the mutex, and nothing leaves it
};

}  // namespace acmp
