#include "acmp_mapping/ros/input_conversion.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>
#include <boost/make_shared.hpp>
#include <opencv2/imgcodecs.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/checked_messages.h"
#include "support/error_text.h"

namespace acmp {
namespace {

namespace enc = sensor_msgs::image_encodings;

EncodedImage MakeImage(const std::string& encoding, uint32_t width, uint32_t height, std::vector<uint8_t> data) {
  auto image = boost::make_shared<sensor_msgs::Image>();
  image->encoding = encoding;
  image->width = width;
  image->height = height;
  image->step = static_cast<uint32_t>(data.size()) / height;
  image->data = std::move(data);
  return {image, nullptr};
}

cv::Vec3b FirstPixel(const EncodedImage& image) { return ImageDecoder().Decode(image).at<cv::Vec3b>(0, 0); }

TEST(ToStampNs, RefusesMoreNanosecondsThanASecondHas) {
  ros::Time stamp;
  stamp.sec = 4294967295, stamp.nsec = 999999999;
  EXPECT_EQ(ToStampNs(stamp), 4294967295999999999);
  stamp.nsec = 4294967295;  // as a message can have it
  EXPECT_REFUSED(ToStampNs(stamp), "4294967295 ns: the nanoseconds must be below 1000000000");
}

TEST(ImageDecoder, KnowsTheUsualEncodingsAndWhatOpenCvAndCamerasCallTheirs) {
  const struct {
    std::string encoding;
    uint32_t width;
    std::vector<uint8_t> data;
    cv::Vec3b rgb;
  } cases[] = {{enc::RGB8, 1, {1, 2, 3}, {1, 2, 3}},
               {enc::BGR8, 1, {1, 2, 3}, {3, 2, 1}},
               {enc::BGRA8, 1, {1, 2, 3, 9}, {3, 2, 1}},
               {enc::RGBA8, 1, {1, 2, 3, 9}, {1, 2, 3}},
               {enc::MONO8, 1, {77}, {77, 77, 77}},
               {enc::MONO16, 1, {0x00, 0x80}, {128, 128, 128}},  // little-endian 0x8000 of 0xffff
               {enc::TYPE_8UC1, 1, {77}, {77, 77, 77}},
               {enc::TYPE_8UC3, 1, {1, 2, 3}, {3, 2, 1}},  // OpenCV has blue first
               {enc::TYPE_8UC4, 1, {1, 2, 3, 9}, {3, 2, 1}},
               // Y = 128, 16 and no colour, in both orders.
               {"yuv422_yuy2", 2, {128, 128, 16, 128}, {130, 130, 130}},
               {"yuyv", 2, {128, 128, 16, 128}, {130, 130, 130}},
               {enc::YUV422, 2, {128, 128, 128, 16}, {130, 130, 130}}};
  for (const auto& image : cases) {
    const cv::Vec3b pixel = FirstPixel(MakeImage(image.encoding, image.width, 1, image.data));
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(pixel[c], image.rgb[c], image.rgb[c] < 100 ? 0 : 1) << image.encoding;
  }
  EXPECT_EQ(ImageDecoder().Decode(MakeImage(enc::MONO8, 2, 2, {1, 2, 99, 99, 3, 4, 99, 99})).at<cv::Vec3b>(1, 1)[0], 4)
      << "padded rows";
  ImageDecoder decoder;
  decoder.Decode(MakeImage(enc::TYPE_8UC3, 1, 1, {1, 2, 3}));
  EXPECT_THAT(decoder.note(), HasAll("8UC3", "bgr8"));
  decoder = ImageDecoder();
  decoder.Decode(MakeImage(enc::BGR8, 1, 1, {1, 2, 3}));
  EXPECT_EQ(decoder.note(), "");
}

TEST(ImageDecoder, TakesTheBitsThatImagesUse) {
  ImageDecoder decoder;
  // 12 bits: 0x0800 of 0x0fff; then 0x0400, which is not stretched again.
  EXPECT_EQ(decoder.Decode(MakeImage(enc::MONO16, 1, 1, {0x00, 0x08})).at<cv::Vec3b>(0, 0)[0], 0x80);
  EXPECT_THAT(decoder.note(), HasAll("mono16", "12 of their 16 bits"));
  EXPECT_EQ(decoder.Decode(MakeImage(enc::MONO16, 1, 1, {0x00, 0x04})).at<cv::Vec3b>(0, 0)[0], 0x40);
  EXPECT_EQ(decoder.Decode(MakeImage(enc::MONO16, 1, 1, {0x00, 0xf0})).at<cv::Vec3b>(0, 0)[0], 0xf0);
  EXPECT_EQ(decoder.note(), "");
  auto image = boost::make_shared<sensor_msgs::Image>(*MakeImage(enc::MONO16, 2, 1, {0x80, 0x01, 0xff, 0xff}).raw);
  image->is_bigendian = 1;
  EXPECT_EQ(FirstPixel({image, nullptr}), cv::Vec3b(0x80, 0x80, 0x80));
}

TEST(ImageDecoder, KnowsYuv420) {
  // 4 x 4 of Y = 128, with U = 110 and V = 150 all over: red more than blue.
  const auto decode = [](const std::string& encoding, uint32_t height, const std::vector<uint8_t>& chroma,
                         uint32_t step) {
    std::vector<uint8_t> data(size_t{4} * step, 128);
    for (size_t i = 0; i < chroma.size(); ++i) data.push_back(chroma[i]);
    auto image = boost::make_shared<sensor_msgs::Image>();
    image->encoding = encoding, image->width = 4, image->height = height, image->step = step, image->data = data;
    return ImageDecoder().Decode({image, nullptr});
  };
  const std::vector<uint8_t> uv = {110, 150, 110, 150, 110, 150, 110, 150},
                             vu = {150, 110, 150, 110, 150, 110, 150, 110},
                             u_v = {110, 110, 110, 110, 150, 150, 150, 150},
                             v_u = {150, 150, 150, 150, 110, 110, 110, 110};
  const cv::Mat expected = decode("nv12", 4, uv, 4);
  ASSERT_EQ(expected.size(), cv::Size(4, 4));
  const auto pixel = expected.at<cv::Vec3b>(3, 3);
  EXPECT_GT(pixel[0], pixel[2] + 40);
  const auto is_same = [&](const cv::Mat& image) {
    return image.size() == expected.size() && cv::norm(image, expected, cv::NORM_INF) == 0;
  };
  EXPECT_TRUE(is_same(decode("nv21", 4, vu, 4)));
  EXPECT_TRUE(is_same(decode("NV12", 4, uv, 4)));
  EXPECT_TRUE(is_same(decode("i420", 4, u_v, 4)));
  EXPECT_TRUE(is_same(decode("yuv420", 4, u_v, 4)));
  EXPECT_TRUE(is_same(decode("yv12", 4, v_u, 4)));
  EXPECT_TRUE(is_same(decode("nv12", 6, uv, 4))) << "the height of all rows";
  // Rows with a gap at their end, of the colours as well.
  EXPECT_TRUE(is_same(decode("nv12", 4, {110, 150, 110, 150, 0, 0, 110, 150, 110, 150, 0, 0}, 6)));
  EXPECT_TRUE(is_same(decode("i420", 4, {110, 110, 0, 110, 110, 0, 150, 150, 0, 150, 150, 0}, 6)));
  EXPECT_REFUSED(decode("nv12", 4, {1, 2, 3}, 4), "nv12", "24 bytes");
  EXPECT_REFUSED(decode("nv12", 4, {}, 2), "12 bytes");
}

TEST(ImageDecoder, NamesAnUnknownEncodingBeforeItCountsBytes) {
  EXPECT_REFUSED(ImageDecoder().Decode(MakeImage("nv24", 2, 1, {1, 2, 3, 4, 5, 6, 7})), "nv24", "nv12");
  auto image = boost::make_shared<sensor_msgs::Image>(*MakeImage("nv24", 2, 1, {1, 2}).raw);
  image->data.resize(6);
  EXPECT_REFUSED(ImageDecoder().Decode({image, nullptr}), "must be mono");
}

/// A Bayer mosaic whose red sites alone are lit.
cv::Mat RedMosaic(int depth, double value) {
  cv::Mat mosaic(8, 8, depth, cv::Scalar(0));
  for (int row = 0; row < 8; row += 2) {
    for (int col = 0; col < 8; col += 2) mosaic(cv::Rect(col, row, 1, 1)) = cv::Scalar(value);
  }
  return mosaic;
}

TEST(ImageDecoder, BayerIsAMosaicCompressedToo) {
  const cv::Mat red = RedMosaic(CV_8U, 200);
  EXPECT_EQ(ImageDecoder().Decode(MakeImage(enc::BAYER_RGGB8, 8, 8, {red.datastart, red.dataend})).at<cv::Vec3b>(4, 4),
            cv::Vec3b(200, 0, 0));
  const auto center = [](const char* format, const cv::Mat& picture) {
    auto image = boost::make_shared<sensor_msgs::CompressedImage>();
    cv::imencode(".png", picture, image->data);
    image->format = format;
    return ImageDecoder().Decode({nullptr, image}).at<cv::Vec3b>(4, 4);
  };
  EXPECT_EQ(center("bayer_rggb8; png compressed ", RedMosaic(CV_8U, 200)), cv::Vec3b(200, 0, 0));
  EXPECT_EQ(center("bayer_bggr8; png compressed ", RedMosaic(CV_8U, 200)), cv::Vec3b(0, 0, 200));
  EXPECT_EQ(center("bayer_rggb16; png compressed ", RedMosaic(CV_16U, 200 << 8)), cv::Vec3b(200, 0, 0));
  EXPECT_EQ(center("mono16; png compressed ", cv::Mat(8, 8, CV_16U, cv::Scalar(200 << 8))), cv::Vec3b(200, 200, 200));
  EXPECT_EQ(center("mono8; png compressed ", RedMosaic(CV_8U, 200)), cv::Vec3b(200, 200, 200));
}

TEST(ImageDecoder, RefusesWhatCannotBeConvertedAndNamesIt) {
  const auto refusal = [](const std::string& encoding, uint32_t width, uint32_t height, std::vector<uint8_t> data) {
    auto image = boost::make_shared<sensor_msgs::Image>(*MakeImage(encoding, width, 1, std::move(data)).raw);
    image->height = height;
    return ErrorOf([&] { ImageDecoder().Decode({image, nullptr}); });
  };
  EXPECT_THAT(refusal("holograms", 1, 1, {0}), HasSubstr("holograms"));
  EXPECT_THAT(refusal(enc::TYPE_16UC1, 1, 1, {0, 0}), HasAll("16UC1", "depth map?"));
  EXPECT_THAT(refusal(enc::RGB8, 2, 1, {0, 0, 0}), HasSubstr("step of at least 6"));
  EXPECT_THAT(refusal("yuv422_yuy2", 1, 1, {0, 0}), HasSubstr("yuv422_yuy2"));
  EXPECT_THAT(refusal(enc::RGB8, 1, 100, {1, 2, 3}), HasAll("1x100", "3 bytes"));
}

TEST(ImageDecoder, DecodesCompressedImages) {
  const cv::Mat bgr(8, 8, CV_8UC3, cv::Scalar(10, 100, 200));
  for (const char* extension : {".png", ".jpg"}) {
    auto compressed = boost::make_shared<sensor_msgs::CompressedImage>();
    cv::imencode(extension, bgr, compressed->data);
    const cv::Vec3b pixel = FirstPixel({nullptr, compressed});
    EXPECT_NEAR(pixel[0], 200, 3) << extension;  // JPEG rounds
    EXPECT_NEAR(pixel[1], 100, 3);
    EXPECT_NEAR(pixel[2], 10, 3);
    auto broken = boost::make_shared<sensor_msgs::CompressedImage>();
    broken->data = {1, 2, 3};
    broken->format = "jpeg";
    EXPECT_REFUSED(ImageDecoder().Decode({nullptr, broken}), "3 bytes", "jpeg");
    broken->data.clear();
    EXPECT_REFUSED(ImageDecoder().Decode({nullptr, broken}), "0 bytes");
  }
}

TEST(ImageDecoder, RefusesASizeThatIsNotTheCamerasByTheHeader) {
  const cv::Mat bgr(48, 64, CV_8UC3, cv::Scalar(10, 100, 200));
  const PinholeCamera camera{64, 48, 50, 50, 31.5, 23.5}, upright{48, 64, 50, 50, 23.5, 31.5};
  for (const char* extension : {".png", ".jpg"}) {
    auto image = boost::make_shared<sensor_msgs::CompressedImage>();
    cv::imencode(extension, bgr, image->data);
    EXPECT_EQ(ImageDecoder().Decode({nullptr, image}, &camera).size(), bgr.size());
    EXPECT_REFUSED(ImageDecoder().Decode({nullptr, image}, &upright), "its header says 64x48, camera_info says 48x64");
  }
  // More than any camera has, by a header of 64 x 48 px whose numbers were changed: before memory is asked for.
  auto bomb = boost::make_shared<sensor_msgs::CompressedImage>();
  cv::imencode(".png", bgr, bomb->data);
  for (const auto& [at, number] : {std::pair(16, 32000), {20, 20000}}) {
    bomb->data.at(at + 2) = static_cast<uint8_t>(number >> 8);
    bomb->data.at(at + 3) = static_cast<uint8_t>(number);
  }
  EXPECT_REFUSED(ImageDecoder().Decode({nullptr, bomb}), "image size 32000 x 20000: must be");
}

sensor_msgs::CameraInfo MakeInfo() {
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {-0.28, 0.07, 2e-4, 2e-5, 0};
  info.K = {500, 0, 319.5, 0, 510, 239.5, 0, 0, 1};
  info.P = {450, 0, 310, 0, 0, 460, 230, 0, 0, 0, 1, 0};
  info.header.frame_id = "/cam";
  return info;
}

TEST(ToCalibration, ReadsKAndDOrPOfRectifiedImages) {
  const CameraCalibration calibration = ToCalibration(MakeInfo(), false);
  EXPECT_EQ(calibration.camera, (PinholeCamera{640, 480, 500, 510, 319.5, 239.5}));
  EXPECT_EQ(calibration.distortion.model, LensDistortion::Model::kBrownConrady);
  EXPECT_EQ(calibration.distortion.coefficients.size(), 5u);
  EXPECT_EQ(calibration.frame_id, "cam");
  const CameraCalibration rectified = ToCalibration(MakeInfo(), true);
  EXPECT_EQ(rectified.camera, (PinholeCamera{640, 480, 450, 460, 310, 230}));
  EXPECT_EQ(rectified.distortion.model, LensDistortion::Model::kNone);
}

TEST(ToCalibration, AppliesBinningAndRegionOfInterest) {
  sensor_msgs::CameraInfo info = MakeInfo();
  info.binning_x = info.binning_y = 2;
  info.roi.x_offset = 100;
  info.roi.y_offset = 40;
  info.roi.width = 400;
  info.roi.height = 300;
  const PinholeCamera camera = ToCalibration(info, false).camera;
  EXPECT_EQ(camera.width, 200);
  EXPECT_EQ(camera.height, 150);
  EXPECT_EQ(camera.fx, 250);
  // The full-size pixels 100 and 101 make the binned pixel 0, whose centre lies between them.
  const double full_u = 100.5, full_x = (full_u - 319.5) / 500;
  EXPECT_NEAR(camera.fx * full_x + camera.cx, 0, 1e-9);
  info.roi.width = 600;
  EXPECT_REFUSED(ToCalibration(info, false), "600x300", "640x480");
}

TEST(ToCalibration, TakesCoefficientsThatAreZeroAndOtherNames) {
  const auto of = [](const char* model, std::vector<double> coefficients) {
    sensor_msgs::CameraInfo info = MakeInfo();
    info.distortion_model = model;
    info.D = std::move(coefficients);
    return ToCalibration(info, false).distortion;
  };
  using Model = LensDistortion::Model;
  const std::vector<double> rational = {1, 2, 3, 4, 5, 0, 0, 0};
  for (const size_t count : {5, 8, 12, 14}) {
    std::vector<double> coefficients = rational;
    coefficients.resize(count);
    EXPECT_EQ(of("rational_polynomial", coefficients).coefficients, rational) << count;
    EXPECT_EQ(of("rational_polynomial", coefficients).model, Model::kRational);
  }
  EXPECT_EQ(of("", {}).model, Model::kNone);
  EXPECT_EQ(of("plumb_bob", {1, 2, 3, 4, 5, 0, 0, 0}).coefficients, (std::vector<double>{1, 2, 3, 4, 5}));
  EXPECT_EQ(of("plumb_bob", {1, 2, 3, 4}).coefficients, (std::vector<double>{1, 2, 3, 4, 0}));
  for (const char* name : {"fisheye", "kannala_brandt4", "KannalaBrandt8"}) {
    EXPECT_EQ(of(name, {1, 2, 3, 4, 0}).model, Model::kEquidistant) << name;
    EXPECT_EQ(of(name, {1, 2, 3, 4, 0}).coefficients.size(), 4u);
  }
  EXPECT_REFUSED(of("rational_polynomial", {1, 2, 3, 4, 5, 6, 7, 8, 0.1, 0, 0, 0}), "12 coefficients", "thin prism",
                 "rectified");
  EXPECT_REFUSED(of("plumb_bob", {1, 2, 3, 4, 5, 6}), "6 coefficients");
}

TEST(ToCalibration, TakesEightCoefficientsForTheRationalModelAndSaysSo) {
  sensor_msgs::CameraInfo info = MakeInfo();
  info.distortion_model = "plumb_bob";
  info.D = {0.1, 0.02, 0, 0, 0.003, 0.4, 0.05, 0.006};
  const CameraCalibration calibration = ToCalibration(info, false);
  EXPECT_EQ(calibration.distortion, (LensDistortion{LensDistortion::Model::kRational, info.D}));
  EXPECT_THAT(calibration.note, HasAll("plumb_bob", "rational_polynomial"));
  info.distortion_model = "rational_polynomial";
  EXPECT_EQ(ToCalibration(info, false).note, "");
}

TEST(ToPoseSample, AChildFrameThatIsTheFrameIsNone) {
  std_msgs::Header header;
  header.frame_id = "world";
  geometry_msgs::Pose pose;
  pose.orientation.w = 1;
  for (const char* child : {"world", "/world"}) {
    EXPECT_EQ(ToPoseSample(header, child, pose).child_frame, "") << child;
  }
  EXPECT_EQ(ToPoseSample(header, "/body", pose).child_frame, "body");
}

TEST(ToCalibration, TakesWideCameras) {
  sensor_msgs::CameraInfo info = MakeInfo();
  info.distortion_model = "omni-radtan";
  info.D = {1.5, -0.1, 0.05, 1e-3, 2e-3};
  EXPECT_EQ(ToCalibration(info, false).distortion, (LensDistortion{LensDistortion::Model::kUnified, info.D}));
  info.D = {1.5};
  EXPECT_REFUSED(ToCalibration(info, false), "1 coefficients: omni-radtan has 5");
  info.D = {-0.2, 0.6};
  info.distortion_model = "double_sphere";
  EXPECT_EQ(ToCalibration(info, false).distortion, (LensDistortion{LensDistortion::Model::kDoubleSphere, info.D}));
  info.D = {0.6, 1.1};
  info.distortion_model = "EUCM";
  EXPECT_EQ(ToCalibration(info, false).distortion, (LensDistortion{LensDistortion::Model::kExtendedUnified, info.D}));
  info.distortion_model = "equirectangular";
  info.D.clear();
  info.K.fill(0);  // nobody calibrates it
  EXPECT_REFUSED(ToCalibration(info, false), "camera_info: equirectangular image of 640x480");
  info.height = 320;
  const CameraCalibration sphere = ToCalibration(info, false);
  EXPECT_EQ(sphere.distortion.model, LensDistortion::Model::kEquirectangular);
  EXPECT_NEAR(sphere.MakeLens().Project({1, 0, 0})->x(), 479.5, 1e-9);
  info.roi.width = 320;
  info.roi.height = 160;
  EXPECT_REFUSED(ToCalibration(info, false), "show the whole sphere");

  info = MakeInfo();
  info.distortion_model = "equidistant";
  info.D = {-0.2, 0, 0, 0};
  EXPECT_REFUSED(ToCalibration(info, false, 190), "at least 95 degrees (field_of_view)");
  EXPECT_EQ(ToCalibration(info, false, 100).field_of_view, 100);
  EXPECT_REFUSED(ToCalibration(MakeInfo(), false, 190), "must be in [1, 180]");
}

TEST(ToCalibration, RefusesWhatCannotBeUsedAndNamesIt) {
  const auto refusal = [](const std::function<void(sensor_msgs::CameraInfo*)>& change) {
    sensor_msgs::CameraInfo info = MakeInfo();
    change(&info);
    return ErrorOf([&] { ToCalibration(info, false); });
  };
  EXPECT_THAT(refusal([](auto* info) { info->K[0] = 0; }), HasSubstr("K[0] = 0"));
  EXPECT_THAT(refusal([](auto* info) { info->K[2] = std::numeric_limits<double>::quiet_NaN(); }), HasSubstr("nan"));
  EXPECT_THAT(refusal([](auto* info) { info->distortion_model = "fov"; }), HasSubstr("fov"));
  EXPECT_THAT(refusal([](auto* info) { info->D = {1, 2, 3}; }), HasSubstr("3 coefficients"));
  EXPECT_THAT(refusal([](auto* info) { info->D[1] = std::numeric_limits<double>::infinity(); }), HasSubstr("inf"));
  EXPECT_THAT(refusal([](auto* info) { info->width = 32768; }), HasSubstr("32768x480"));
  // Numbers at the ends of 32 bits, which once divided INT_MIN by -1 and wrapped around.
  EXPECT_THAT(refusal([](auto* info) {
                info->width = info->height = 0x80000000;
                info->binning_x = info->binning_y = 0xffffffff;
              }),
              HasSubstr("2147483648x2147483648 pixels with binning 4294967295 and 4294967295"));
  EXPECT_THAT(refusal([](auto* info) {
                info->roi.x_offset = 0xffffffff;
                info->roi.width = info->roi.height = 2;
              }),
              HasSubstr("(4294967295, 0): must lie in 640x480"));
}

template <class T>
sensor_msgs::PointCloud2 MakeCloud(const std::vector<std::array<T, 3>>& points, uint8_t datatype) {
  sensor_msgs::PointCloud2 cloud;
  cloud.header.frame_id = "/map";
  cloud.header.stamp = ros::Time(5, 7);
  cloud.height = 1;
  cloud.width = static_cast<uint32_t>(points.size());
  cloud.point_step = 3 * sizeof(T) + 4;  // a field in front that nobody reads
  cloud.row_step = cloud.point_step * cloud.width;
  const char* names[] = {"x", "y", "z"};
  for (uint32_t i = 0; i < 3; ++i) {
    sensor_msgs::PointField field;
    field.name = names[i];
    field.offset = 4 + i * static_cast<uint32_t>(sizeof(T));
    field.datatype = datatype;
    field.count = 1;
    cloud.fields.push_back(field);
  }
  for (const auto& point : points) {
    const auto* bytes = reinterpret_cast<const uint8_t*>(point.data());
    cloud.data.insert(cloud.data.end(), 4, 0xee);
    cloud.data.insert(cloud.data.end(), bytes, bytes + 3 * sizeof(T));
  }
  return cloud;
}

TEST(ToSparseCloud, ReadsBothPrecisionsAndLeavesOutWhatIsNoPoint) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const auto cloud = ToSparseCloud(
      MakeCloud<float>({{1, 2, 3}, {0, 0, 0}, {nan, 0, 0}, {0, inf, 0}, {0, 0, -1}}, sensor_msgs::PointField::FLOAT32));
  ASSERT_EQ(cloud.points.size(), 2u);
  EXPECT_EQ(cloud.points[0], Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(cloud.points[1], Eigen::Vector3d(0, 0, -1));
  EXPECT_EQ(cloud.zero, 1u);
  EXPECT_EQ(cloud.not_finite, 2u);
  EXPECT_EQ(cloud.frame_id, "map");
  EXPECT_EQ(cloud.stamp_ns, 5000000007);
  const auto precise = ToSparseCloud(MakeCloud<double>({{1e-9, 2, 3}}, sensor_msgs::PointField::FLOAT64));
  EXPECT_EQ(precise.points.at(0).x(), 1e-9);
  EXPECT_TRUE(ToSparseCloud(MakeCloud<float>({}, sensor_msgs::PointField::FLOAT32)).points.empty());
}

TEST(ToSparseCloud, ReadsOrganisedCloudsWithPaddedRows) {
  sensor_msgs::PointCloud2 cloud =
      MakeCloud<float>({{1, 1, 1}, {2, 2, 2}, {3, 3, 3}, {4, 4, 4}}, sensor_msgs::PointField::FLOAT32);
  cloud.width = cloud.height = 2;
  cloud.row_step = 2 * cloud.point_step + 8;
  cloud.data.insert(cloud.data.begin() + 2 * cloud.point_step, 8, 0xaa);
  const auto points = ToSparseCloud(cloud).points;
  ASSERT_EQ(points.size(), 4u);
  EXPECT_EQ(points[2].x(), 3);
}

TEST(ToSparseCloud, RefusesMalformedClouds) {
  using Cloud = sensor_msgs::PointCloud2;
  const auto refusal = [](const std::function<void(Cloud*)>& change) {
    Cloud cloud = MakeCloud<float>({{1, 2, 3}}, sensor_msgs::PointField::FLOAT32);
    change(&cloud);
    return ErrorOf([&] { ToSparseCloud(cloud); });
  };
  EXPECT_THAT(refusal([](Cloud* c) { c->fields.pop_back(); }), HasSubstr("no field \"z\""));
  EXPECT_THAT(refusal([](Cloud* c) { c->fields[1].datatype = sensor_msgs::PointField::INT32; }), HasAll("\"y\"", "5"));
  EXPECT_THAT(refusal([](Cloud* c) { c->width = 2; }), HasSubstr("16 bytes: needs 32"));
  EXPECT_THAT(refusal([](Cloud* c) { c->fields[2].offset = 1000; }), HasSubstr("point_step"));
  EXPECT_THAT(refusal([](Cloud* c) { c->fields[2].offset = 0xfffffffc; }),  // wraps to 0 in 32 bits
              HasAll("4294967292", "point_step = 16"));
  EXPECT_THAT(refusal([](Cloud* c) { c->is_bigendian = true; }), HasSubstr("bigendian"));
}

TEST(CheckLengths, RefusesWhatIsNotThere) {
  sensor_msgs::PointCloud cloud;
  cloud.header.frame_id = "camera";
  cloud.points.resize(3);
  cloud.channels.resize(2);
  cloud.channels[1].values.resize(5);
  std::vector<uint8_t> bytes(ros::serialization::serializationLength(cloud));
  ros::serialization::OStream stream(bytes.data(), static_cast<uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, cloud);
  const auto check = [&] { CheckLengths<sensor_msgs::PointCloud>(bytes.data(), bytes.size()); };
  EXPECT_EQ(ErrorOf(check), "no error");
  const size_t points = 4 + 8 + 4 + cloud.header.frame_id.size();  // after seq, stamp and frame_id
  ASSERT_EQ(bytes[points], 3);
  bytes[points + 3] = 0x20;  // 2^29 points, 6 GB
  EXPECT_THAT(ErrorOf(check), HasSubstr("a message claims 1 elements of 4 bytes, where"));
  bytes[points + 3] = 0;
  bytes[bytes.size() - 5 * 4 - 1] = 0xff;
  EXPECT_THAT(ErrorOf(check), HasSubstr("a message claims 4278190085 elements of 4 bytes, where 20 bytes are left"));
}

template <class T>
boost::shared_ptr<sensor_msgs::Image> MakeMessage(const std::string& encoding, uint32_t width, uint32_t height,
                                                  uint32_t padding, const std::vector<T>& values) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = ros::Time(7, 8);
  message->encoding = encoding;
  message->width = width;
  message->height = height;
  message->step = width * sizeof(T) + padding;
  message->data.resize(static_cast<size_t>(message->step) * height, 99);
  for (uint32_t row = 0; row < height; ++row) {
    std::memcpy(message->data.data() + row * message->step, values.data() + row * width, width * sizeof(T));
  }
  return message;
}

std::vector<float> Decode(const sensor_msgs::ImageConstPtr& message) {
  const ImageSample sample = ToPriorDepthSample(message);
  EXPECT_EQ(sample.stamp_ns, 7000000008);
  const DepthMap depth = DecodePriorDepth(*sample.image);
  EXPECT_EQ(depth.width(), static_cast<int>(message->width));
  return {depth.begin(), depth.end()};
}

TEST(MaskMessage, IsReadRowByRowWithoutPadding) {
  const PinholeCamera camera = {3, 2, 3, 3, 1, 0.5};
  for (const char* encoding : {"mono8", "8UC1"}) {
    const ImageSample sample = ToMaskSample(MakeMessage<uint8_t>(encoding, 3, 2, 1, {0, 1, 255, 7, 0, 0}));
    EXPECT_EQ(sample.stamp_ns, 7000000008);
    const Mask mask = DecodeMask(*sample.image, camera);
    EXPECT_THAT(std::vector<unsigned char>(mask.begin(), mask.end()), ElementsAre(0, 1, 255, 7, 0, 0));
  }
  const ImageSample turned = ToMaskSample(MakeMessage<uint8_t>("mono8", 2, 3, 0, {0, 1, 255, 7, 0, 0}));
  EXPECT_REFUSED(DecodeMask(*turned.image, camera), "2x3", "3x2");
}

TEST(LabelMessage, HasEightOrSixteenBits) {
  const PinholeCamera camera = {3, 1, 3, 3, 1, 0};
  const auto labels_of = [&](const sensor_msgs::ImageConstPtr& message) {
    const LabelImage labels = DecodeLabels(*ToLabelSample(message).image, camera);
    return std::vector<int>(labels.begin(), labels.end());
  };
  for (const char* encoding : {"mono8", "8UC1"}) {
    EXPECT_THAT(labels_of(MakeMessage<uint8_t>(encoding, 3, 1, 1, {0, 7, 255})), ElementsAre(0, 7, 255));
  }
  for (const char* encoding : {"mono16", "16UC1"}) {
    EXPECT_THAT(labels_of(MakeMessage<uint16_t>(encoding, 3, 1, 1, {0, 7, 255})), ElementsAre(0, 7, 255));
  }
  const auto swapped = MakeMessage<uint16_t>("16UC1", 3, 1, 0, {0, 0x0700, 0});
  swapped->is_bigendian = 1;
  EXPECT_THAT(labels_of(swapped), ElementsAre(0, 7, 0));
  EXPECT_REFUSED(labels_of(MakeMessage<uint16_t>("16UC1", 3, 1, 0, {0, 0, 256})), "(2, 0)", "256", "255");
  EXPECT_REFUSED(labels_of(MakeMessage<uint8_t>("8UC1", 2, 3, 0, {0, 1, 255, 7, 0, 0})), "2x3", "3x1");
  EXPECT_REFUSED(labels_of(MakeMessage<float>("32FC1", 3, 1, 0, {0, 1, 2})), "32FC1", "16UC1");
}

TEST(PriorDepthMessage, FloatIsReadAsItIsAndWhatIsNoDepthIsUnknown) {
  const auto message = MakeMessage<float>("32FC1", 3, 2, 4, {1.5f, NAN, -2, INFINITY, 0, 7});
  EXPECT_THAT(Decode(message), ElementsAre(1.5f, 0, 0, 0, 0, 7));
}

TEST(PriorDepthMessage, SixteenBitsAreThousandthsInEitherOrderOfBytes) {
  for (const char* encoding : {"16UC1", "mono16"}) {
    EXPECT_THAT(Decode(MakeMessage<uint16_t>(encoding, 2, 1, 0, {1500, 0})), ElementsAre(1.5f, 0));
  }
  const auto swapped = MakeMessage<uint16_t>("16UC1", 2, 1, 0, {0xdc05, 0});
  swapped->is_bigendian = 1;
  EXPECT_THAT(Decode(swapped), ElementsAre(1.5f, 0));
}

TEST(PriorDepthMessage, WithoutAnyDepthIsRefused) {
  const auto message = MakeMessage<float>("32FC1", 2, 1, 0, {NAN, -1});
  EXPECT_REFUSED(DecodePriorDepth(*ToPriorDepthSample(message).image), "no pixel");
}

}  // namespace
}  // namespace acmp
