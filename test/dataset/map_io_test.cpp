#include <Eigen/Geometry>

#include <cmath>
#include <cstring>
#include <limits>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/geometry/lens.h"
#include "dataset/test_folder.h"
#include "fusion/engine_views.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using MapIoTest = TestFolder;

Image<float> Ramp(int width, int height) {
  Image<float> map(width, height);
  for (size_t i = 0; i < map.size(); ++i) map.data()[i] = 0.25f * static_cast<float>(i) + 0.1f;
  return map;
}

NormalMap NormalRamp(int width, int height) {
  NormalMap map(width, height);
  for (size_t i = 0; i < map.size(); ++i) map.data()[i] = {0.1f * i, -0.2f * i, -1.0f};
  return map;
}

template <class T>
bool SameBytes(const Image<T>& a, const Image<T>& b) {
  return a.width() == b.width() && a.height() == b.height() &&
         std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

TEST_F(MapIoTest, PfmRoundTripKeepsEveryBit) {
  Image<float> map = Ramp(5, 3);
  map(2, 1) = std::numeric_limits<float>::quiet_NaN();
  map(0, 0) = std::numeric_limits<float>::denorm_min();
  WritePfm(folder() / "a.pfm", map);
  EXPECT_TRUE(SameBytes(ReadPfm(folder() / "a.pfm"), map));
  const NormalMap normals = NormalRamp(3, 5);
  WritePfm(folder() / "n.pfm", normals);
  EXPECT_TRUE(SameBytes(ReadPfmNormals(folder() / "n.pfm"), normals));
}

TEST_F(MapIoTest, BigEndianPfmIsRead) {
  const auto path = WriteText("a.pfm", std::string("Pf\n1 1\n1.0\n") + std::string("\x3f\x80\x00\x00", 4));
  EXPECT_EQ(ReadPfm(path)(0, 0), 1.0f);
}

TEST_F(MapIoTest, DamagedPfmIsRefusedWithFileAndValue) {
  const auto message = [&](const std::string& content) {
    return MessageOf<InvalidInputError>([&] { ReadPfm(WriteText("a.pfm", content)); });
  };
  const std::string body(16, '\0');
  EXPECT_THAT(message("Pf\n2 2\n-1.0\n" + body.substr(1)), HasAll("a.pfm", "truncated"));
  EXPECT_THAT(message("Pf\n2 2\n-1.0\n" + body + "x"), HasSubstr("1 bytes too many"));
  EXPECT_THAT(message("PF\n2 2\n-1.0\n" + body), HasSubstr("\"PF\""));
  EXPECT_THAT(message("Pf\n-2 2\n-1.0\n" + body), HasSubstr("\"-2 2\""));
  EXPECT_THAT(message("Pf\n2 2\n0\n" + body), HasSubstr("scale \"0\""));
  EXPECT_THAT(message("Pf\n1000000 1000000\n-1.0\n" + body), HasSubstr("1000000 x 1000000"));
}

TEST_F(MapIoTest, DmbHasTheDocumentedBytes) {
  WriteDmb(folder() / "a.dmb", Ramp(3, 2));
  const std::string content = ReadText(folder() / "a.dmb");
  int32_t header[4];
  ASSERT_EQ(content.size(), sizeof(header) + 6 * sizeof(float));
  std::memcpy(header, content.data(), sizeof(header));
  EXPECT_THAT(header, ElementsAre(1, 2, 3, 1));  // type, height, width, channels
  EXPECT_TRUE(SameBytes(ReadDmb(folder() / "a.dmb"), Ramp(3, 2)));
}

TEST_F(MapIoTest, DamagedDmbIsRefused) {
  const auto message = [&](std::vector<int32_t> header, size_t floats) {
    const std::string head(reinterpret_cast<const char*>(header.data()), header.size() * sizeof(int32_t));
    return MessageOf<InvalidInputError>([&] { ReadDmb(WriteText("a.dmb", head + std::string(4 * floats, '\0'))); });
  };
  EXPECT_THAT(message({1, 2, 3, 1}, 5), HasSubstr("truncated"));
  EXPECT_THAT(message({2, 2, 3, 1}, 6), HasSubstr("type 2"));
  EXPECT_THAT(message({1, 2, 3, 3}, 18), HasSubstr("3 channel(s)"));
  EXPECT_THAT(message({1, 2000000000, 2000000000, 1}, 6), HasSubstr("2000000000 x 2000000000"));
}

TEST_F(MapIoTest, DepthPngStoresThousandthsAndCountsWhatIsTooFar) {
  DepthMap depth(7, 1);
  const float values[] = {0.0f, 1.2344f, 1.2346f, 65.535f, 65.6f, -1.0f, 0.0001f};
  std::copy(std::begin(values), std::end(values), depth.begin());
  EXPECT_EQ(WriteDepthPng(folder() / "d.png", depth), 1u);
  const Image<uint16_t> counts = ReadPng16(folder() / "d.png");
  EXPECT_THAT(std::vector<int>(counts.begin(), counts.end()), ElementsAre(0, 1234, 1235, 65535, 0, 0, 0));
  EXPECT_FLOAT_EQ(ReadDepth(folder() / "d.png")(1, 0), 1.234f);
}

TEST_F(MapIoTest, ReadDepthTakesEveryFormatAndCleansUnknowns) {
  DepthMap depth(4, 1);
  depth(0, 0) = 1.5f;
  depth(1, 0) = NAN;
  depth(2, 0) = -2;
  depth(3, 0) = INFINITY;
  WritePfm(folder() / "a.pfm", depth);
  WriteDmb(folder() / "a.dmb", depth);
  for (const char* name : {"a.pfm", "a.dmb"}) {
    const DepthMap read = ReadDepth(folder() / name);
    EXPECT_THAT(std::vector<float>(read.begin(), read.end()), ElementsAre(1.5f, 0, 0, 0)) << name;
  }
  WriteDepthPng(folder() / "a.png", Ramp(2, 2));
  EXPECT_FLOAT_EQ(ReadDepth(folder() / "a.png")(0, 0), 0.1f);
  EXPECT_REFUSED(ReadDepth(folder() / "a.exr"), "\".exr\"");
}

PointCloud SomePoints() {
  return {{{1, 2, 3}, {0, 0, -1}, {10, 20, 30}, 0, 0.5f}, {{-1.5f, 0, 1e-3f}, {0.6f, 0.8f, 0}, {255, 0, 1}, 0, 1.0f}};
}

TEST_F(MapIoTest, PlyRoundTrip) {
  WritePly(folder() / "a.ply", SomePoints());
  EXPECT_EQ(FirstDifference(ReadPly(folder() / "a.ply").vertices, SomePoints()), "");
  WritePly(folder() / "text.ply", SomePoints(), Eigen::Vector3d::Zero(), false);
  EXPECT_EQ(FirstDifference(ReadPly(folder() / "text.ply").vertices, SomePoints()), "");
  WritePly(folder() / "empty.ply", {});
  EXPECT_TRUE(ReadPly(folder() / "empty.ply").vertices.empty());
}

TEST_F(MapIoTest, AsciiPlyWithOtherPropertiesAndElements) {
  const auto path = WriteText("a.ply",
                              "ply\r\nformat ascii 1.0\r\ncomment made by hand\r\nelement camera 1\r\n"
                              "property list uchar int ids\r\nelement vertex 2\r\nproperty double z\r\n"
                              "property double y\r\nproperty double x\r\nproperty uchar red\r\nproperty uchar green\r\n"
                              "property uchar blue\r\nproperty int label\r\nend_header\r\n"
                              "3 1 2 3\r\n3 2 1 10 20 30 7\r\n0.5 -2e-1 4 1 2 3 8");
  const PointCloud points = ReadPly(path).vertices;
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[0].position.x, 1);
  EXPECT_EQ(points[0].position.z, 3);
  EXPECT_EQ(points[0].color.b, 30);
  EXPECT_EQ(points[1].position.y, -0.2f);
  EXPECT_EQ(points[1].color.g, 2);
}

