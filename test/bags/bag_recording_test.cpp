#include "acmp_mapping/bags/bag_recording.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

using RecordSyntheticTest = TestFolder;

template <class Message>
std::vector<boost::shared_ptr<Message>> ReadAll(const std::filesystem::path& path, const std::string& topic) {
  rosbag::Bag bag(path.string(), rosbag::bagmode::Read);
  std::vector<boost::shared_ptr<Message>> messages;
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery(topic))) {
    messages.push_back(message.instantiate<Message>());
  }
  return messages;
}

/// Two images of 8x6 px; image 1 is seen from one unit to the right of image 0, turned by 90 degrees about y.
class RecordSceneTest : public TestFolder {
 protected:
  RecordSceneTest() {
    ColorImage picture(8, 6);
    for (int row = 0; row < 6; ++row) {
      for (int col = 0; col < 8; ++col) {
        picture(col, row) = {static_cast<unsigned char>(10 * col), static_cast<unsigned char>(20 * row), 200};
      }
    }
    scene_.landmarks_in_world = {{0.5, -0.25, 2}, {1, 2, 3}, {-4, 5, 6}};
    for (int i = 0; i < 2; ++i) {
      SceneImage image;
      image.name = std::to_string(i) + ".png";
      image.path = folder() / image.name;
      WritePng(image.path, picture);
      image.camera = {8, 6, 7.0, 7.5, 3.5, 2.5};
      image.landmark_indices = i == 0 ? std::vector<int>{0, 2} : std::vector<int>{1};
      scene_.images.push_back(image);
    }
    RigidTransform world_from_cam = RigidTransform::Identity();
    world_from_cam.linear() = Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitY()).toRotationMatrix();
    world_from_cam.translation() = Eigen::Vector3d(1, 0, 0);
    scene_.images[1].cam_from_world = world_from_cam.inverse();
  }

  Scene scene_;
};

TEST_F(RecordSyntheticTest, TheSecondCameraIsThatOfARectifiedPair) {
  SyntheticSceneOptions scene = {48, 36, 2};
  scene.stereo_baseline_m = 0.2;
  const std::vector<SyntheticView> views = MakeSyntheticScene(scene);
  RecordSynthetic(views, {}, folder() / "a.bag");
  const auto images = ReadAll<sensor_msgs::Image>(folder() / "a.bag", kRightImageTopic);
  const auto infos = ReadAll<sensor_msgs::CameraInfo>(folder() / "a.bag", kRightCameraInfoTopic);
  ASSERT_EQ(images.size(), 2u);
  ASSERT_EQ(infos.size(), 2u);
  EXPECT_EQ(images[1]->header.stamp, infos[1]->header.stamp);
  EXPECT_EQ(images[1]->data, ToColorMessage(views[1].right->color, {})->data);
  EXPECT_NEAR(infos[1]->P[3], -0.2 * infos[1]->P[0], 1e-9);  // inverted and multiplied in double
}

TEST_F(RecordSceneTest, RecordsPosesAsWorldFromCamera) {
  RecordScene(scene_, {0, 1}, {}, folder() / "out.bag");
  const auto poses = ReadAll<geometry_msgs::PoseStamped>(folder() / "out.bag", kPoseTopic);
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[1]->header.frame_id, "world");
  // The fixture's pose, by hand: one unit along x, half angle 45 degrees about y. 1e-12: two inversions in double.
  EXPECT_NEAR(poses[1]->pose.position.x, 1, 1e-12);
  EXPECT_NEAR(poses[1]->pose.position.z, 0, 1e-12);
  EXPECT_NEAR(poses[1]->pose.orientation.y, std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(poses[1]->pose.orientation.w, std::sqrt(0.5), 1e-12);
  const auto tf = ReadAll<tf2_msgs::TFMessage>(folder() / "out.bag", kTfTopic);
  ASSERT_EQ(tf.size(), 2u);
  EXPECT_EQ(tf[1]->transforms[0].child_frame_id, "camera_optical");
  EXPECT_EQ(tf[1]->transforms[0].transform.translation.x, poses[1]->pose.position.x);
}

