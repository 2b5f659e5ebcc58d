#include "acmp_mapping/bags/bag_check.h"

#include <cmath>
#include <functional>
#include <limits>

#include <geometry_msgs/PoseStamped.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/PointCloud.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <std_msgs/String.h>

#include "acmp_mapping/bags/bag_recording.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace acmp {
namespace {

constexpr int kKeyframes = 6;

/// Messages of one keyframe; a test damages them before they are written.
struct Keyframe {
  sensor_msgs::Image image;
  sensor_msgs::CameraInfo info;
  geometry_msgs::PoseStamped pose;
  sensor_msgs::PointCloud2 cloud;
};

/// A camera that moves along x and looks along z at points on a wall 4 units away, all in view.
Keyframe MakeKeyframe(int index) {
  const PinholeCamera camera{32, 24, 30, 30, 15.5, 11.5};
  std_msgs::Header header;
  header.stamp = ros::Time(1000 + index, 0);
  header.frame_id = "cam";
  Keyframe keyframe;
  keyframe.image = *ToColorMessage(ColorImage(camera.width, camera.height), header);
  keyframe.info = ToCameraInfo(camera, {}, header);
  header.frame_id = "map";
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.translation() = Eigen::Vector3d(5 + 0.2 * index, 3, -1);
  keyframe.pose = ToPoseStamped(world_from_cam.inverse(), header);
  std::vector<Eigen::Vector3d> points;
  points.reserve(40);
  for (int i = 0; i < 40; ++i) points.push_back(world_from_cam * camera.Unproject({i * 0.7, i * 0.5}, 4.0));
  keyframe.cloud = ToPointCloud2(points, header);
  return keyframe;
}

nav_msgs::Odometry OdometryOf(const Keyframe& keyframe, const std::string& child_frame = "") {
  nav_msgs::Odometry odometry;
  odometry.header = keyframe.pose.header;
  odometry.child_frame_id = child_frame;
  odometry.pose.pose = keyframe.pose.pose;
  return odometry;
}

class CheckBagTest : public TestFolder {
 protected:
  using Change = std::function<void(int index, Keyframe&)>;
  using Write = std::function<void(int index, const Keyframe&, rosbag::Bag*)>;

  /// Checks a bag to which `write` writes each keyframe, received at its stamp.
  BagReport CheckWritten(const Write& write, const BagCheckOptions& options = {}) const {
    {
      rosbag::Bag bag(Path(), rosbag::bagmode::Write);
      for (int i = 0; i < kKeyframes; ++i) write(i, MakeKeyframe(i), &bag);
    }
    return CheckBags({Path()}, options);
  }

  /// Checks a healthy bag but for `change`, and for what `add` adds.
  BagReport Check(const Change& change = {}, const BagCheckOptions& options = {}, const Write& add = {}) const {
    const auto write = [&](int i, Keyframe keyframe, rosbag::Bag* bag) {
      if (add) add(i, keyframe, bag);
      if (change) change(i, keyframe);
      const ros::Time receive(1000 + i, 5000000);
      bag->write("/image", receive, keyframe.image);
      bag->write("/info", receive, keyframe.info);
      bag->write("/pose", receive, keyframe.pose);
      bag->write("/points", receive, keyframe.cloud);
    };
    return CheckWritten(write, options);
  }

