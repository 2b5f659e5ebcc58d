#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <unordered_map>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/geometry/lens.h"
#include "input_file.h"
#include "scene_readers.h"

namespace acmp {
namespace {

bool HasModel(const std::filesystem::path& folder, const char* extension) {
  std::error_code ignored;
  return std::filesystem::exists(folder / (std::string("cameras") + extension), ignored) &&
         std::filesystem::exists(folder / (std::string("images") + extension), ignored);
}

struct ColmapFeature {
  Eigen::Vector2d pixel;  ///< COLMAP's: pixel centres at +0.5; nan where it was undistorted to nowhere
  int64_t point_id = -1;  ///< -1: none
};

/// Collects what the text and the binary reader find and checks that it fits together.
class ColmapModelBuilder {
 public:
  void AddCamera(const std::string& where, int64_t id, ColmapCamera camera);
  void AddPoint(const std::string& where, int64_t id, const Eigen::Vector3d& point_in_world);
  /// Points and cameras must have been added before.
  void AddImage(const std::string& where, int64_t id, int64_t camera_id, SceneImage image,
                const std::vector<ColmapFeature>& features);
  void AddWarning(std::string warning) { model_.warnings.push_back(std::move(warning)); }
  ColmapModel Finish(const std::filesystem::path& folder);

 private:
  /// Features far from where their points project to.
  struct Misfit {
    std::string image;
    double median_px = 0;
  };
  void CheckFeatures(const SceneImage& image, const std::vector<ColmapFeature>& features);
  void WarnOfMisfits();
  void SeeAllPoints();

