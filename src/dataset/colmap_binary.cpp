#include "colmap_model.h"
#include "input_file.h"

namespace acmp {
namespace {

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

}  // namespace

void ReadColmapBinary(const std::filesystem::path& folder, ColmapModelBuilder* builder) {
  ReadBinaryCameras(folder / "cameras.bin", builder);
  ReadBinaryPoints(folder / "points3D.bin", builder);
  ReadBinaryImages(folder / "images.bin", builder);
}

}  // namespace acmp
