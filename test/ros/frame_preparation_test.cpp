// What becomes of a posed image before it is matched.

#include "acmp_mapping/ros/frame_preparation.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include "acmp_mapping/ros/output_conversion.h"
#include "support/error_text.h"

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
      faces.push_back(static_cast<const ReceivedFrame&>(*frame).face.name);
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

std::string WriteLabelFile(const std::string& text) {
  const std::string path = (std::filesystem::path(testing::TempDir()) / "labels.yaml").string();
  std::ofstream(path) << text;
  return path;
}

sensor_msgs::ImageConstPtr LabelMessage(int width, int height, const std::function<Label(int col)>& label_of) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->encoding = sensor_msgs::image_encodings::TYPE_8UC1;
  message->width = message->step = static_cast<uint32_t>(width);
  message->height = static_cast<uint32_t>(height);
  for (int i = 0; i < width * height; ++i) message->data.push_back(label_of(i % width));
  return message;
}

/// The faces of an image with labels, and what was told.
struct Prepared {
  std::vector<FramePtr> frames;
  std::vector<RejectedInput> told;

  Prepared(const CameraCalibration& calibration, const sensor_msgs::ImageConstPtr& labels, const std::string& file) {
    NodeOptions options;
    options.label_file = WriteLabelFile(file);
    KeyframeInput input;
    input.calibration = std::make_shared<const CameraCalibration>(calibration);
    const ColorImage color(calibration.camera.width, calibration.camera.height);
    input.image = std::make_shared<const EncodedImage>(EncodedImage{ToColorMessage(color, {}), nullptr});
    input.labels = std::make_shared<const EncodedImage>(EncodedImage{labels, nullptr});
    FramePreparation preparation(options, {}, [&](const RejectedInput& rejected) { told.push_back(rejected); });
    frames = preparation.Prepare(input, {}).keyframes;
  }
};

constexpr char kClasses[] = "1: {name: wall}\n2: {name: sky, map: false}\n7: {name: grass, occupancy: false}\n";

CameraCalibration SmallCamera() {
  CameraCalibration calibration;
  calibration.camera = {40, 30, 40, 40, 19.5, 14.5};
  return calibration;
}

TEST(Labels, GoWithTheFrameAndClassesThatAreNotMappedAreIgnored) {
  const Prepared prepared(SmallCamera(), LabelMessage(40, 30, [](int col) { return col < 10   ? 2
                                                                                   : col < 20 ? 0
                                                                                              : 1; }),
                          kClasses);
  const Frame& frame = *prepared.frames.at(0);
  for (const int col : {0, 9, 10, 19, 20, 39}) {
    EXPECT_EQ(frame.labels(col, 3), col < 10 ? 2 : col < 20 ? 0 : 1) << col;
    EXPECT_EQ(frame.mask(col, 3) == 0, col < 10) << col;
  }
  EXPECT_TRUE(prepared.told.empty());
}

TEST(Labels, OfAWideImageAreThoseOfItsFaces) {
  CameraCalibration calibration;
  calibration.camera = {120, 120, 36, 36, 59.5, 59.5};
  calibration.distortion = {LensDistortion::Model::kEquidistant, {0, 0, 0, 0}};
  calibration.field_of_view = 180;
  const Prepared prepared(calibration, LabelMessage(120, 120, [](int col) { return col < 60 ? 1 : 7; }), kClasses);
  ASSERT_GT(prepared.frames.size(), 1u);
  for (const FramePtr& frame : prepared.frames) {
    const std::string& face = static_cast<const ReceivedFrame&>(*frame).face.name;
    const int col = frame->camera.width / 2, row = frame->camera.height / 2;
    if (face == "left" || face == "right") {
      EXPECT_EQ(frame->labels(col, row), face == "left" ? 1 : 7) << face;
    } else {
      EXPECT_EQ(frame->labels(col - 2, row), 1) << face;
      EXPECT_EQ(frame->labels(col + 2, row), 7) << face;
    }
  }
}