  std::vector<Misfit> misfits_;
  size_t checked_images_ = 0;
  ColmapModel model_;
  std::unordered_map<int64_t, ColmapCamera> cameras_;
  std::unordered_map<int64_t, int> point_index_;
  std::map<int64_t, SceneImage> images_;
  std::set<std::string> names_;
};

void ColmapModelBuilder::AddCamera(const std::string& where, int64_t id, ColmapCamera camera) {
  if (!cameras_.emplace(id, std::move(camera)).second) {
    throw InvalidInputError(Concat(where, ": camera id ", id, " occurs twice"));
  }
}

void ColmapModelBuilder::AddPoint(const std::string& where, int64_t id, const Eigen::Vector3d& point_in_world) {
  if (!point_index_.emplace(id, static_cast<int>(model_.landmarks_in_world.size())).second) {
    throw InvalidInputError(Concat(where, ": point id ", id, " occurs twice"));
  }
  model_.landmarks_in_world.push_back(point_in_world);
}

void ColmapModelBuilder::AddImage(const std::string& where, int64_t id, int64_t camera_id, SceneImage image,
                                  const std::vector<ColmapFeature>& features) {
  const auto camera = cameras_.find(camera_id);
  if (camera == cameras_.end()) {
    throw InvalidInputError(Concat(where, ": image ", image.name, " names camera id ", camera_id,
                                   ", which the cameras file does not have"));
  }
  image.camera = camera->second.camera;
  image.distortion = camera->second.distortion;
  if (images_.count(id) > 0) throw InvalidInputError(Concat(where, ": image id ", id, " occurs twice"));
  if (!names_.insert(image.name).second) {
    throw InvalidInputError(Concat(where, ": image name ", image.name, " occurs twice"));
  }
  for (const ColmapFeature& feature : features) {
    if (feature.point_id == -1) continue;
    const auto found = point_index_.find(feature.point_id);
    if (found == point_index_.end()) {
      throw InvalidInputError(Concat(where, ": image ", image.name, " names point id ", feature.point_id,
                                     ", which the points3D file does not have"));
    }
    image.landmark_indices.push_back(found->second);
  }
  CheckFeatures(image, features);
  // A point can have several features in one image; it is one landmark all the same.
  auto& indices = image.landmark_indices;
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  images_.emplace(id, std::move(image));
}

void ColmapModelBuilder::CheckFeatures(const SceneImage& image, const std::vector<ColmapFeature>& features) {
  constexpr size_t kFewest = 10, kSample = 500;
  constexpr double kFar_px = 4,
                   kFarShare = 0.003;  // COLMAP keeps those within 4 px; of the longer side, where it is large
  const Lens lens(image.camera, image.distortion);
  std::vector<double> errors;
  const size_t step = 1 + features.size() / kSample;
  for (size_t i = 0; i < features.size(); i += step) {
    const Eigen::Vector2d& pixel = features[i].pixel;
    if (features[i].point_id == -1 || !pixel.allFinite() || pixel.isZero(0)) continue;
    const Eigen::Vector3d& point =
        model_.landmarks_in_world[static_cast<size_t>(point_index_.at(features[i].point_id))];
    const auto projected = lens.Project(image.cam_from_world * point);
    errors.push_back(projected ? (*projected - pixel + Eigen::Vector2d(0.5, 0.5)).norm() : HUGE_VAL);
  }
  if (errors.size() < kFewest) return;
  ++checked_images_;
  const double median_px = Median(std::move(errors));
  const double far_px = std::max(kFar_px, kFarShare * std::max(image.camera.width, image.camera.height));
  if (median_px > far_px) misfits_.push_back({image.name, median_px});
}

void ColmapModelBuilder::WarnOfMisfits() {
  if (misfits_.empty()) return;
  std::sort(misfits_.begin(), misfits_.end(),
            [](const Misfit& a, const Misfit& b) { return a.median_px < b.median_px; });
  const Misfit& middle = misfits_[misfits_.size() / 2];
  const std::string where = std::isfinite(middle.median_px)
                                ? Concat("project ", std::lround(middle.median_px), " px (median) from their features")
                                : "lie behind the camera";
  AddWarning(
      Concat("features and landmarks disagree in ", misfits_.size(), " of ", checked_images_, " images: in ",
             middle.image, " the landmarks ", where,
             ". Coordinates were written with too few digits, poses are inverted, points and poses are of different "
             "states, or cameras are those of other images"));
}

void ColmapModelBuilder::SeeAllPoints() {
  constexpr size_t kSample = 50000;  // of all images' points: some tell a depth range
  const std::vector<Eigen::Vector3d>& points = model_.landmarks_in_world;
  if (points.empty() || std::any_of(model_.images.begin(), model_.images.end(),
                                    [](const SceneImage& image) { return !image.landmark_indices.empty(); })) {
    return;
  }
  const size_t step = 1 + points.size() / kSample;
  for (SceneImage& image : model_.images) {
    const Lens lens(image.camera, image.distortion);
    for (size_t i = 0; i < points.size(); i += step) {
      const auto pixel = lens.Project(image.cam_from_world * points[i]);
      if (pixel && image.camera.Contains(*pixel)) image.landmark_indices.push_back(static_cast<int>(i));
    }
  }
  AddWarning(Concat("no image of the model names the points that it sees (tracks): of its ", points.size(),
                    " points each is taken to see those that project into it, also what walls hide"));
}

ColmapModel ColmapModelBuilder::Finish(const std::filesystem::path& folder) {
  if (images_.empty()) throw InvalidInputError(Concat(folder.string(), ": the COLMAP model has no images"));
  for (auto& [id, image] : images_) model_.images.push_back(std::move(image));
  WarnOfMisfits();
  SeeAllPoints();
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
  std::vector<ColmapFeature> Features() {
    constexpr uint64_t kCoordinates = 8 + 8, kId = 8;
    std::vector<ColmapFeature> features(file_.ReadCount(kCoordinates + kId, "number of features"));
    for (ColmapFeature& feature : features) {
      feature.pixel.x() = file_.Read<double>("feature x");
      feature.pixel.y() = file_.Read<double>("feature y");
      feature.point_id = Integer<uint64_t>("feature's point id");  // all bits set: none
    }
    return features;
  }
  void EndCamera() {}
  /// Passes over colour, error and track.
  void EndPoint() {
    constexpr uint64_t kColorAndError = 3 + 8, kTrackElement = 4 + 4;
    file_.Skip(kColorAndError, "point");
    file_.Skip(file_.ReadCount(kTrackElement, "track length") * kTrackElement, "track");
  }
  static std::string Warning() { return ""; }

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
    if (!std::exchange(is_next_, false) && !reader_.NextContentLine()) return false;
    ++count_;
    return true;
  }
  std::string Where() const { return reader_.Where(); }
  template <class T>
  int64_t Integer(const char* name) {
    return reader_.Integer(name);
  }
  double Real(const char* name) { return reader_.Real(name); }
  const ColmapCameraModel& CameraModel() { return FindColmapCameraModel(Where(), reader_.Word("camera model")); }
  std::string ImageName() { return reader_.Rest("image name"); }
  /// COLMAP writes a line of them, which may be empty. Other programs leave it out where there are none, and editors at
  /// the end of the file.
  std::vector<ColmapFeature> Features() {
    if (!reader_.NextLine()) return {};
    constexpr int kImageName = 9;  // the place in an image's line; features have numbers only
    is_next_ = reader_.HasText(kImageName);
    std::vector<ColmapFeature> features;
    while (!is_next_ && !reader_.AtEnd()) {
      ColmapFeature feature;
      feature.pixel.x() = reader_.RealOrNan("feature x");
      feature.pixel.y() = reader_.RealOrNan("feature y");
      feature.point_id = reader_.Integer("feature's point id");
      features.push_back(feature);
    }
    return features;
  }
  void EndCamera() { reader_.ExpectEnd(); }
  void EndPoint() {}
  /// COLMAP announces the number in a comment: the only way to see that a file was cut between lines.
  std::string Warning() const {
    if (reader_.announced_count() <= count_) return "";
    return Concat(reader_.Where(), ": the file ends after ", count_, " ", what_, ", and its header announces ",
                  reader_.announced_count(), ": it was cut off, or edited");
  }