TEST_F(MapIoTest, BinaryPlySkipsListsBeforeAndAfterTheVertices) {
  const std::string head = "ply\nformat binary_little_endian 1.0\n", end = "end_header\n", point = Bytes({1, 2, 3});
  const std::string vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  const std::string triangle = "\x03" + std::string(12, '\0');
  for (const std::string& content :
       {head + vertex + face + end + point + triangle, head + face + vertex + end + triangle + point}) {
    EXPECT_EQ(ReadPly(WriteText("a.ply", content)).vertices.at(0).position.z, 3);
  }
}

TEST_F(MapIoTest, DamagedPlyIsRefused) {
  const auto message = [&](const std::string& content) {
    return MessageOf<InvalidInputError>([&] { ReadPly(WriteText("a.ply", content)); });
  };
  WritePly(folder() / "whole.ply", SomePoints());
  const std::string whole = ReadText(folder() / "whole.ply");
  for (size_t length = 0; length < whole.size(); length += 7) {
    EXPECT_THAT(message(whole.substr(0, length)), HasSubstr("a.ply")) << "cut to " << length;
  }
  const std::string xyz = "property float x\nproperty float y\nproperty float z\nend_header\n";
  const std::string ascii = "ply\nformat ascii 1.0\nelement vertex ";
  EXPECT_THAT(message(ascii + "99999999999999\n" + xyz + "1 2 3\n"), HasSubstr("truncated"));
  EXPECT_THAT(
      message("ply\nformat ascii 1.0\nelement face 99999999999999\nproperty list uchar int v\nelement vertex 1\n" +
              xyz + "1 2 3\n"),
      HasSubstr("truncated"));
  EXPECT_THAT(message(ascii + "1\n" + xyz + "1 2 three\n"), HasSubstr("\"three\""));
  EXPECT_THAT(message(ascii + "1\nproperty float x\nproperty float y\nend_header\n1 2\n"), HasSubstr("\"z\""));
  EXPECT_THAT(message("ply\nformat binary_big_endian 1.0\n"), HasSubstr("binary_big_endian"));
  EXPECT_THAT(message("ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\n"), HasSubstr("half"));
}