  std::string Path() const { return (folder() / "test.bag").string(); }
};

std::vector<std::string> Messages(const BagReport& report, Severity severity) {
  std::vector<std::string> messages;
  for (const Finding& finding : report.findings) {
    if (finding.severity == severity) messages.push_back(finding.message);
  }
  return messages;
}

std::vector<std::string> Errors(const BagReport& report) { return Messages(report, Severity::kError); }
std::vector<std::string> Warnings(const BagReport& report) { return Messages(report, Severity::kWarning); }

TEST_F(CheckBagTest, AHealthyBagHasNothingToReport) {
  const BagReport report = Check();
  EXPECT_TRUE(Errors(report).empty()) << testing::PrintToString(Errors(report));
  EXPECT_TRUE(Warnings(report).empty()) << testing::PrintToString(Warnings(report));
  EXPECT_TRUE(report.usable());
  EXPECT_EQ(report.chosen.image, "/image");
  EXPECT_EQ(report.chosen.pose, "/pose");
  EXPECT_EQ(report.topics.size(), 4u);
  EXPECT_THAT(Messages(report, Severity::kOk), Contains(HasSubstr("the mapper takes 6 of 6 images")));
}

/// In the mapper's words, whose tests have the others: bad_input_rostest, input_conversion_test.
TEST_F(CheckBagTest, WhatIsWrongIsNamed) {
  const auto set_stamp = [](double seconds) {
    return [seconds](int, Keyframe& keyframe) { keyframe.pose.header.stamp += ros::Duration(seconds); };
  };
  const struct {
    Severity severity;
    std::string words;  ///< of a finding; empty: there is none
    Change change;
  } cases[] = {{Severity::kWarning, "bad_camera_info, 6 times", [](int, Keyframe& k) { k.info.K.fill(0); }},
               {Severity::kError, "takes 0 of 6 images", [](int, Keyframe& k) { k.info.K.fill(0); }},
               {Severity::kWarning, "bad_pose, 2 times",
                [](int i, Keyframe& k) {
                  if (i == 1) k.pose.pose.position.x = std::nan("");
                  if (i > 1) k.pose.pose.orientation.w = i == 2 ? 1.002 : 1.0009;  // bound: 1e-3
                }},
               {Severity::kError, "0 get maps", [](int, Keyframe& k) { k.pose.pose = MakeKeyframe(0).pose.pose; }},
               {Severity::kWarning, "", set_stamp(900e-9)},
               {Severity::kError, "the mapper takes 0 of 6 images", set_stamp(1e6)},
               {Severity::kWarning, "nearest is 1e+09 ms away", set_stamp(1e6)},
               {Severity::kWarning, "nearest is 10 ms away", set_stamp(0.010)}};
  for (const auto& wrong : cases) {
    const std::vector<std::string> found = Messages(Check(wrong.change), wrong.severity);
    if (wrong.words.empty()) {
      EXPECT_THAT(found, testing::IsEmpty());
    } else {
      EXPECT_THAT(found, Contains(HasSubstr(wrong.words)));
    }
  }
}

TEST_F(CheckBagTest, MissingTopics) {
  {
    rosbag::Bag bag(Path(), rosbag::bagmode::Write);
    std_msgs::String text;
    text.data = "nothing to see";
    bag.write("/chatter", ros::Time(1, 0), text);
  }
  const BagReport report = CheckBags({Path()}, {});
  EXPECT_EQ(Errors(report).size(), 4u) << "no images, no camera_info, no poses, no maps";
  EXPECT_EQ(report.launch, "");
}

TEST_F(CheckBagTest, PosesFromTfOdometryCompressedImagesAndOldClouds) {
  const std::filesystem::path picture = folder() / "picture.png";
  WritePng(picture, ColorImage(32, 24));
  const std::string png = ReadText(picture);
  const auto check = [&](bool with_odometry) {
    return CheckWritten([&](int, const Keyframe& keyframe, rosbag::Bag* bag) {
      const ros::Time& stamp = keyframe.pose.header.stamp;
      sensor_msgs::CompressedImage compressed;
      compressed.header = keyframe.image.header;
      compressed.format = "bgr8; jpeg compressed bgr8";
      compressed.data.assign(png.begin(), png.end());
      sensor_msgs::PointCloud cloud;
      cloud.header = keyframe.cloud.header;
      for (sensor_msgs::PointCloud2ConstIterator<float> at(keyframe.cloud, "x"); at != at.end(); ++at) {
        geometry_msgs::Point32 point;
        point.x = at[0], point.y = at[1], point.z = at[2];
        cloud.points.push_back(point);
      }
      bag->write("/image/compressed", stamp, compressed);
      bag->write("/info", stamp, keyframe.info);
      bag->write("/tf", stamp, ToTf(keyframe.pose, "cam"));
      bag->write("/cloud", stamp, cloud);
      if (with_odometry) bag->write("/odom", stamp, OdometryOf(keyframe));
    });
  };
  const BagReport from_tf = check(false);
  EXPECT_TRUE(Errors(from_tf).empty()) << testing::PrintToString(Errors(from_tf));
  EXPECT_THAT(from_tf.launch, HasSubstr("image:=/image image_transport:=compressed"));
  EXPECT_THAT(from_tf.launch, HasSubstr("pose_source:=tf world_frame:=map"));
  EXPECT_THAT(Messages(from_tf, Severity::kOk), Contains(HasSubstr("the mapper takes 6 of 6 images")));
  const BagReport from_odometry = check(true);
  EXPECT_EQ(from_odometry.chosen.pose, "/odom");
  EXPECT_THAT(from_odometry.launch, HasSubstr("pose_source:=odom odom:=/odom sparse_points_v1:=/cloud"));
  // An Image whose topic is named like that is taken by its whole name.
  const BagReport raw = CheckWritten([](int, const Keyframe& keyframe, rosbag::Bag* bag) {
    const ros::Time& stamp = keyframe.pose.header.stamp;
    bag->write("/image/compressed", stamp, keyframe.image);
    bag->write("/image/camera_info", stamp, keyframe.info);
    bag->write("/pose", stamp, keyframe.pose);
    bag->write("/points", stamp, keyframe.cloud);
  });
  EXPECT_TRUE(raw.usable()) << testing::PrintToString(Errors(raw));
  EXPECT_THAT(raw.launch, HasSubstr("image:=/image/compressed camera_info:=/image/camera_info"));
  EXPECT_TRUE(from_odometry.usable()) << testing::PrintToString(Errors(from_odometry));
}

TEST_F(CheckBagTest, ARecordingOfAnImuAndAnRgbdCamera) {
  const BagReport report = CheckWritten([](int i, const Keyframe& keyframe, rosbag::Bag* bag) {
    const ros::Time& stamp = keyframe.pose.header.stamp;
    bag->write("/vio/odometry", stamp, OdometryOf(keyframe, "imu"));
    bag->write("/camera/color/image_raw", stamp, keyframe.image);
    for (const double late : {0.0, 0.4}) {  // more of them than colour images
      sensor_msgs::Image depth =
          *ToDepthMessage(DepthMap(32, 24, 1.0f), Image<unsigned char>(32, 24, 1).View(), keyframe.image.header);
      depth.header.stamp += ros::Duration(late);
      bag->write("/camera/depth/image", stamp, depth);
      bag->write("/camera/depth/camera_info", stamp, keyframe.info);
    }
    bag->write("/camera/color/camera_info", stamp, keyframe.info);
    bag->write("/vio/points", stamp, keyframe.cloud);
    if (i > 0) return;
    std_msgs::Header in_imu = keyframe.pose.header;
    in_imu.frame_id = "imu";
    bag->write("/tf_static", ros::Time(1000, 0), ToTf(ToPoseStamped(RigidTransform::Identity(), in_imu), "cam"));
  });
  EXPECT_TRUE(report.usable()) << testing::PrintToString(Errors(report));
  EXPECT_THAT(Warnings(report), Contains(HasAll("\"imu\"", "set ~pose_child: body")));
  EXPECT_EQ(report.launch,
            "roslaunch acmp_mapping dense_mapper.launch namespace:=acmp "
            "image:=/camera/color/image_raw "
            "camera_info:=/camera/color/camera_info pose_source:=odom "
            "odom:=/vio/odometry pose_child:=body sparse_points:=/vio/points");
}

/// Images of a room with their poses as a frontend that means `truth` sends them, child frame "imu", and T_body_cam in
/// tf_static.
class ReadingsOfABagTest : public CheckBagTest {
 protected:
  /// @param is_joint T_body_cam is sent with each image on /tf
  void Write(const PoseSemantics& truth, const std::optional<RigidTransform>& in_tf, bool is_joint = false) {
    static const std::vector<SyntheticView> views = MakeSyntheticScene({160, 120, 10});
    rosbag::Bag bag(Path(), rosbag::bagmode::Write);
    for (size_t i = 0; i < views.size(); ++i) {
      const Frame& frame = views[i].frame;
      std_msgs::Header header;
      header.stamp = ros::Time(1000 + i, 0);
      header.frame_id = "cam";
      bag.write("/image", header.stamp, *ToColorMessage(frame.color, header));
      bag.write("/camera_info", header.stamp, *ToCameraInfo(frame.camera, header));
      header.frame_id = "map";
      const RigidTransform child_from_world = ChildFromCamera(truth) * frame.cam_from_world;
      const bool inverse = truth.direction == PoseSemantics::Direction::kCamFromWorld;
      nav_msgs::Odometry odometry;
      odometry.child_frame_id = "imu";
      odometry.pose.pose = ToPoseStamped(inverse ? child_from_world.inverse() : child_from_world, header).pose;
      odometry.header = header;
      bag.write("/odom", header.stamp, odometry);
      bag.write("/points", header.stamp, ToPointCloud2(frame.landmarks_in_world, header));
      if (!in_tf || (i > 0 && !is_joint)) continue;
      header.frame_id = "imu";
      bag.write(is_joint ? "/tf" : "/tf_static", header.stamp, ToTf(ToPoseStamped(in_tf->inverse(), header), "cam"));
    }
  }
};

TEST_F(ReadingsOfABagTest, ImagesTellHowPosesAreMeant) {
  using Child = PoseSemantics::Child;
  using Direction = PoseSemantics::Direction;
  RigidTransform body_from_cam = RigidTransform::Identity();
  body_from_cam.linear() = Eigen::AngleAxisd(1.2, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  body_from_cam.translation() = Eigen::Vector3d(0.1, 0, 0.05);
  const struct {
    PoseSemantics truth;
    std::optional<RigidTransform> in_tf;
    std::string finding;  ///< a warning
    std::string launch;   ///< how the launch line ends, after the poses' topic; "-": there must be none
    bool is_joint = false;
  } cases[] = {
      {{}, body_from_cam, "", ""},  // the frames alone would say: poses of the body
      {{Direction::kCamFromWorld, Child::kCameraOptical}, {}, "set ~pose_is: T_cam_world", " pose_is:=T_cam_world"},
      {{Direction::kWorldFromCam, Child::kCameraFlu}, {}, "~pose_child: camera_flu", " pose_child:=camera_flu"},
      {{Direction::kWorldFromCam, Child::kBody, body_from_cam},
       body_from_cam,
       "~pose_child: body",
       " pose_child:=body"},
      {{Direction::kWorldFromCam, Child::kBody, body_from_cam},
       body_from_cam,
       "~pose_child: body",
       " pose_child:=body",
       true},
      {{Direction::kWorldFromCam, Child::kBody, body_from_cam},
       body_from_cam.inverse(),
       "what fits is the inverse of T_body_cam",
       "-"},
      // Turns about one axis do not tell T_body_cam.
      {{Direction::kWorldFromCam, Child::kBody, body_from_cam}, {}, "poses of a body (~pose_child: body)", "-"}};
  for (const auto& example : cases) {
    SCOPED_TRACE(Describe(example.truth) + example.finding);
    Write(example.truth, example.in_tf, example.is_joint);
    BagCheckOptions options;
    options.trial_size = 40;  // faster
    const BagReport report = CheckBags({Path()}, options);
    const bool may_be_used = example.launch != "-";
    const std::vector<std::string> readings = may_be_used ? Warnings(report) : Errors(report);
    const auto names_reading = testing::StartsWith("set ~pose");
    if (example.finding.empty()) {
      EXPECT_THAT(readings, Not(Contains(names_reading)));
    } else {
      EXPECT_THAT(readings, Contains(HasSubstr(example.finding)));
    }
    EXPECT_EQ(report.usable(), may_be_used);
    EXPECT_THAT(report.launch, may_be_used ? testing::Matcher<std::string>(
                                                 HasSubstr("odom:=/odom" + example.launch + " sparse_points:=/points"))
                                           : testing::Matcher<std::string>(testing::IsEmpty()));
  }
  Write({}, {});
  BagCheckOptions wrong;
  wrong.trial_size = 40;
  wrong.mapper.pose.child = Child::kCameraFlu;
  const BagReport report = CheckBags({Path()}, wrong);
  EXPECT_THAT(Warnings(report), Contains(HasSubstr("~pose_child: camera_optical")));
  EXPECT_THAT(report.launch, HasSubstr("odom:=/odom sparse_points:=/points")) << "not the wrong one that was given";
}

TEST_F(CheckBagTest, ASecondCameraIsASourceCameraWhenItIsAskedFor) {
  const auto check_with = [&](double baseline, const BagCheckOptions& options) {
    return Check({}, options, [&](int, Keyframe keyframe, rosbag::Bag* bag) {
      keyframe.info.P[3] = -baseline * keyframe.info.P[0];
      bag->write("/right/image", keyframe.image.header.stamp, keyframe.image);
      bag->write("/right/camera_info", keyframe.image.header.stamp, keyframe.info);
    });
  };
  const std::string arguments = "stereo:=true source_image:=/right/image source_camera_info:=/right/camera_info";
  BagCheckOptions asked;
  asked.topics.image = "/image";
  asked.topics.camera_info = "/info";
  BagReport report = check_with(0.1, asked);
  EXPECT_THAT(Messages(report, Severity::kOk), Contains(HasSubstr("--source-image /right/image")));
  EXPECT_THAT(report.launch, Not(HasSubstr("stereo"))) << "nobody has said that it is fixed to the other";
  asked.topics.source_images = {"/right/image"};
  report = check_with(0.1, asked);
  EXPECT_TRUE(report.usable()) << testing::PrintToString(Errors(report));
  EXPECT_THAT(report.launch, HasSubstr(arguments));
  EXPECT_THAT(Messages(report, Severity::kOk), Contains(HasSubstr("source camera 1 is at (0.1")));
  report = check_with(0, asked);
  EXPECT_THAT(Warnings(report), Contains(HasAll("source_camera_unplaced", "~T_cam_source")));
}

TEST_F(CheckBagTest, ACalibrationFileTakesThePlaceOfCameraInfo) {
  BagCheckOptions options;
  options.mapper.calibration_file = WriteText("camera.yaml", R"(image_width: 32
image_height: 24
camera_name: cam
camera_matrix: {rows: 3, cols: 3, data: [30, 0, 15.5, 0, 30, 11.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [30, 0, 15.5, 0, 0, 30, 11.5, 0, 0, 0, 1, 0]}
)")
                                        .string();
  const BagReport report = Check([](int, Keyframe& keyframe) { keyframe.info.K.fill(0); }, options);
  EXPECT_TRUE(report.usable()) << testing::PrintToString(Errors(report));
  EXPECT_THAT(report.launch, HasSubstr("calibration_file:=" + options.mapper.calibration_file));
}

TEST_F(CheckBagTest, AskedForTopics) {
  BagCheckOptions options;
  options.topics.image = "/camera/image";
  EXPECT_THROW(Check({}, options), InvalidInputError);
  options.topics.image = "/pose";
  EXPECT_THROW(Check({}, options), InvalidInputError);
  options.topics.image = "/image";
  EXPECT_NO_THROW(Check({}, options));
  options.topics.source_camera_infos = {"/info"};
  EXPECT_THROW(Check({}, options), InvalidInputError) << "of no source image";
  options.topics.source_images.assign(5, "/image");
  EXPECT_THROW(Check({}, options), InvalidInputError) << "more than the mapper takes";
}

TEST_F(CheckBagTest, SeveralTopicsOfAKind) {
  const BagReport report = Check({}, {}, [](int i, const Keyframe& keyframe, rosbag::Bag* bag) {
    if (i == 1) bag->write("/right/image", ros::Time(1001, 0), keyframe.image);
  });
  EXPECT_EQ(report.chosen.image, "/image");  // the one with more messages
  EXPECT_THAT(Warnings(report), Contains(HasSubstr("checked /image; there is also /right/image")));
}

TEST_F(CheckBagTest, MasksAndLabels) {
  const BagReport good = Check({}, {}, [&](int i, const Keyframe& keyframe, rosbag::Bag* bag) {
    const ros::Time& stamp = keyframe.image.header.stamp;
    bag->write("/detector/labels", stamp,
               *ToMono8Message(LabelImage(32, 24, 1), keyframe.image.header));  // no camera's
    if (i == kKeyframes - 1) return;
    bag->write("/detector/mask", stamp, *ToMono8Message(Mask(32, 24, 255), keyframe.image.header));
  });
  EXPECT_EQ(good.chosen.image, "/image");
  EXPECT_EQ(good.chosen.mask, "/detector/mask");
  EXPECT_THAT(good.launch, HasSubstr("mask:=/detector/mask labels:=/detector/labels"));
  EXPECT_THAT(Warnings(good), ElementsAre(HasSubstr("mask"))) << "of the image that has none";
}

/// Which has a pose for each of its images, most of them a centimetre apart.
TEST_F(CheckBagTest, AVideoIsTriedAndStartedWithTheGate) {
  {
    rosbag::Bag bag(Path(), rosbag::bagmode::Write);
    for (int i = 0; i < 40; ++i) {
      Keyframe keyframe = MakeKeyframe(0);
      const ros::Time stamp(1000 + i / 20, 50000000 * (i % 20));
      keyframe.image.header.stamp = keyframe.info.header.stamp = stamp;
      keyframe.pose.header.stamp = keyframe.cloud.header.stamp = stamp;
      keyframe.pose.pose.position.x += 0.01 * i;
      bag.write("/image", stamp, keyframe.image);
      bag.write("/info", stamp, keyframe.info);
      bag.write("/pose", stamp, keyframe.pose);
      bag.write("/points", stamp, keyframe.cloud);
    }
  }
  const BagReport report = CheckBags({Path()}, {});
  EXPECT_TRUE(report.usable()) << testing::PrintToString(Errors(report));
  EXPECT_THAT(report.launch, testing::EndsWith("keyframe_mode:=gate"));
  EXPECT_THAT(Messages(report, Severity::kOk), Contains(HasSubstr("passes over")));
}

TEST_F(CheckBagTest, OneRecordingMayBeSeveralBags) {
  const std::vector<std::filesystem::path> parts = {folder() / "a.bag", folder() / "b.bag"};
  for (size_t part = 0; part < 2; ++part) {
    rosbag::Bag bag(parts[part].string(), rosbag::bagmode::Write);
    for (int i = 0; i < kKeyframes; ++i) {
      const Keyframe keyframe = MakeKeyframe(i);
      const ros::Time& stamp = keyframe.image.header.stamp;
      if (i == 0 && part == 0) bag.write("/info", stamp, keyframe.info);
      // The pose of an image at the seam is in the other part.
      if ((i < 3) == (part == 0)) bag.write("/image", stamp, keyframe.image);
      if ((i < 2) == (part == 0)) bag.write("/pose", stamp, keyframe.pose);
      if ((i < 3) == (part == 0)) bag.write("/points", stamp, keyframe.cloud);
    }
  }
  const BagReport report = CheckBags(parts, {});
  EXPECT_TRUE(report.usable()) << testing::PrintToString(Errors(report));
  EXPECT_THAT(Messages(report, Severity::kOk), Contains(HasSubstr("takes 6 of 6 images")));
}

TEST_F(CheckBagTest, ABagCutOffWhileRecordingIsToBeReindexed) {
  Check();
  std::string bytes = ReadText(Path());
  // While recording, the header's index position is 0; it is the only field named so.
  const size_t field = bytes.find("index_pos=");
  ASSERT_NE(field, std::string::npos);
  bytes.replace(field + 10, 8, std::string(8, '\0'));
  WriteText("test.bag", bytes);
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { CheckBags({Path()}, {}); }), HasSubstr("rosbag reindex"));
}

}  // namespace
}  // namespace acmp