/// Poses are refined by it, and counts are its own, whatever of it a mask leaves.
TEST(Labels, TheFaceAheadIsTheFirstOfItsCaptureThoughItIsMasked) {
  CameraCalibration calibration;
  calibration.camera = {120, 120, 36, 36, 59.5, 59.5};
  calibration.distortion = {LensDistortion::Model::kEquidistant, {0, 0, 0, 0}};
  calibration.field_of_view = 180;
  const auto sky_ahead = [](int col) { return col > 24 && col < 96 ? 2 : 1; };
  const Prepared prepared(calibration, LabelMessage(120, 120, sky_ahead), kClasses);
  ASSERT_GT(prepared.frames.size(), 1u);
  const auto received = [&](size_t i) -> const ReceivedFrame& {
    return static_cast<const ReceivedFrame&>(*prepared.frames[i]);
  };
  EXPECT_TRUE(received(0).is_first());
  EXPECT_EQ(received(0).face.name, "");
  EXPECT_TRUE(IgnoresAll(received(0).mask));
  for (size_t i = 1; i < prepared.frames.size(); ++i) {
    EXPECT_FALSE(received(i).is_first());
    EXPECT_EQ(received(i).origin, received(0).origin) << "one moment, one pose";
  }
}

TEST(Labels, WhatCannotBeUsedIsToldAndTheImageIsUsed) {
  const auto told_of = [](const sensor_msgs::ImageConstPtr& labels) {
    const Prepared prepared(SmallCamera(), labels, kClasses);
    EXPECT_EQ(prepared.frames.size(), 1u);
    return prepared.told.empty() ? std::string() : prepared.told.front().reason + ": " + prepared.told.front().message;
  };
  EXPECT_THAT(told_of(LabelMessage(20, 15, [](int) { return 1; })), HasAll("bad_labels", "20x15", "40x30"));
  EXPECT_THAT(told_of(LabelMessage(40, 30, [](int col) { return col < 3 ? 9 : 1; })),
              HasAll("unknown_label", "class: 9;", "from 1 to 7"));
}

TEST(LabelFile, TellsWhatIsWrong) {
  const auto refusal = [](const std::string& text) { return ErrorOf([&] { LabelTable{WriteLabelFile(text)}; }); };
  EXPECT_NO_THROW(LabelTable{WriteLabelFile(kClasses)});
  for (const auto& [text, words] :
       std::map<std::string, const char*>{{"0: {name: wall}", "label 0"},
                                          {"256: {name: wall}", "256"},
                                          {"wall: {name: wall}", "label wall"},
                                          {"1: wall", "name"},
                                          {"1: {color: [0, 0, 0]}", "name is missing"},
                                          {"1: {name: wall, color: [0, 0, 256]}", "0 to 255"},
                                          {"1: {name: wall, color: [0, 0]}", "three numbers"},
                                          {"1: {name: wall, colour: [0, 0, 0]}", "colour"},
                                          {"1: {name: wall, map: perhaps}", "label 1"},
                                          {"1: {name: wall}\n1: {name: floor}", "twice"},
                                          {"[1, 2]", "must be a map"},
                                          {"1: {", "labels.yaml"}}) {
    EXPECT_THAT(refusal(text), HasAll("label_file", words)) << text;
  }
  EXPECT_REFUSED(LabelTable("/no/such.yaml"), "there is no such file");
}

TEST(LabelFile, ThatOfTheRoomHasItsClasses) {
  const LabelTable table(ACMP_SOURCE_DIR "/config/labels.yaml");
  LabelImage all(10, 1);
  for (int i = 0; i < 10; ++i) all(i, 0) = static_cast<Label>(i + 1);
  EXPECT_EQ(table.DescribeUnknown(all), "");
  const Mask mask = table.MaskOf(all);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(mask(i, 0) == 0, i + 1 == 4) << "sky alone is ignored: " << i + 1;
}

}  // namespace
}  // namespace acmp
