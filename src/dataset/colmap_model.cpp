#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "input_file.h"
#include "scene_readers.h"

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

// One reader for each of the model's files, whichever kind it is: it asks BinaryRecords or TextRecords for what a
// record has, one value after the other.

/// Records of a binary file.
class BinaryRecords {
 public:
  static constexpr const char* kExtension = ".bin";

  /// @param what the records are, for messages
  /// @param min_bytes of a record
  BinaryRecords(const std::filesystem::path& path, const char* what, uint64_t min_bytes)
      : file_(path), left_(file_.ReadCount(min_bytes, Concat("number of ", what).c_str())) {}

  /// Begins the next record. False: there was no more, and nothing is behind the last one.
  bool Next() {
    if (left_ == 0) file_.ExpectEnd();
    return left_-- > 0;
  }
  std::string Where() const { return file_.Where(); }
  template <class T>
  int64_t Integer(const char* name) {
    return static_cast<int64_t>(file_.Read<T>(name));
  }
  double Real(const char* name) {
    const auto value = file_.Read<double>(name);
    if (!std::isfinite(value)) file_.Fail(Concat(name, " = ", value, ": must be finite"));
    return value;
  }
  const ColmapCameraModel& CameraModel() {
    const auto id = file_.Read<int32_t>("camera model");
    return FindColmapCameraModel(Where(), id);
  }
  std::string ImageName() {
    constexpr size_t kMaxLength = 4096;
    return file_.ReadUntil('\0', kMaxLength, "image name");
  }
  /// Of each feature of an image: -1 for one without a point.
  std::vector<int64_t> PointIds() {
    constexpr uint64_t kCoordinates = 8 + 8, kId = 8;
    std::vector<int64_t> ids(file_.ReadCount(kCoordinates + kId, "number of features"));
    for (int64_t& id : ids) {
      file_.Skip(kCoordinates, "feature");
      id = Integer<uint64_t>("feature's point id");  // all bits set: none
    }
    return ids;
  }
  void EndCamera() {}
  /// Passes over colour, error and track.
  void EndPoint() {
    constexpr uint64_t kColorAndError = 3 + 8, kTrackElement = 4 + 4;
    file_.Skip(kColorAndError, "point");
    file_.Skip(file_.ReadCount(kTrackElement, "track length") * kTrackElement, "track");
  }

 private:
  BinaryReader file_;
  uint64_t left_;
};

/// Records of a text file, each a line.
class TextRecords {
 public:
  static constexpr const char* kExtension = ".txt";

  TextRecords(const std::filesystem::path& path, const char* what, uint64_t /*min_bytes*/)
      : what_(what), reader_(path) {}

  bool Next() {
    if (reader_.NextContentLine()) {
      ++count_;
      return true;
    }
    // COLMAP announces the number in a comment: the only way to see that a file was cut between lines.
    if (reader_.announced_count() <= count_) return false;
    reader_.Fail(Concat("the file ends after ", count_, " ", what_, " but its header announces ",
                        reader_.announced_count(), ": truncated"));
  }
  std::string Where() const { return reader_.Where(); }
  template <class T>
  int64_t Integer(const char* name) {
    return reader_.Integer(name);
  }
  double Real(const char* name) { return reader_.Real(name); }
  const ColmapCameraModel& CameraModel() { return FindColmapCameraModel(Where(), reader_.Word("camera model")); }
  std::string ImageName() { return reader_.Rest("image name"); }
  std::vector<int64_t> PointIds() {
    // Their line may be empty (no features) but must be there.
    if (!reader_.NextLine()) reader_.Fail("the line of the image's features is missing: truncated");
    std::vector<int64_t> ids;
    while (!reader_.AtEnd()) {
      reader_.Word("feature x");  // not needed, and nan where COLMAP undistorted a feature to nowhere
      reader_.Word("feature y");
      ids.push_back(reader_.Integer("feature's point id"));
    }
    return ids;
  }
  void EndCamera() { reader_.ExpectEnd(); }
  void EndPoint() {}

 private:
  const char* what_;
  TextReader reader_;
  int64_t count_ = 0;
};

template <class Records>
void ReadCameras(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  constexpr uint64_t kMinBytes = 4 + 4 + 8 + 8 + 2 * 8;
  Records records(folder / Concat("cameras", Records::kExtension), "cameras", kMinBytes);
  while (records.Next()) {
    const int64_t id = records.template Integer<uint32_t>("camera id");
    const ColmapCameraModel& model = records.CameraModel();
    const int64_t width = records.template Integer<uint64_t>("image width");
    const int64_t height = records.template Integer<uint64_t>("image height");
    std::vector<double> parameters(static_cast<size_t>(model.parameters));
    for (double& parameter : parameters) parameter = records.Real("camera parameter");
    records.EndCamera();
    builder->AddCamera(records.Where(), id, MakeColmapCamera(records.Where(), model, width, height, parameters));
  }
}

template <class Records>
void ReadPoints(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  constexpr uint64_t kMinBytes = 8 + 3 * 8 + 3 + 8 + 8;
  Records records(folder / Concat("points3D", Records::kExtension), "points", kMinBytes);
  while (records.Next()) {
    const int64_t id = records.template Integer<uint64_t>("point id");
    Eigen::Vector3d point;
    for (int i = 0; i < 3; ++i) point[i] = records.Real("point");
    records.EndPoint();
    builder->AddPoint(records.Where(), id, point);
  }
}

template <class Records>
void ReadImages(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  constexpr uint64_t kMinBytes = 4 + 7 * 8 + 4 + 1 + 8;
  Records records(folder / Concat("images", Records::kExtension), "images", kMinBytes);
  while (records.Next()) {
    ColmapImage image;
    image.id = records.template Integer<uint32_t>("image id");
    const std::string where = records.Where();
    Eigen::Vector4d quaternion;
    Eigen::Vector3d translation;
    for (int i = 0; i < 4; ++i) quaternion[i] = records.Real("quaternion");
    for (int i = 0; i < 3; ++i) translation[i] = records.Real("translation");
    image.camera_id = records.template Integer<uint32_t>("camera id");
    image.name = records.ImageName();
    image.cam_from_world = MakeColmapPose(where, quaternion, translation);
    const std::vector<int64_t> point_ids = records.PointIds();
    builder->AddImage(where, std::move(image), point_ids);
  }
}

template <class Records>
ColmapModel ReadModel(const std::filesystem::path& folder) {
  ColmapModelBuilder builder;
  ReadCameras<Records>(folder, &builder);
  ReadPoints<Records>(folder, &builder);
  ReadImages<Records>(folder, &builder);
  return builder.Finish(folder);
}

}  // namespace

std::optional<std::filesystem::path> FindColmapModel(const std::filesystem::path& root) {
  for (const auto& folder : {root, root / "sparse", root / "sparse" / "0"}) {
    if (HasModel(folder, ".bin") || HasModel(folder, ".txt")) return folder;
  }
  return std::nullopt;
}

ColmapModel ReadColmapModel(const std::filesystem::path& folder) {
  return HasModel(folder, ".bin") ? ReadModel<BinaryRecords>(folder) : ReadModel<TextRecords>(folder);
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