bool IsBlack(const Rgb& p) { return p.r == 0 && p.g == 0 && p.b == 0; }
int Luminance(const Rgb& p) { return 299 * p.r + 587 * p.g + 114 * p.b; }

TEST(MapPictures, NearIsLightFarIsDarkUnknownIsBlack) {
  DepthMap depth(100, 1);
  for (int col = 0; col < 100; ++col) depth(col, 0) = 1.0f + 0.1f * col;
  depth(50, 0) = 0;
  const ColorImage picture = DepthPicture(depth);
  EXPECT_TRUE(IsBlack(picture(50, 0)));
  for (int col = 0; col < 100; ++col) EXPECT_EQ(IsBlack(picture(col, 0)), col == 50);
  for (int col = 10; col < 90; col += 10) {
    if (col == 50 || col == 40) continue;
    EXPECT_GT(Luminance(picture(col, 0)), Luminance(picture(col + 10, 0)));
  }
}

TEST(MapPictures, NormalTowardsTheCameraIsLightBlue) {
  NormalMap normal(2, 1);
  normal(0, 0) = {0, 0, -1};
  normal(1, 0) = {0, 0, 0};
  const ColorImage picture = NormalPicture(normal);
  EXPECT_EQ(picture(0, 0).b, 255);
  EXPECT_EQ(picture(0, 0).r, 128);
  EXPECT_TRUE(IsBlack(picture(1, 0)));
}

class MeshFilesTest : public TestFolder {
 protected:
  static TriangleMesh SomeMesh() {
    TriangleMesh mesh;
    mesh.vertices = {{{0, 0, 1}, {0, 0, -1}, {255, 0, 51}, 0, 0.5f},
                     {{1, 0, 1}, {0, 0, -1}, {1, 2, 3}, 0, 0.25f},
                     {{0, 1, 1.5f}, {0, 0, -1}, {4, 5, 6}, 0, 0.75f},
                     {{1, 1, 1}, {0, 0, -1}, {7, 8, 9}, 0, 1}};
    mesh.triangles = {{0, 2, 1}, {1, 2, 3}};
    return mesh;
  }
  std::filesystem::path WriteAscii(const std::string& faces) const {
    return WriteText("a.ply",
                     "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
                     "element face 1\nproperty uchar flags\nproperty list uchar int vertex_index\nend_header\n"
                     "0 0 0\n1 0 0\n1 1 0\n0 1 0\n" +
                         faces);
  }
};

TEST_F(MeshFilesTest, PlyRoundTrip) {
  WriteMesh(folder() / "a.ply", SomeMesh(), MeshFormat::kPly);
  const TriangleMesh read = ReadPly(folder() / "a.ply");
  EXPECT_EQ(read.triangles, SomeMesh().triangles);
  ASSERT_EQ(read.vertices.size(), 4u);
  EXPECT_EQ(read.vertices[2].position.z, 1.5f);
  EXPECT_EQ(read.vertices[2].normal.z, -1);
  EXPECT_EQ(read.vertices[0].color.b, 51);
  EXPECT_EQ(read.vertices[1].confidence, 0.25f);
  EXPECT_EQ(ReadPly(folder() / "a.ply").vertices.size(), 4u) << "as a cloud";
  WritePly(folder() / "cloud.ply", SomeMesh().vertices);
  EXPECT_TRUE(ReadPly(folder() / "cloud.ply").triangles.empty());
}

