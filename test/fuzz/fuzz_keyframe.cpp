// A whole Keyframe through the intake and what the worker does with its image.

#include <boost/make_shared.hpp>

#include "acmp_mapping/ros/keyframe_intake.h"
#include "fuzz/fuzz_messages.h"

ACMP_FUZZ_TARGET(keyframe) {
  using namespace acmp;
  constexpr int kLargeSide = 64;  // larger ones take memory and time
  fuzz::Bytes bytes(data, size);
  NodeOptions options;
  options.keyframe_mode = KeyframeMode::kExternal;
  KeyframeIntake intake(options, {}, 0);
  for (int i = 0; i < 2; ++i) {
    const auto keyframe = boost::make_shared<acmp_mapping::Keyframe>();
    fuzz::Fill(&bytes, &keyframe->header);
    fuzz::Fill(&bytes, &keyframe->pose);
    keyframe->child_frame_id = bytes.TakeText();
    fuzz::Fill(&bytes, &keyframe->camera_info);
    fuzz::Fill(&bytes, &keyframe->points);
    fuzz::Fill(&bytes, &keyframe->image);
    fuzz::Fill(&bytes, &keyframe->compressed_image);
    fuzz::MayRefuse([&] { intake.AddKeyframe(keyframe); });
  }
  for (const IntakeEvent& event : intake.TakeAll()) {
    const auto* input = std::get_if<KeyframeInput>(&event);
    if (!input) continue;
    const PinholeCamera& camera = input->calibration->camera;
    if (camera.width > kLargeSide || camera.height > kLargeSide) continue;
    fuzz::MayRefuse([&] { ImageRectifier(*input->calibration).Rectify(DecodeRgb(*input->image, &camera)); });
  }
  return 0;
}
