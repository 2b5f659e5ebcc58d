#include "acmp_mapping/fusion/consistency_check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "acmp_mapping/common/error.h"
#include "vector_conversion.h"

namespace acmp {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr size_t kMaxSources = 255;  // ConsistencyResult counts views in a byte

/// For vectors of any length.
double CosineOfAngle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.dot(b) / std::sqrt(a.squaredNorm() * b.squaredNorm());
}

/// For vectors of any length. Exact for small angles, unlike the arc cosine, but much slower than the cosine.
double Angle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

/// 1 - cos(angle) = 2 sin^2(angle / 2).
double AngleOfVersine(float versine) {
  return 2 * std::asin(std::sqrt(std::min(1.0, std::max(0.0, 0.5 * static_cast<double>(versine)))));
}

bool IsKnown(float depth) { return depth > 0 && std::isfinite(depth); }

bool IsKnown(const Vec3f& normal) {
  const float squared_norm = Dot(normal, normal);
  return squared_norm > 0 && std::isfinite(squared_norm);
}

template <class T>
void CheckSize(const std::string& name, const char* map, const ImageView<const T>& view, const PinholeCamera& camera) {
  if (view.width == camera.width && view.height == camera.height) return;
  throw InvalidInputError(Concat(name, ": ", map, " map is ", view.width, " x ", view.height, " but the camera is ",
                                 camera.width, " x ", camera.height, ": sizes must be equal"));
}

void CheckView(const std::string& name, const FusionView& view) {
  CheckCamera(name.c_str(), view.camera);
  CheckSize(name, "depth", view.depth, view.camera);
  CheckSize(name, "normal", view.normal, view.camera);
  CheckSize(name, "cost", view.cost, view.camera);
  if (!view.color.empty()) CheckSize(name, "colour", view.color, view.camera);
  const Eigen::Matrix3d rotation = view.cam_from_world.linear();
  const double error = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  // Poses written with six digits are off by 1e-6 or so; a scale or a reflection is a mistake.
  if (!(error <= 1e-3) || !(rotation.determinant() > 0) || !view.cam_from_world.translation().allFinite()) {
    throw InvalidInputError(Concat(name, ": pose is not a finite rigid motion; R^T R differs from 1 by ", error,
                                   ", limit 0.001; det R = ", rotation.determinant(), ", must be > 0"));
  }
}

}  // namespace

ConsistencyChecker::ConsistencyChecker(const FusionView& reference, const std::vector<const FusionView*>& sources,
                                       const FusionOptions& options)
    : reference_(reference),
      sources_(sources),
      options_(options),
      min_normal_cosine_(std::cos(options.max_normal_angle_deg * kPi / 180)) {
  Validate(options);
  CheckRange("number of source views", sources.size(), size_t{0}, kMaxSources);
  CheckView("reference view", reference);
  for (size_t i = 0; i < sources.size(); ++i) {
    if (sources[i]->depth.empty()) continue;
    CheckView(Concat("source view ", i), *sources[i]);
    pairs_.push_back(MakePair(static_cast<int>(i), reference, *sources[i]));
  }
}

ConsistencyChecker::Pair ConsistencyChecker::MakePair(int source, const FusionView& reference, const FusionView& view) {
  const RigidTransform reference_from_source = reference.cam_from_world * view.cam_from_world.inverse();
  const RigidTransform source_from_reference = view.cam_from_world * reference.cam_from_world.inverse();
  const Eigen::Matrix3d reference_k = reference.camera.K(), source_k = view.camera.K();
  Pair pair;
  pair.source = source;
  pair.view = view;
  pair.to_source = source_k * source_from_reference.linear() * reference_k.inverse();
  pair.to_source_offset = source_k * source_from_reference.translation();
  pair.to_reference = reference_k * reference_from_source.linear() * source_k.inverse();
  pair.to_reference_offset = reference_k * reference_from_source.translation();
  pair.reference_from_source_rotation = reference_from_source.linear();
  pair.source_center = reference_from_source.translation();
  return pair;
}

bool ConsistencyChecker::HasDepth(int col, int row) const { return IsKnown(reference_.depth(col, row)); }

