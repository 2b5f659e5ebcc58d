#include "acmp_mapping/ros/input_conversion.h"

#include <sys/stat.h>

#include <gmock/gmock.h>

#include "acmp_mapping/common/error.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace acmp {
namespace {

constexpr char kConverter[] = "rosrun acmp_mapping convert_calibration.py";  // for files of other systems

class CalibrationFileTest : public TestFolder {
 protected:
  CalibrationFileTest() : good_(ReadText(ACMP_SOURCE_DIR "/test/ros/small_camera.yaml")) {}

  /// What is said of the good file with one part replaced.
  std::string RefusalOf(const std::string& part, const std::string& by) const {
    std::string text = good_;
    EXPECT_NE(text.find(part), std::string::npos) << part;
    text.replace(text.find(part), part.size(), by);
    const auto path = WriteText("camera.yaml", text);
    const std::string message = MessageOf<InvalidInputError>([&] { ReadCalibrationFile(path.string()); });
    EXPECT_THAT(message, HasSubstr("calibration_file = \"" + path.string()));
    return message;
  }

  const std::string good_;
};

TEST_F(CalibrationFileTest, ReadsWhatCameraCalibrationWrites) {
  for (const char* name : {"camera.yaml", "camera.yml", "CAMERA.YAML", "camera.txt"}) {
    const sensor_msgs::CameraInfo info = ReadCalibrationFile(WriteText(name, good_).string());
    EXPECT_EQ(info.width, 64u);
    EXPECT_EQ(info.K[2], 32.012);
    EXPECT_EQ(info.P[6], 23.212);
    EXPECT_EQ(info.D.size(), 5u);
  }
}

TEST_F(CalibrationFileTest, ReadsOurTemplate) {
  const sensor_msgs::CameraInfo info = ReadCalibrationFile(ACMP_SOURCE_DIR "/config/camera.yaml");
  EXPECT_EQ(info.height, 480u);
  EXPECT_EQ(info.P[6], 248.375);
  EXPECT_EQ(info.D, (std::vector<double>{-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0}));
}

TEST_F(CalibrationFileTest, WhatCannotBeUsedIsNamed) {
  EXPECT_THAT(RefusalOf("camera_matrix: {rows: 3, cols: 3", "camera_matrix: {rows: 4, cols: 4"),
              HasSubstr("camera_matrix has 4 rows, 4 cols and 9 numbers: must have 3, 3 and 9"));
  EXPECT_THAT(RefusalOf("data: [1, 0, 0, 0, 1, 0, 0, 0, 1]", "data: [1, 0, 0]"),
              HasSubstr("rectification_matrix has 3 rows, 3 cols and 3 numbers: must have 3, 3 and 9"));
  for (const char* size : {"rows: 1000000, cols: 1000000", "rows: -1, cols: -5", "rows: 1, cols: 4"}) {
    EXPECT_THAT(RefusalOf("rows: 1, cols: 5", size), HasSubstr("5 numbers: must have at most 14 numbers")) << size;
  }
  EXPECT_THAT(RefusalOf("camera_matrix", "cam"), HasAll("camera_matrix is missing", kConverter));
  EXPECT_THAT(RefusalOf("image_width: 64", "image_width: -64"), HasSubstr("image_width = -64"));
  EXPECT_THAT(RefusalOf("55.42562584220407", "fx"), HasAll("line 5", "bad conversion"));
  EXPECT_THAT(RefusalOf("55.42562584220407", "-1"), HasSubstr("K[0] = -1"));
  EXPECT_THAT(RefusalOf("camera_matrix: {", "camera_matrix: [{"), HasSubstr("line"));
  EXPECT_THAT(RefusalOf(good_, ""), HasSubstr("must be a map"));
}

TEST_F(CalibrationFileTest, OtherFilesAreRefused) {
  const auto refusal = [](const std::string& path) {
    return MessageOf<InvalidInputError>([&] { ReadCalibrationFile(path); });
  };
  EXPECT_THAT(refusal((folder() / "none.yaml").string()), HasSubstr("there is no such file"));
  const std::string pipe = (folder() / "pipe.yaml").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(refusal(pipe), HasSubstr("must be a file"));
  const std::filesystem::path large = WriteText("large.yaml", "");
  std::filesystem::resize_file(large, uintmax_t{1} << 40);
  EXPECT_THAT(refusal(large.string()), HasSubstr("1099511627776 bytes"));
  EXPECT_THAT(refusal(WriteText("camera.txt", "fx 1\n").string()), HasSubstr(kConverter));
  EXPECT_THAT(refusal(WriteText("camera.ini", "# oST\n[image]\nwidth\n3\n").string()), HasSubstr("no whole INI"));
}

TEST_F(CalibrationFileTest, ReadsTheIniOfCameraCalibrationUnderAnyName) {
  const std::string ini =
      "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[narrow_stereo]\n\ncamera matrix\n"
      "500.0 0.0 320.0\n0.0 500.0 240.0\n0.0 0.0 1.0\n\ndistortion\n0.1 0.01 0.0 0.0 0.0\n\nrectification\n"
      "1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n\nprojection\n490.0 0.0 321.0 -60.0\n0.0 490.0 241.0 0.0\n"
      "0.0 0.0 1.0 0.0\n\n";
  for (const char* name : {"ost.txt", "camera.ini", "left", "left.yaml"}) {
    const sensor_msgs::CameraInfo info = ReadCalibrationFile(WriteText(name, ini).string());
    EXPECT_EQ(info.width, 640u) << name;
    EXPECT_EQ(info.K[2], 320);
    EXPECT_EQ(info.D[1], 0.01);
    EXPECT_EQ(info.P[3], -60);
  }
}

TEST_F(CalibrationFileTest, ReadsAMessageAsRostopicPrintsIt) {
  const std::string message =
      "header: \n  seq: 0\n  stamp: \n    secs: 16\n    nsecs:         0\n  frame_id: \"camera\"\nheight: 120\n"
      "width: 160\ndistortion_model: \"plumb_bob\"\nD: [0.1, 0.0, 0.0, 0.0, 0.0]\n"
      "K: [138.5, 0.0, 80.78, 0.0, 139.1, 58.78, 0.0, 0.0, 1.0]\nR: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
      "P: [130.5, 0.0, 80.5, -13.0, 0.0, 130.1, 58.5, 0.0, 0.0, 0.0, 1.0, 0.0]\nbinning_x: 2\nbinning_y: 2\n"
      "roi: \n  x_offset: 8\n  y_offset: 4\n  height: 60\n  width: 80\n  do_rectify: False\n";
  for (const std::string& text : {message, message + "---\n" + message + "---\n", message + "---\nheader: [\n"}) {
    const sensor_msgs::CameraInfo info = ReadCalibrationFile(WriteText("camera.yaml", text).string());
    EXPECT_EQ(info.height, 120u);
    EXPECT_EQ(info.K[2], 80.78);
    EXPECT_EQ(info.P[3], -13);
    EXPECT_EQ(info.D[0], 0.1);
    EXPECT_EQ(info.binning_x, 2u);
    EXPECT_EQ(info.roi.x_offset, 8u);
  }
  const auto short_matrix = WriteText("camera.yaml", message.substr(0, message.find("R:")) + "R: [1.0]\nP: [1.0]\n");
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { ReadCalibrationFile(short_matrix.string()); }),
              HasAll("R has 1 numbers", "9"));
}

}  // namespace
}  // namespace acmp
