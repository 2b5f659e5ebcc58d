#include "colmap_model.h"

#include <algorithm>

#include "acmp_mapping/common/error.h"
#include "input_file.h"
#include "scene_private.h"

namespace acmp {
namespace {

bool HasModel(const std::filesystem::path& folder, const char* extension) {
  std::error_code ignored;
  return std::filesystem::exists(folder / (std::string("cameras") + extension), ignored) &&
         std::filesystem::exists(folder / (std::string("images") + extension), ignored);
}

/// Collects what the text and the binary reader find and checks that it fits together.
class ColmapModelBuilder {
 public:
  void AddCamera(const std::string& where, int64_t id, ColmapCamera camera);
  void AddPoint(const std::string& where, int64_t id, const Eigen::Vector3d& point_in_world);
  /// Points and cameras must have been added before. `point_ids`: -1 (as signed) for features without a point.
  void AddImage(const std::string& where, ColmapImage image, const std::vector<int64_t>& point_ids);
  ColmapModel Finish(const std::filesystem::path& folder);

 private:
  ColmapModel model_;
  std::unordered_map<int64_t, int> point_index_;
  std::unordered_map<int64_t, std::string> name_of_image_;
  std::unordered_map<std::string, int64_t> image_of_name_;
};

void ColmapModelBuilder::AddCamera(const std::string& where, int64_t id, ColmapCamera camera) {
  if (!model_.cameras.emplace(id, std::move(camera)).second) {
    throw InvalidInputError(Concat(where, ": camera id ", id, " occurs twice"));
  }
}

void ColmapModelBuilder::AddPoint(const std::string& where, int64_t id, const Eigen::Vector3d& point_in_world) {
  if (!point_in_world.allFinite()) {
    throw InvalidInputError(Concat(where, ": point ", id, " at (", point_in_world.transpose(), "): must be finite"));
  }
  if (!point_index_.emplace(id, static_cast<int>(model_.landmarks_in_world.size())).second) {
    throw InvalidInputError(Concat(where, ": point id ", id, " occurs twice"));
  }
  model_.landmarks_in_world.push_back(point_in_world);
}

void ColmapModelBuilder::AddImage(const std::string& where, ColmapImage image, const std::vector<int64_t>& point_ids) {
  if (model_.cameras.count(image.camera_id) == 0) {
    throw InvalidInputError(Concat(where, ": image ", image.name, " names camera id ", image.camera_id,
                                   ", which the cameras file does not have"));
  }
  if (!name_of_image_.emplace(image.id, image.name).second) {
    throw InvalidInputError(Concat(where, ": image id ", image.id, " occurs twice"));
  }
  if (!image_of_name_.emplace(image.name, image.id).second) {
    throw InvalidInputError(Concat(where, ": image name ", image.name, " occurs twice"));
  }
  for (int64_t point_id : point_ids) {
    if (point_id == -1) continue;
    const auto found = point_index_.find(point_id);
    if (found == point_index_.end()) {
      throw InvalidInputError(Concat(where, ": image ", image.name, " names point id ", point_id,
                                     ", which the points3D file does not have"));
    }
    image.landmark_indices.push_back(found->second);
  }
  // A point can have several features in one image; it is one landmark all the same.
  auto& indices = image.landmark_indices;
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  model_.images.push_back(std::move(image));
}

ColmapModel ColmapModelBuilder::Finish(const std::filesystem::path& folder) {
  if (model_.images.empty()) throw InvalidInputError(Concat(folder.string(), ": the COLMAP model has no images"));
  std::sort(model_.images.begin(), model_.images.end(),
            [](const ColmapImage& a, const ColmapImage& b) { return a.id < b.id; });
  return std::move(model_);
}

// Binary files.

constexpr size_t kMaxNameLength = 4096;

std::string Where(const std::filesystem::path& path, const char* what, uint64_t id) {
  return Concat(path.string(), ": ", what, " ", id);
}

void ReadBinaryCameras(const std::filesystem::path& path, ColmapModelBuilder* builder) {
  constexpr uint64_t kMinBytes = 4 + 4 + 8 + 8 + 3 * 8;
  BinaryReader file(path);
  const uint64_t count = file.ReadCount(kMinBytes, "number of cameras");
  for (uint64_t i = 0; i < count; ++i) {
    const auto id = file.Read<uint32_t>("camera id");
    const std::string where = Where(path, "camera", id);
    const auto model_id = file.Read<int32_t>("camera model");
    const ColmapCameraModel& model = FindColmapCameraModel(where, model_id);
    const auto width = file.Read<uint64_t>("image width");
    const auto height = file.Read<uint64_t>("image height");
    std::vector<double> parameters(model.parameters);
    for (double& parameter : parameters) parameter = file.Read<double>("camera parameter");
    builder->AddCamera(where, id, MakeColmapCamera(where, model, width, height, parameters));
  }
  file.ExpectEnd();
}

void ReadBinaryPoints(const std::filesystem::path& path, ColmapModelBuilder* builder) {
  constexpr uint64_t kMinBytes = 8 + 3 * 8 + 3 + 8 + 8;
  constexpr uint64_t kColorAndErrorBytes = 3 + 8;
  constexpr uint64_t kTrackElementBytes = 4 + 4;
  BinaryReader file(path);
  const uint64_t count = file.ReadCount(kMinBytes, "number of points");
  for (uint64_t i = 0; i < count; ++i) {
    const auto id = file.Read<uint64_t>("point id");
    Eigen::Vector3d point;
    for (int k = 0; k < 3; ++k) point[k] = file.Read<double>("point");
    file.Skip(kColorAndErrorBytes, "point");
    file.Skip(file.ReadCount(kTrackElementBytes, "track length") * kTrackElementBytes, "track");
    builder->AddPoint(Where(path, "point", id), static_cast<int64_t>(id), point);
  }
  file.ExpectEnd();
}

std::vector<int64_t> ReadFeatures(BinaryReader* file) {
  constexpr uint64_t kFeatureBytes = 8 + 8 + 8;
  const uint64_t count = file->ReadCount(kFeatureBytes, "number of features");
  std::vector<int64_t> point_ids(count);
  for (int64_t& id : point_ids) {
    file->Read<double>("feature x");
    file->Read<double>("feature y");
    id = static_cast<int64_t>(file->Read<uint64_t>("feature's point id"));  // all bits set: none
  }
  return point_ids;
}

void ReadBinaryImages(const std::filesystem::path& path, ColmapModelBuilder* builder) {
  constexpr uint64_t kMinBytes = 4 + 7 * 8 + 4 + 1 + 8;
  BinaryReader file(path);
  const uint64_t count = file.ReadCount(kMinBytes, "number of images");
  for (uint64_t i = 0; i < count; ++i) {
    ColmapImage image;
    image.id = file.Read<uint32_t>("image id");
    const std::string where = Where(path, "image", static_cast<uint64_t>(image.id));
    Eigen::Vector4d quaternion;
    for (int k = 0; k < 4; ++k) quaternion[k] = file.Read<double>("quaternion");
    Eigen::Vector3d translation;
    for (int k = 0; k < 3; ++k) translation[k] = file.Read<double>("translation");
    image.camera_id = file.Read<uint32_t>("camera id");
    image.name = file.ReadString(kMaxNameLength, "image name");
    image.cam_from_world = MakeColmapPose(where, quaternion, translation);
    const std::vector<int64_t> point_ids = ReadFeatures(&file);
    builder->AddImage(where, std::move(image), point_ids);
  }
  file.ExpectEnd();
}

void ReadColmapBinary(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  ReadBinaryCameras(folder / "cameras.bin", builder);
  ReadBinaryPoints(folder / "points3D.bin", builder);
  ReadBinaryImages(folder / "images.bin", builder);
}

// Text files.

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

void ReadColmapText(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  ReadTextCameras(folder / "cameras.txt", builder);
  ReadTextPoints(folder / "points3D.txt", builder);
  ReadTextImages(folder / "images.txt", builder);
}

}  // namespace

std::optional<std::filesystem::path> FindColmapModel(const std::filesystem::path& root) {
  for (const auto& folder : {root, root / "sparse", root / "sparse" / "0"}) {
    if (HasModel(folder, ".bin") || HasModel(folder, ".txt")) return folder;
  }
  return std::nullopt;
}

ColmapModel ReadColmapModel(const std::filesystem::path& folder) {
  ColmapModelBuilder builder;
  if (HasModel(folder, ".bin")) {
    ReadColmapBinary(folder, &builder);
  } else {
    ReadColmapText(folder, &builder);
  }
  return builder.Finish(folder);
}

Scene ReadColmapScene(const std::filesystem::path& root, const std::filesystem::path& model_folder,
                      const std::filesystem::path& image_folder) {
  ColmapModel model = ReadColmapModel(model_folder);
  Scene scene;
  scene.root = root;
  scene.landmarks_in_world = std::move(model.landmarks_in_world);
  size_t missing = 0;
  std::filesystem::path first_missing;
  for (ColmapImage& colmap_image : model.images) {
    SceneImage image;
    image.path = image_folder / colmap_image.name;
    if (!std::filesystem::is_regular_file(image.path)) {
      if (missing++ == 0) first_missing = image.path;
      continue;
    }
    const ColmapCamera& camera = model.cameras.at(colmap_image.camera_id);
    image.name = std::move(colmap_image.name);
    image.camera = camera.camera;
    image.distortion = camera.distortion;
    image.cam_from_world = colmap_image.cam_from_world;
    image.landmark_indices = std::move(colmap_image.landmark_indices);
    scene.images.push_back(std::move(image));
  }
  if (scene.images.empty()) {
    throw InvalidInputError(Concat("none of the ", missing, " images of the COLMAP model in ", model_folder.string(),
                                   " is in ", image_folder.string(), ", for example ", first_missing.string(),
                                   "; images of another folder: --image-path"));
  }
  if (missing > 0) {
    scene.warnings.push_back(Concat(missing, " of ", model.images.size(), " images of the COLMAP model in ",
                                    model_folder.string(), " are missing and left out, for example ",
                                    first_missing.string()));
  }
  return scene;
}

}  // namespace acmp