 private:
  const char* what_;
  TextReader reader_;
  int64_t count_ = 0;
  bool is_next_ = false;  ///< the line that was read is the next record's
};

/// Reads a file of records, one by one.
template <class Records, class Read>
void ReadRecords(const std::filesystem::path& folder, const char* name, const char* what, uint64_t min_bytes,
                 ColmapModelBuilder* builder, const Read& read) {
  Records records(folder / Concat(name, Records::kExtension), what, min_bytes);
  while (records.Next()) read(&records);
  if (std::string warning = records.Warning(); !warning.empty()) builder->AddWarning(std::move(warning));
}

template <class Records>
ColmapModel ReadModel(const std::filesystem::path& folder) {
  ColmapModelBuilder builder;
  ReadRecords<Records>(folder, "cameras", "cameras", 4 + 4 + 8 + 8 + 2 * 8, &builder, [&](Records* records) {
    const int64_t id = records->template Integer<uint32_t>("camera id");
    const ColmapCameraModel& model = records->CameraModel();
    const int64_t width = records->template Integer<uint64_t>("image width");
    const int64_t height = records->template Integer<uint64_t>("image height");
    std::vector<double> parameters(static_cast<size_t>(model.parameters));
    for (double& parameter : parameters) parameter = records->Real("camera parameter");
    records->EndCamera();
    builder.AddCamera(records->Where(), id, MakeColmapCamera(records->Where(), model, width, height, parameters));
  });
  ReadRecords<Records>(folder, "points3D", "points", 8 + 3 * 8 + 3 + 8 + 8, &builder, [&](Records* records) {
    const int64_t id = records->template Integer<uint64_t>("point id");
    Eigen::Vector3d point;
    for (int i = 0; i < 3; ++i) point[i] = records->Real("point");
    records->EndPoint();
    builder.AddPoint(records->Where(), id, point);
  });
  ReadRecords<Records>(folder, "images", "images", 4 + 7 * 8 + 4 + 1 + 8, &builder, [&](Records* records) {
    SceneImage image;
    const int64_t id = records->template Integer<uint32_t>("image id");
    const std::string where = records->Where();
    Eigen::Vector4d quaternion;
    Eigen::Vector3d translation;
    for (int i = 0; i < 4; ++i) quaternion[i] = records->Real("quaternion");
    for (int i = 0; i < 3; ++i) translation[i] = records->Real("translation");
    const int64_t camera_id = records->template Integer<uint32_t>("camera id");
    image.name = records->ImageName();
    image.cam_from_world = MakeColmapPose(where, quaternion, translation);
    const std::vector<ColmapFeature> features = records->Features();
    builder.AddImage(where, id, camera_id, std::move(image), features);
  });
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
  scene.warnings = std::move(model.warnings);
  size_t missing = 0;
  std::filesystem::path first_missing;
  for (SceneImage& image : model.images) {
    image.path = image_folder / image.name;
    if (!std::filesystem::is_regular_file(image.path)) {
      if (missing++ == 0) first_missing = image.path;
      continue;
    }
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