TEST_F(RecordSceneTest, ShrinksImageAndCameraTogether) {
  RecordingOptions options;
  options.max_image_size = 4;
  RecordScene(scene_, {0}, options, folder() / "out.bag");
  const auto images = ReadAll<sensor_msgs::Image>(folder() / "out.bag", kImageTopic);
  const auto infos = ReadAll<sensor_msgs::CameraInfo>(folder() / "out.bag", kCameraInfoTopic);
  ASSERT_EQ(images.size(), 1u);
  EXPECT_EQ(images[0]->width, 4u);
  EXPECT_EQ(images[0]->height, 3u);
  EXPECT_EQ(infos[0]->width, 4u);
  EXPECT_DOUBLE_EQ(infos[0]->K[0], 3.5);
  EXPECT_DOUBLE_EQ(infos[0]->K[2], (3.5 + 0.5) / 2 - 0.5);  // pixel centres at integers
}

TEST_F(RecordSceneTest, RecordsMasksAtTheSizeOfTheirImages) {
  ColorImage picture(8, 6, {255, 255, 255});
  picture(1, 3) = {0, 0, 0};
  WritePng(folder() / "1.png.png", picture);
  AddMasks(folder(), &scene_);
  RecordingOptions options;
  options.max_image_size = 4;
  EXPECT_EQ(RecordScene(scene_, {0, 1}, options, folder() / "out.bag").masks, 1u);
  const auto masks = ReadAll<sensor_msgs::Image>(folder() / "out.bag", kMaskTopic);
  ASSERT_EQ(masks.size(), 1u);
  EXPECT_EQ(masks[0]->header.stamp, StampOf(1, options));
  const std::vector<int> shape = {static_cast<int>(masks[0]->width), static_cast<int>(masks[0]->height)};
  EXPECT_THAT(shape, ElementsAre(4, 3));
  for (size_t i = 0; i < masks[0]->data.size(); ++i) EXPECT_EQ(masks[0]->data[i] == 0, i == 4) << i;

  WritePng(folder() / "1.png.png", ColorImage(4, 3));
  EXPECT_THROW(RecordScene(scene_, {1}, options, folder() / "out.bag"), InvalidInputError);
}

TEST_F(RecordSceneTest, ATruncatedImageLeavesNoBag) {
  const std::string bytes = ReadText(scene_.images[1].path);
  WriteText("1.png", bytes.substr(0, bytes.size() / 2));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] {
                RecordScene(scene_, {0, 1}, {}, folder() / "out.bag");
              }),
              HasSubstr("1.png"));
  EXPECT_FALSE(std::filesystem::exists(folder() / "out.bag"));
  EXPECT_FALSE(std::filesystem::exists(folder() / "out.bag.acmp.partial"));
}

TEST(ToCameraInfo, NamesTheDistortionAsTheMapperReadsIt) {
  using Model = LensDistortion::Model;
  const PinholeCamera camera{640, 320, 500, 501, 320, 160};
  const LensDistortion lenses[] = {{Model::kBrownConrady, {0.1, 0.01, 0, 0, 0}},
                                   {Model::kRational, {0.1, 0.01, 0, 0, 0, 0.1, 0, 0}},
                                   {Model::kEquidistant, {0.1, 0.01, 0, 0}},
                                   {Model::kUnified, {1, 0.1, 0, 0, 0}},
                                   {Model::kExtendedUnified, {0.6, 1.1}},
                                   {Model::kDoubleSphere, {-0.2, 0.6}},
                                   {Model::kEquirectangular, {}}};
  for (const LensDistortion& lens : lenses) {
    const sensor_msgs::CameraInfo info = ToCameraInfo(camera, lens, {});
    EXPECT_EQ(ToCalibration(info, false).distortion, lens) << info.distortion_model;
  }
  EXPECT_EQ(ToCameraInfo(camera, {}, {}).distortion_model, "plumb_bob");
  EXPECT_THAT(ToCameraInfo(camera, {}, {}).D, ElementsAre(0, 0, 0, 0, 0));
  EXPECT_THROW(ToCameraInfo(camera, {Model::kEquidistant, {1, 2, 3, 4, 5}}, {}), InvalidInputError);
}

}  // namespace
}  // namespace acmp
