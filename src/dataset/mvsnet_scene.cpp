#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <unordered_map>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"
#include "image_codec_private.h"
#include "input_file.h"
#include "scene_readers.h"

namespace acmp {
namespace {

constexpr double kHalfPixel = 0.5;
constexpr double kRounding = 1e-9;  ///< in numbers that must be 0 or 1: matrices may have been multiplied

std::string WithAllDigits(const Eigen::RowVectorXd& numbers) {
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  for (int i = 0; i < numbers.size(); ++i) text << (i > 0 ? " " : "") << numbers[i];  // no iterators in Eigen 3.3
  return text.str();
}

std::filesystem::path FindImage(const std::filesystem::path& folder, int index) {
  for (const int digits : {8, 6}) {
    for (const char* extension : {".jpg", ".png", ".jpeg", ".JPG", ".PNG", ".JPEG"}) {
      auto path = folder / (StringPrintf("%0*d", digits, index) + extension);
      if (std::filesystem::is_regular_file(path)) return path;
    }
  }
  throw InvalidInputError(Concat("image ", index, " is missing: neither ",
                                 (folder / StringPrintf("%08d", index)).string(), " nor ", StringPrintf("%06d", index),
                                 " with extension .jpg, .jpeg or .png"));
}

void ExpectLine(TextReader* reader, const char* what) {
  if (!reader->NextContentLine()) reader->Fail(Concat("the file ends before ", what, ": truncated"));
}

void ExpectKeyword(TextReader* reader, const char* keyword) {
  ExpectLine(reader, keyword);
  const std::string word = reader->Word(keyword);
  if (word != keyword) reader->Fail(Concat("\"", word, "\": must be \"", keyword, "\""));
}

template <int kRows, int kCols>
Eigen::Matrix<double, kRows, kCols> ReadMatrix(TextReader* reader, const char* name) {
  Eigen::Matrix<double, kRows, kCols> matrix;
  for (int row = 0; row < kRows; ++row) {
    ExpectLine(reader, name);
    for (int col = 0; col < kCols; ++col) matrix(row, col) = reader->Real(name);
    reader->ExpectEnd();
  }
  return matrix;
}

RigidTransform ReadExtrinsic(TextReader* reader) {
  ExpectKeyword(reader, "extrinsic");
  const Eigen::Matrix4d matrix = ReadMatrix<4, 4>(reader, "extrinsic");
  const Eigen::RowVector4d last = matrix.row(3);
  if ((last - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > kRounding) {
    reader->Fail(Concat("last row of the extrinsic is ", WithAllDigits(last), ": must be 0 0 0 1"));
  }
  RigidTransform pose(matrix);
  CheckPose(Concat(reader->Where(), ": extrinsic").c_str(), pose);
  // The file has about ten digits: the nearest rotation removes their rounding.
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix.topLeftCorner<3, 3>(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  pose.linear() = svd.matrixU() * svd.matrixV().transpose();
  return pose;
}

PinholeCamera ReadIntrinsic(TextReader* reader, const ImageSize& size, PixelCenters centers) {
  ExpectKeyword(reader, "intrinsic");
  const Eigen::Matrix3d k = ReadMatrix<3, 3>(reader, "intrinsic");
  const bool skew = std::max(std::abs(k(0, 1)), std::abs(k(1, 0))) > kRounding * std::abs(k(0, 0));
  if (skew || (k.row(2) - Eigen::RowVector3d(0, 0, 1)).cwiseAbs().maxCoeff() > kRounding) {
    reader->Fail(Concat("intrinsic ", WithAllDigits(k.row(0)), " / ", WithAllDigits(k.row(1)), " / ",
                        WithAllDigits(k.row(2)), ": must be fx 0 cx / 0 fy cy / 0 0 1 (skew is not supported)"));
  }
  const double first = centers == PixelCenters::kHalf ? kHalfPixel : 0;
  const PinholeCamera camera{size.width, size.height, k(0, 0), k(1, 1), k(0, 2) - first, k(1, 2) - first};
  CheckCamera(reader->Where().c_str(), camera);
  return camera;
}

// The last line: depth_min interval [num [depth_max]]. Two numbers name no far end, so the scene gives no range then.
std::optional<DepthRange> ReadDepthLine(TextReader* reader) {
  ExpectLine(reader, "the depth line");
  DepthRange range;
  range.min = static_cast<float>(reader->Real("depth_min"));
  const double interval = reader->Real("depth interval");
  if (reader->AtEnd()) return std::nullopt;
  const double planes = reader->Real("number of depths");
  range.max = reader->AtEnd() ? static_cast<float>(range.min + interval * (planes - 1))
                              : static_cast<float>(reader->Real("depth_max"));
  CheckDepthRange(Concat(reader->Where(), ": depth range").c_str(), range);
  return range;
}

SceneImage ReadImage(const std::filesystem::path& root, const std::filesystem::path& image_folder, int index,
                     PixelCenters centers) {
  SceneImage image;
  image.path = FindImage(image_folder, index);
  image.name = image.path.filename().string();
  TextReader reader(root / "cams" / StringPrintf("%08d_cam.txt", index));
  image.cam_from_world = ReadExtrinsic(&reader);
  image.camera = ReadIntrinsic(&reader, ReadImageSize(image.path), centers);
  image.depth_range = ReadDepthLine(&reader);
  return image;
}

std::vector<int> ReadRankedSources(TextReader* reader, int64_t index, int64_t count) {
  ExpectLine(reader, "the source views");
  const int64_t sources = reader->Integer("number of source views");
  std::vector<int> ranked;
  for (int64_t i = 0; i < sources; ++i) {
    const int64_t source = reader->Integer("source view");
    reader->Real("source view's score");
    if (source < 0 || source >= count || source == index) {
      reader->Fail(Concat("source view ", source, " of image ", index, ": must be another image, 0 to ", count - 1));
    }
    ranked.push_back(static_cast<int>(source));
  }
  reader->ExpectEnd();
  return ranked;
}

std::vector<std::vector<int>> ReadPairs(const std::filesystem::path& path) {
  constexpr int64_t kMaxImages = 1000000;
  TextReader reader(path);
  ExpectLine(&reader, "the number of images");
  const int64_t count = reader.Integer("number of images");
  reader.ExpectEnd();
  if (count < 1 || count > kMaxImages) {
    reader.Fail(Concat("number of images = ", count, ": must be in [1, ", kMaxImages, "]"));
  }
  std::vector<std::vector<int>> pairs(count);
  std::vector<bool> seen(count, false);
  for (int64_t i = 0; i < count; ++i) {
    ExpectLine(&reader, "the last image");
    const int64_t index = reader.Integer("image index");
    if (index < 0 || index >= count) reader.Fail(Concat("image index ", index, ": must be in [0, ", count - 1, "]"));
    if (seen[index]) reader.Fail(Concat("image index ", index, " occurs twice"));
    seen[index] = true;
    pairs[index] = ReadRankedSources(&reader, index, count);
  }
  return pairs;
}

bool SamePose(const RigidTransform& a, const RigidTransform& b) {
  constexpr double kTolerance = 1e-3;  // both are texts with at least four digits
  return (a.linear() - b.linear()).cwiseAbs().maxCoeff() < kTolerance &&
         (a.translation() - b.translation()).norm() < kTolerance * (1 + a.translation().norm());
}

/// Whether the other reading of the pixel centres would give COLMAP's camera. False for cameras of other images, such
/// as those before undistortion.
bool IsHalfPixelOff(const PinholeCamera& camera, const PinholeCamera& colmap, PixelCenters centers) {
  constexpr double kTolerance_px = 0.01, kSameFocal = 1e-3;
  const double wanted = centers == PixelCenters::kInteger ? kHalfPixel : -kHalfPixel;
  return camera.width == colmap.width && camera.height == colmap.height &&
         std::abs(camera.fx / colmap.fx - 1) < kSameFocal && std::abs(camera.cx - colmap.cx - wanted) < kTolerance_px &&
         std::abs(camera.cy - colmap.cy - wanted) < kTolerance_px;
}

/// Takes the landmarks of a COLMAP model beside the scene, if it has the same images at the same poses.
void AddLandmarks(const std::filesystem::path& model_folder, PixelCenters centers, Scene* scene) {
  ColmapModel model = ReadColmapModel(model_folder);
  std::unordered_map<std::string, const SceneImage*> by_name;
  for (const SceneImage& image : model.images) by_name[image.name] = &image;
  for (const SceneImage& image : scene->images) {
    const auto found = by_name.find(image.name);
    if (found == by_name.end() || !SamePose(found->second->cam_from_world, image.cam_from_world)) {
      scene->warnings.push_back(Concat("landmarks of ", model_folder.string(), " are not used: image ", image.name,
                                       found == by_name.end() ? " is not in it" : " has another pose there"));
      return;
    }
  }
  const bool all_off = std::all_of(scene->images.begin(), scene->images.end(), [&](const SceneImage& image) {
    return IsHalfPixelOff(image.camera, by_name.at(image.name)->camera, centers);
  });
  if (all_off) {
    scene->warnings.push_back(Concat("the principal points of cams/ are half a pixel off those of ",
                                     model_folder.string(), ": pixel centres there are ",
                                     centers == PixelCenters::kInteger ? "half, not integer" : "integer, not half",
                                     " (--pixel-centers)"));
  }
  for (SceneImage& image : scene->images) image.landmark_indices = by_name.at(image.name)->landmark_indices;
  scene->landmarks_in_world = std::move(model.landmarks_in_world);
  scene->warnings.insert(scene->warnings.end(), model.warnings.begin(), model.warnings.end());
}

}  // namespace

bool LooksLikeMvsnet(const std::filesystem::path& root) {
  return std::filesystem::is_directory(root / "cams") && std::filesystem::is_regular_file(root / "pair.txt");
}

Scene ReadMvsnetScene(const std::filesystem::path& root, const std::filesystem::path& image_folder,
                      PixelCenters centers) {
  Scene scene;
  scene.root = root;
  std::vector<std::vector<int>> pairs = ReadPairs(root / "pair.txt");
  for (size_t i = 0; i < pairs.size(); ++i) {
    scene.images.push_back(ReadImage(root, image_folder, static_cast<int>(i), centers));
    scene.images.back().ranked_sources = std::move(pairs[i]);
  }
  const auto model_folder = FindColmapModel(root);
  if (model_folder) AddLandmarks(*model_folder, centers, &scene);
  const auto is_open = [](const SceneImage& image) { return !image.depth_range; };
  const auto open = std::find_if(scene.images.begin(), scene.images.end(), is_open);
  if (open != scene.images.end() && scene.landmarks_in_world.empty()) {
    const auto index = static_cast<int>(open - scene.images.begin());
    scene.warnings.push_back(Concat((root / "cams" / StringPrintf("%08d_cam.txt", index)).string(),
                                    ": the last line names the nearest depth and the interval, and no number of depths "
                                    "(192 with MVSNet's DTU files) and no farthest depth: give --depth-min and "
                                    "--depth-max, or write \"depth_min interval number depth_max\""));
  }
  return scene;
}

}  // namespace acmp
