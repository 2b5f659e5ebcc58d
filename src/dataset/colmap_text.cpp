#include "colmap_model.h"
#include "input_file.h"

namespace acmp {
namespace {

// COLMAP announces the number of records in a comment: the only way to see that a text file was cut between lines.
void CheckCount(const TextReader& reader, int64_t count, const char* what) {
  if (reader.announced_count() > count) {
    reader.Fail(Concat("the file ends after ", count, " ", what, " but its header announces ", reader.announced_count(),
                       ": truncated"));
  }
}

uint64_t ReadSize(const TextReader& reader, FieldReader* fields, const char* name) {
  const int64_t size = fields->Integer(name);
  if (size <= 0) reader.Fail(Concat(name, " = ", size, ": must be positive"));
  return static_cast<uint64_t>(size);
}

void ReadTextCameras(const std::filesystem::path& path, ColmapModelBuilder* builder) {
  TextReader reader(path);
  int64_t count = 0;
  for (std::string line; reader.NextContentLine(&line); ++count) {
    FieldReader fields(reader, line);
    const int64_t id = fields.Integer("camera id");
    const std::string where = reader.Where();
    const std::string name = fields.Word("camera model");
    const ColmapCameraModel& model = FindColmapCameraModel(where, name);
    const uint64_t width = ReadSize(reader, &fields, "image width");
    const uint64_t height = ReadSize(reader, &fields, "image height");
    std::vector<double> parameters(model.parameters);
    for (double& parameter : parameters) parameter = fields.Real("camera parameter");
    fields.ExpectEnd();
    builder->AddCamera(where, id, MakeColmapCamera(where, model, width, height, parameters));
  }
  CheckCount(reader, count, "cameras");
}

void ReadTextPoints(const std::filesystem::path& path, ColmapModelBuilder* builder) {
  TextReader reader(path);
  int64_t count = 0;
  for (std::string line; reader.NextContentLine(&line); ++count) {
    FieldReader fields(reader, line);
    const int64_t id = fields.Integer("point id");
    const double x = fields.Real("point x");
    const double y = fields.Real("point y");
    const double z = fields.Real("point z");
    builder->AddPoint(reader.Where(), id, {x, y, z});  // colour, error and track are not needed
  }
  CheckCount(reader, count, "points");
}

ColmapImage ReadImageLine(const TextReader& reader, const std::string& line) {
  FieldReader fields(reader, line);
  ColmapImage image;
  image.id = fields.Integer("image id");
  Eigen::Vector4d quaternion;
  for (int i = 0; i < 4; ++i) quaternion[i] = fields.Real("quaternion");
  Eigen::Vector3d translation;
  for (int i = 0; i < 3; ++i) translation[i] = fields.Real("translation");
  image.camera_id = fields.Integer("camera id");
  image.name = fields.Rest("image name");
  image.cam_from_world = MakeColmapPose(reader.Where(), quaternion, translation);
  return image;
}

std::vector<int64_t> ReadFeatureLine(const TextReader& reader, const std::string& line) {
  FieldReader fields(reader, line);
  std::vector<int64_t> point_ids;
  while (!fields.AtEnd()) {
    fields.Word("feature x");  // not needed, and nan where COLMAP undistorted a feature to nowhere
    fields.Word("feature y");
    point_ids.push_back(fields.Integer("feature's point id"));
  }
  return point_ids;
}

void ReadTextImages(const std::filesystem::path& path, ColmapModelBuilder* builder) {
  TextReader reader(path);
  int64_t count = 0;
  for (std::string line; reader.NextContentLine(&line); ++count) {
    ColmapImage image = ReadImageLine(reader, line);
    const std::string where = reader.Where();
    // The second line may be empty (no features) but must be there.
    if (!reader.NextLine(&line))
      reader.Fail(Concat("the line of features of image ", image.name, " is missing: truncated"));
    builder->AddImage(where, std::move(image), ReadFeatureLine(reader, line));
  }
  CheckCount(reader, count, "images");
}

}  // namespace

void ReadColmapText(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  ReadTextCameras(folder / "cameras.txt", builder);
  ReadTextPoints(folder / "points3D.txt", builder);
  ReadTextImages(folder / "images.txt", builder);
}

}  // namespace acmp
