#include "acmp_mapping/dataset/camera_list.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>

#include "acmp_mapping/common/error.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class CameraListTest : public TestFolder {
 protected:
  std::filesystem::path Write(const std::string& lines) const {
    return WriteText("cameras.txt", "# a header\n" + lines);
  }
  std::string ErrorOf(const std::string& lines) const {
    return MessageOf<InvalidInputError>([&] { ReadCameraList(Write(lines)); });
  }
};

TEST_F(CameraListTest, IsReadBack) {
  ListedCamera camera = {{12, "sub/b.png"}, {40, 30, 100.25, 101, 1.0 / 3, 15}, RigidTransform::Identity()};
  camera.world_from_cam.linear() = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  camera.world_from_cam.translation() = Eigen::Vector3d(1, -2, 1e-3);
  WriteCameraList(folder() / "a.txt", {camera, camera});
  const auto read = ReadCameraList(folder() / "a.txt");
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[1].image.index, 12);
  EXPECT_EQ(read[1].image.name, "sub/b.png");
  EXPECT_EQ(read[1].camera.width, 40);
  EXPECT_EQ(read[1].camera.height, 30);
  EXPECT_NEAR(read[1].camera.cx, 1.0 / 3, 1e-14);
  EXPECT_TRUE(read[1].world_from_cam.isApprox(camera.world_from_cam, 1e-13));
}

TEST_F(CameraListTest, BadLinesAreNamed) {
  EXPECT_THAT(ErrorOf(""), HasSubstr("names 0 images"));
  EXPECT_THAT(ErrorOf("0 a.png 100 100\n"), AllOf(HasSubstr("cameras.txt:2"), HasSubstr("cx is missing")));
  EXPECT_THAT(ErrorOf("a.png 100 100 20 15 40 30 1 0 0 0 1 2 3\n"), HasSubstr("\"a.png\""));
  EXPECT_THAT(ErrorOf("0 a.png 100 100 20 15 40 30 0 0 0 0 1 2 3\n"), HasSubstr("quaternion of length 0"));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { ReadCameraList(folder() / "none"); }), HasSubstr("No such file"));
}

}  // namespace
}  // namespace acmp
