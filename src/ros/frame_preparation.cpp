#include "acmp_mapping/ros/frame_preparation.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/memory_limit.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/image/image_processing.h"

namespace acmp {
namespace {

void CheckMaskFile(const Mask& mask, const std::string& file, const PinholeCamera& camera) {
  if (mask.width() == camera.width && mask.height() == camera.height) return;
  throw InvalidInputError(Concat("~mask_file ", file, " of ", mask.width(), "x", mask.height(),
                                 ": must have the image's size, ", camera.width, "x", camera.height));
}

/// A lens that shows its middle much larger than its rim has faces of many more pixels than its image.
void CheckFaces(const std::vector<PinholeFace>& faces, const PinholeCamera& camera, size_t max_bytes) {
  constexpr uint64_t kFacePixelBytes = 24;  // where each comes from, in two forms, and what is there
  uint64_t pixels = 0;
  for (const PinholeFace& face : faces) {
    pixels += static_cast<uint64_t>(face.camera.width) * static_cast<uint64_t>(face.camera.height);
  }
  CheckMemory(Concat("a camera of ", camera.width, "x", camera.height, " pixels, whose lens needs ", pixels,
                     " pixels without distortion,"),
              pixels, kFacePixelBytes, max_bytes);
}

/// A JPEG file, or null for a size of 0. @param max_size px of the longer side
std::shared_ptr<const std::string> KeptImage(const ColorImage& image, int max_size) {
  if (max_size == 0) return nullptr;
  int width = image.width(), height = image.height();
  LimitSize(max_size, &width, &height);
  ColorImage shrunk;
  if (width != image.width() || height != image.height()) shrunk = Resize(image, width, height);
  return std::make_shared<const std::string>(EncodeJpeg("the image to keep", shrunk.empty() ? image : shrunk));
}

}  // namespace

FramePreparation::FramePreparation(const NodeOptions& options, Mask fixed_mask,
                                   std::function<void(const RejectedInput&)> report)
    : options_(options),
      fixed_mask_(std::move(fixed_mask)),
      label_table_(options.label_file),
      report_(std::move(report)) {}

Capture FramePreparation::Prepare(const KeyframeInput& input, const PreparationOptions& how) {
  Capture capture = {PrepareFrames(input, how, options_.keep_images), {}};
  capture.companions = PrepareCompanions(input, *capture.keyframes.front(), how);
  return capture;
}

Mask FramePreparation::MaskOf(const KeyframeInput& input, const LabelImage& labels) {
  const PinholeCamera& camera = input.calibration->camera;
  Mask mask;
  try {
    if (!fixed_mask_.empty()) {
      CheckMaskFile(fixed_mask_, options_.mask_file, camera);
      mask = fixed_mask_.Clone();
    }
    if (input.mask) {
      Mask own = DecodeMask(*input.mask, camera);  // before the other one is moved from
      mask = IntersectMasks(std::move(mask), std::move(own));
    }
  } catch (const InvalidInputError& error) {
    report_({"bad_mask", Concat("image ", FormatStamp(input.stamp_ns), " is used without it: ", error.what())});
  }
  return IntersectMasks(std::move(mask), label_table_.MaskOf(labels));
}

LabelImage FramePreparation::LabelsOf(const KeyframeInput& input) {
  if (!input.labels) return {};
  const std::string image = Concat("image ", FormatStamp(input.stamp_ns));
  try {
    LabelImage labels = DecodeLabels(*input.labels, input.calibration->camera);
    const std::string unknown = label_table_.DescribeUnknown(labels);
    if (!unknown.empty()) report_({"unknown_label", Concat(image, " has labels without a class: ", unknown)});
    return labels;
  } catch (const InvalidInputError& error) {
    report_({"bad_labels", Concat(image, " goes without: ", error.what())});
    return {};
  }
}

DepthMap FramePreparation::PriorDepthOf(const KeyframeInput& input, bool is_used) {
  if (!input.prior_depth) return {};
  try {
    if (!is_used) {
      throw InvalidInputError("prior depth needs completion, which is off (~completion, ~preset)");
    }
    return DecodePriorDepth(*input.prior_depth);
  } catch (const InvalidInputError& error) {
    report_({"bad_prior_depth", Concat("image ", FormatStamp(input.stamp_ns), " goes without: ", error.what())});
    return {};
  }
}

int FramePreparation::SizeOf(const PinholeCamera& face, const Camera& camera, double share) const {
  int width = 0, height = 0;
  for (const Rectifier& rectifier : camera.rectifiers) {
    width = std::max(width, rectifier.face().camera.width);
    height = std::max(height, rectifier.face().camera.height);
  }
  const int longer_side = std::max(width, height);
  int limit = options_.max_image_size > 0 ? std::min(options_.max_image_size, longer_side) : longer_side;
  limit = static_cast<int>(std::ceil(share * limit));
  const double scale = static_cast<double>(limit) / longer_side;
  return std::max(1, static_cast<int>(std::lround(scale * std::max(face.width, face.height))));
}

cv::Mat FramePreparation::Decode(const EncodedImage& image, const CalibrationPtr& calibration, Camera* camera) {
  if (!camera->calibration || !(*camera->calibration == *calibration)) {
    const Lens lens = calibration->MakeLens();
    Camera made;  // of its own: where that fails, the next image must not find half of it
    made.calibration = calibration;
    if (options_.wide_faces == WideFaces::kOff) {
      made.rectifiers.emplace_back(lens);
    } else {
      std::vector<PinholeFace> faces = FacesOf(lens);
      CheckFaces(faces, lens.camera(), static_cast<size_t>(1e9 * options_.memory_limit_gb));
      for (PinholeFace& face : faces) made.rectifiers.emplace_back(lens, std::move(face));
    }
    *camera = std::move(made);
    if (!calibration->note.empty()) report_({"assumed_lens", Concat(image.topic, ": ", calibration->note)});
  }
  const std::string note = camera->decoder.note();
  cv::Mat rgb = camera->decoder.Decode(image, &calibration->camera);
  if (!camera->decoder.note().empty() && camera->decoder.note() != note) {
    report_({"assumed_encoding", Concat(image.topic, ": ", camera->decoder.note())});
  }
  camera->rectifiers.front().CheckSize(rgb.cols, rgb.rows);  // before their tables are made
  return rgb;
}

std::vector<FramePtr> FramePreparation::PrepareFrames(const KeyframeInput& input, const PreparationOptions& how,
                                                      int keep_images) {
  const cv::Mat rgb = Decode(*input.image, input.calibration, &camera_);
  const LabelImage labels = LabelsOf(input);
  const Mask mask = MaskOf(input, labels);
  const DepthMap prior_depth = PriorDepthOf(input, how.uses_prior_depth);
  auto origin = std::make_shared<CaptureOrigin>(input);
  origin->run = how.run;
  origin->id = next_id_;
  const RigidTransform lens_from_world = input.world_from_cam.inverse();
  std::vector<FramePtr> frames;
  for (const Rectifier& rectifier : camera_.rectifiers) {
    const PinholeFace& face = rectifier.face();
    const Mask face_mask = rectifier.RectifyMask(mask);
    if (!frames.empty() && IgnoresAll(face_mask)) continue;
    ColorImage image = rectifier.Rectify(rgb);
    std::shared_ptr<const std::string> jpeg = KeptImage(image, keep_images);
    Frame frame = MakeFrame(next_id_++, static_cast<double>(input.stamp_ns) * 1e-9, std::move(image), face.camera,
                            RigidTransform(face.lens_from_face.transpose()) * lens_from_world, input.landmarks_in_world,
                            SizeOf(face.camera, camera_, how.size), face_mask, rectifier.RectifyDepth(prior_depth),
                            rectifier.RectifyLabels(labels));
    frames.push_back(
        std::make_shared<const ReceivedFrame>(ReceivedFrame{std::move(frame), origin, face, std::move(jpeg)}));
  }
  return frames;
}

std::vector<FramePtr> FramePreparation::PrepareCompanions(const KeyframeInput& input, const Frame& keyframe,
                                                          const PreparationOptions& how) {
  std::vector<FramePtr> companions;
  for (const SourceImage& source : input.source_images) {
    try {
      Camera& camera = source_cameras_[source.image->topic];
      const cv::Mat rgb = Decode(*source.image, source.calibration, &camera);
      const RigidTransform source_from_world = source.source_from_cam * input.world_from_cam.inverse();
      for (const Rectifier& rectifier : camera.rectifiers) {
        const PinholeFace& face = rectifier.face();
        Frame frame = MakeFrame(next_id_++, static_cast<double>(input.stamp_ns) * 1e-9, rectifier.Rectify(rgb),
                                face.camera, RigidTransform(face.lens_from_face.transpose()) * source_from_world, {},
                                SizeOf(face.camera, camera, how.size), rectifier.RectifyMask({}));
        frame.color = {};  // points get their colours from the keyframe
        if (&rectifier == &camera.rectifiers.front()) RigCheckOf(source.image->topic).Add(keyframe, frame);
        companions.push_back(std::make_shared<const Frame>(std::move(frame)));
      }
    } catch (const InvalidInputError& error) {
      report_({"bad_source_image", Concat("image ", FormatStamp(input.stamp_ns), " goes without that of ",
                                          source.image->topic, ": ", error.what())});
    }
  }
  return companions;
}

RigCheck& FramePreparation::RigCheckOf(const std::string& topic) {
  const std::lock_guard<std::mutex> lock(rigs_mutex_);
  return rig_checks_[topic];
}

void FramePreparation::ForgetRigs() {
  const std::lock_guard<std::mutex> lock(rigs_mutex_);
  for (auto& [topic, check] : rig_checks_) check.Clear();
}

std::string FramePreparation::JudgeRigs(bool at_end) {
  std::vector<std::pair<std::string, RigCheck*>> checks;
  {
    const std::lock_guard<std::mutex> lock(rigs_mutex_);
    for (auto& [topic, check] : rig_checks_) checks.emplace_back(topic, &check);
  }
  std::string text;
  for (const auto& [topic, check] : checks) {
    const std::string verdict = check->Judge(at_end);
    if (!verdict.empty()) text += Concat(text.empty() ? "" : "; ", "the source camera of ", topic, ": ", verdict);
  }
  return text;
}

}  // namespace acmp