bool ConsistencyChecker::Match(const Pair& pair, const ReferencePixel& pixel, PixelMatch* match) const {
  const Eigen::Vector3d in_source = pixel.depth * (pair.to_source * pixel.homogeneous) + pair.to_source_offset;
  if (!(in_source.z() > 0)) return false;
  const Eigen::Vector2d source_pixel = in_source.head<2>() / in_source.z();
  if (!pair.view.camera.Contains(source_pixel)) return false;
  // Half a pixel up and truncated: the nearest pixel, as positions inside are at least -0.5. The sum may round up to
  // the width for the last representable position inside.
  const Eigen::Vector2d shifted = source_pixel + Eigen::Vector2d::Constant(0.5);
  const int source_col = std::min(static_cast<int>(shifted.x()), pair.view.camera.width - 1);
  const int source_row = std::min(static_cast<int>(shifted.y()), pair.view.camera.height - 1);
  const float source_depth = pair.view.depth(source_col, source_row);
  if (!IsKnown(source_depth)) return false;

  const Eigen::Vector3d back =
      source_depth * (pair.to_reference * Eigen::Vector3d(source_col, source_row, 1)) + pair.to_reference_offset;
  // A point behind the reference needs no test of its own: it misses the limit on depths, which is below 1.
  const Eigen::Vector2d back_pixel = back.head<2>() / back.z();
  const double reprojection_px = (back_pixel - pixel.homogeneous.head<2>()).norm();
  if (!(reprojection_px < options_.max_reprojection_px)) return false;
  const double relative_depth = std::abs(back.z() - pixel.depth) / pixel.depth;
  if (!(relative_depth < options_.max_relative_depth)) return false;
  const Eigen::Vector3d normal =
      pair.reference_from_source_rotation * ToEigen(pair.view.normal(source_col, source_row));
  // The cosine is NaN for an unknown normal, which fails the test.
  if (!(CosineOfAngle(normal, pixel.normal) > min_normal_cosine_)) return false;

  match->source = pair.source;
  match->col = source_col;
  match->row = source_row;
  match->point = ToVec3f(reference_.camera.Unproject(back_pixel, back.z()));
  match->normal = ToVec3f(normal.normalized());
  match->angle_versine = static_cast<float>(1 - CosineOfAngle(pixel.point, pixel.point - pair.source_center));
  match->agreement = 0;
  if (options_.dynamic_consistency) {
    const double error = reprojection_px + 200 * relative_depth + 10 * Angle(normal, pixel.normal);
    match->agreement = static_cast<float>(std::exp(-error));
  }
  return true;
}

void ConsistencyChecker::FindMatches(int col, int row, std::vector<PixelMatch>* matches) const {
  if (!HasDepth(col, row) || !IsKnown(reference_.normal(col, row))) return;
  const double depth = reference_.depth(col, row);
  const ReferencePixel pixel = {{static_cast<double>(col), static_cast<double>(row), 1},
                                reference_.camera.Unproject({col, row}, depth),
                                ToEigen(reference_.normal(col, row)),
                                depth};
  PixelMatch match;
  for (const Pair& pair : pairs_) {
    if (Match(pair, pixel, &match)) matches->push_back(match);
  }
}

bool ConsistencyChecker::Accepts(const std::vector<PixelMatch>& matches) const {
  if (!options_.dynamic_consistency) return static_cast<int>(matches.size()) >= options_.min_consistent_views;
  double sum = 0;
  for (const PixelMatch& match : matches) sum += match.agreement;
  return sum > 0.3 * static_cast<double>(matches.size());
}

float ConsistencyChecker::Confidence(int col, int row, const std::vector<PixelMatch>& matches) const {
  double median_rad = 0;
  if (!matches.empty()) {
    // Versines are in the order of their angles, so only the middle ones have to be turned into angles.
    std::array<float, kMaxSources> versines;
    const size_t count = matches.size();
    for (size_t i = 0; i < count; ++i) versines[i] = matches[i].angle_versine;
    std::sort(versines.begin(), versines.begin() + count);
    median_rad = 0.5 * (AngleOfVersine(versines[(count - 1) / 2]) + AngleOfVersine(versines[count / 2]));
  }
  return ComputeConfidence(reference_.cost(col, row), static_cast<int>(matches.size()),
                           static_cast<float>(median_rad * 180 / kPi));
}

SurfacePoint ConsistencyChecker::Average(int col, int row, const std::vector<PixelMatch>& matches) const {
  Eigen::Vector3d position = reference_.camera.Unproject({col, row}, reference_.depth(col, row));
  const Eigen::Vector3d own_normal = ToEigen(reference_.normal(col, row)).normalized();
  Eigen::Vector3d normal = own_normal;
  Eigen::Vector3d color = Eigen::Vector3d::Zero();
  int color_count = 0;
  const auto add_color = [&](const ImageView<const Rgb>& image, int at_col, int at_row) {
    if (image.empty()) return;
    const Rgb& rgb = image(at_col, at_row);
    color += Eigen::Vector3d(rgb.r, rgb.g, rgb.b);
    ++color_count;
  };
  add_color(reference_.color, col, row);
  for (const PixelMatch& match : matches) {
    position += ToEigen(match.point);
    normal += ToEigen(match.normal);
    add_color(sources_[match.source]->color, match.col, match.row);
  }
  position /= 1.0 + static_cast<double>(matches.size());
  if (color_count > 0) color /= color_count;
  // With limits near 180 degrees normals may cancel; the reference's own is then as good as any.
  if (!(normal.norm() > 1e-6)) normal = own_normal;

  SurfacePoint point;
  point.position = ToVec3f(position);
  point.normal = ToVec3f(normal.normalized());
  point.color = {static_cast<unsigned char>(std::lround(color.x())), static_cast<unsigned char>(std::lround(color.y())),
                 static_cast<unsigned char>(std::lround(color.z()))};
  point.confidence = Confidence(col, row, matches);
  return point;
}

}  // namespace acmp