TEST_F(MeshFilesTest, FacesOfMoreCornersAreCut) {
  const TriangleMesh mesh = ReadPly(WriteAscii("7 4 0 1 2 3\n"));
  const std::vector<std::array<uint32_t, 3>> expected = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_EQ(mesh.triangles, expected);
}

TEST_F(MeshFilesTest, DamagedFacesAreRefused) {
  const auto message = [&](const std::string& faces) {
    return MessageOf<InvalidInputError>([&] { ReadPly(WriteAscii(faces)); });
  };
  EXPECT_THAT(message("0 3 0 1 4\n"), HasAll("a.ply", "vertex 4: must be 0 to 4 - 1"));
  EXPECT_THAT(message("0 3 0 1 -1\n"), HasSubstr("vertex -1"));
  EXPECT_THAT(message("0 2 0 1\n"), HasSubstr("face of 2 vertices"));
  EXPECT_THAT(message("0 3 0 1\n"), HasSubstr("truncated"));
  WriteMesh(folder() / "whole.ply", SomeMesh(), MeshFormat::kPly);
  const std::string whole = ReadText(folder() / "whole.ply");
  const auto cut = WriteText("cut.ply", whole.substr(0, whole.size() - 1));
  EXPECT_REFUSED(ReadPly(cut), "truncated");
}

TEST_F(MeshFilesTest, ObjHasTheDocumentedText) {
  WriteMesh(folder() / "a.obj", SomeMesh(), MeshFormat::kObj);
  const std::string text = ReadText(folder() / "a.obj");
  EXPECT_THAT(text, HasSubstr("v 0 0 1 1.0000 0.0000 0.2000\nv 1 0 1 "));
  EXPECT_THAT(text, HasSubstr("\nvn 0.0000 0.0000 -1.0000\nf 1//1 3//3 2//2\nf 2//2 3//3 4//4\n"));
}

TEST_F(MeshFilesTest, NamesSayTheFormat) {
  EXPECT_EQ(MeshFormatOf("a/b.c/mesh.PLY"), MeshFormat::kPly);
  EXPECT_EQ(MeshFormatOf("mesh.obj"), MeshFormat::kObj);
  EXPECT_REFUSED(MeshFormatOf("mesh.stl"), "must end with .ply or .obj");
}

/// Line by line what camera_calibration writes; its parser was seen to read it.
TEST_F(MapIoTest, CalibrationIsWrittenAsCameraCalibrationDoes) {
  const PinholeCamera camera = {64, 48, 50, 51, 31.5, 23.5};
  WriteCalibration(folder() / "camera.yaml", Lens(camera, {LensDistortion::Model::kBrownConrady, {0.1, -0.05, 0, 0}}),
                   "found");
  EXPECT_EQ(ReadText(folder() / "camera.yaml"),
            "# found\nimage_width: 64\nimage_height: 48\ncamera_name: camera\n"
            "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [50, 0, 31.5, 0, 51, 23.5, 0, 0, 1]\n"
            "distortion_model: plumb_bob\n"
            "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -0.05, 0, 0, 0]\n"
            "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
            "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [50, 0, 31.5, 0, 0, 51, 23.5, 0, 0, 0, 1, 0]\n");
}

class CameraListTest : public TestFolder {
 protected:
  std::string ErrorOf(const std::string& lines) const {
    return MessageOf<InvalidInputError>([&] { ReadCameraList(WriteText("cameras.txt", "# a header\n" + lines)); });
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
  EXPECT_THAT(ErrorOf("0 a.png 100 100\n"), HasAll("cameras.txt:2", "cx is missing"));
  EXPECT_THAT(ErrorOf("a.png 100 100 20 15 40 30 1 0 0 0 1 2 3\n"), HasSubstr("\"a.png\""));
  EXPECT_THAT(ErrorOf("0 a.png 100 100 20 15 40 30 0 0 0 0 1 2 3\n"), HasSubstr("quaternion of length 0"));
  EXPECT_REFUSED(ReadCameraList(folder() / "none"), "No such file");
}

}  // namespace
}  // namespace acmp
