// What becomes of a posed image before it is matched.

#include "acmp_mapping/ros/frame_preparation.h"

#include <gtest/gtest.h>

#include "acmp_mapping/ros/output_conversion.h"

namespace acmp {
namespace {

/// Poses are refined by the first image of each capture: it must look the same way in all.
TEST(FramePreparation, TheFaceAheadIsTheFirstAlsoWhereTheMaskIgnoresIt) {
  constexpr int kSize = 120;
  const NodeOptions options;
  std::vector<RejectedInput> told;
  const auto report = [&](const RejectedInput& rejected) { told.push_back(rejected); };
  CameraCalibration calibration;
  calibration.camera = {kSize, kSize, 36, 36, 59.5, 59.5};
  calibration.distortion = {LensDistortion::Model::kEquidistant, {0, 0, 0, 0}};
  calibration.field_of_view = 180;
  KeyframeInput input;
  input.calibration = std::make_shared<const CameraCalibration>(calibration);
  input.image =
      std::make_shared<const EncodedImage>(EncodedImage{ToColorMessage(ColorImage(kSize, kSize), {}), nullptr});
  const auto faces_with = [&](const Mask& mask) {
    FramePreparation preparation(options, mask.Clone(), report);
    std::vector<std::string> faces;
    for (const FramePtr& frame : preparation.Prepare(input, {}).keyframes) {
      faces.push_back(static_cast<const ReceivedFrame&>(*frame).origin.face);
    }
    return faces;
  };
  const std::vector<std::string> all = faces_with({});
  ASSERT_GT(all.size(), 1u);
  EXPECT_EQ(all.front(), "");
  const auto ignore_left_of = [&](int col) {
    Mask mask(kSize, kSize, 255);
    for (int row = 0; row < kSize; ++row) std::fill_n(&mask(0, row), col, 0);
    return mask;
  };
  EXPECT_EQ(faces_with(ignore_left_of(115)).front(), "") << "of the face ahead nothing is left";
  EXPECT_LT(faces_with(ignore_left_of(115)).size(), all.size());
  EXPECT_TRUE(told.empty());
}

}  // namespace
}  // namespace acmp
