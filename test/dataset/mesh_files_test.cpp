#include <gmock/gmock.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/map_io.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class MeshFilesTest : public TestFolder {
 protected:
  static TriangleMesh SomeMesh() {
    TriangleMesh mesh;
    mesh.vertices = {{{0, 0, 1}, {0, 0, -1}, {255, 0, 51}, 0.5f},
                     {{1, 0, 1}, {0, 0, -1}, {1, 2, 3}, 0.25f},
                     {{0, 1, 1.5f}, {0, 0, -1}, {4, 5, 6}, 0.75f},
                     {{1, 1, 1}, {0, 0, -1}, {7, 8, 9}, 1}};
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
  const TriangleMesh read = ReadPlyMesh(folder() / "a.ply");
  EXPECT_EQ(read.triangles, SomeMesh().triangles);
  ASSERT_EQ(read.vertices.size(), 4u);
  EXPECT_EQ(read.vertices[2].position.z, 1.5f);
  EXPECT_EQ(read.vertices[2].normal.z, -1);
  EXPECT_EQ(read.vertices[0].color.b, 51);
  EXPECT_EQ(read.vertices[1].confidence, 0.25f);
  EXPECT_EQ(ReadPly(folder() / "a.ply").size(), 4u) << "as a cloud";
  WritePly(folder() / "cloud.ply", SomeMesh().vertices);
  EXPECT_TRUE(ReadPlyMesh(folder() / "cloud.ply").triangles.empty());
}

TEST_F(MeshFilesTest, FacesOfMoreCornersAreCut) {
  const TriangleMesh mesh = ReadPlyMesh(WriteAscii("7 4 0 1 2 3\n"));
  const std::vector<std::array<uint32_t, 3>> expected = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_EQ(mesh.triangles, expected);
}

TEST_F(MeshFilesTest, DamagedFacesAreRefused) {
  const auto message = [&](const std::string& faces) {
    return MessageOf<InvalidInputError>([&] { ReadPlyMesh(WriteAscii(faces)); });
  };
  EXPECT_THAT(message("0 3 0 1 4\n"), AllOf(HasSubstr("a.ply"), HasSubstr("vertex 4: must be 0 to 4 - 1")));
  EXPECT_THAT(message("0 3 0 1 -1\n"), HasSubstr("vertex -1"));
  EXPECT_THAT(message("0 2 0 1\n"), HasSubstr("face of 2 vertices"));
  EXPECT_THAT(message("0 3 0 1\n"), HasSubstr("truncated"));
  WriteMesh(folder() / "whole.ply", SomeMesh(), MeshFormat::kPly);
  const std::string whole = ReadText(folder() / "whole.ply");
  const auto cut = WriteText("cut.ply", whole.substr(0, whole.size() - 1));
  EXPECT_THAT(MessageOf<InvalidInputError>([&] { ReadPlyMesh(cut); }), HasSubstr("truncated"));
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
  EXPECT_THAT(MessageOf<InvalidInputError>([] { MeshFormatOf("mesh.stl"); }), HasSubstr("must end with .ply or .obj"));
}

}  // namespace
}  // namespace acmp
