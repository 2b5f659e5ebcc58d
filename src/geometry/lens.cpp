#include "acmp_mapping/geometry/lens.h"

#include <Eigen/QR>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/lens_models.h"

namespace acmp {
namespace {

constexpr double kHalfTurn = 180 * kRadPerDeg<double>;  // rad

using Model = LensDistortion::Model;

void CheckSphere(const PinholeCamera& camera) {
  const double columns = 2 * kHalfTurn * camera.fx;
  if (camera.width == 2 * camera.height && std::abs(columns - camera.width) < 0.5) return;
  throw InvalidInputError(Concat("equirectangular image of ", camera.width, "x", camera.height,
                                 " pixels: must be twice as wide as high and show the whole sphere"));
}

}  // namespace

const std::vector<LensModel>& LensModels() {
  static const std::vector<LensModel> models = {
      {Model::kBrownConrady, "plumb_bob", 4, 5, 180, true, {"plumbbob", "radtan", "radialtangential", "brownconrady"}},
      {Model::kRational, "rational_polynomial", 4, 8, 180, true, {"rationalpolynomial", "radialtangential8"}},
      {Model::kEquidistant,
       "equidistant",
       4,
       4,
       360,
       true,
       {"equidistant", "equi", "fisheye", "kannalabrandt", "kannalabrandt4", "kannalabrandt8"}},
      {Model::kUnified, "mei", 5, 5, 360, true, {"mei", "unified", "omnidirectional", "omni", "omniradtan"}},
      {Model::kExtendedUnified, "eucm", 2, 2, 360, false, {"eucm", "extendedunified", "enhancedunified"}},
      {Model::kDoubleSphere, "double_sphere", 2, 2, 360, false, {"doublesphere", "ds"}},
      {Model::kEquirectangular, "equirectangular", 0, 0, 360, false, {"equirectangular", "spherical"}}};
  return models;
}

const LensModel& LensModelOf(LensDistortion::Model model) {
  for (const LensModel& known : LensModels()) {
    if (known.model == model) return known;
  }
  return LensModels().front();
}

const LensModel* FindLensModel(const std::string& name) {
  std::string plain;
  for (const unsigned char c : name) {
    if (std::isalnum(c)) plain += static_cast<char>(std::tolower(c));
  }
  for (const LensModel& model : LensModels()) {
    for (const char* known : model.names) {
      if (plain == known) return &model;
    }
  }
  return nullptr;
}

Lens::Lens(const PinholeCamera& camera, const LensDistortion& distortion, double field_of_view)
    : camera_(camera), distortion_(distortion) {
  std::copy_n(distortion.coefficients.begin(), std::min(distortion.coefficients.size(), k_.size()), k_.begin());
  const double largest_field = LensModelOf(distortion.model).largest_field;
  if (field_of_view != 0) CheckRange("field_of_view of this lens", field_of_view, 1.0, largest_field);
  const double wanted = 0.5 * kRadPerDeg<double> * (field_of_view != 0 ? field_of_view : largest_field);
  limit_ = wanted;
  if (distortion.model == Model::kEquirectangular) {
    CheckSphere(camera);
  } else if (distortion.model != Model::kNone) {
    constexpr int kSteps = 1000;
    double radius = 0;
    for (int i = 1; i < kSteps; ++i) {  // the last of a plane would be infinite
      const double next = Radius(wanted * i / kSteps);
      if (!(next > radius) || !std::isfinite(next)) {
        limit_ = wanted * (i - 1) / kSteps;
        break;
      }
      radius = next;
    }
    const double seen_px = radius * std::min(camera.fx, camera.fy);
    const double least_px = 0.25 * std::min(camera.width, camera.height);
    if (limit_ < wanted && (field_of_view != 0 || seen_px < least_px)) {
      throw InvalidInputError(Concat(
          "lens distortion: with these coefficients rays go outwards in the image up to ", limit_ / kRadPerDeg<double>,
          " degrees from the axis only, ", seen_px, " px from the principal point: must be at least ",
          field_of_view != 0 ? Concat(0.5 * field_of_view, " degrees (field_of_view)") : Concat(least_px, " px")));
    }
  }
  cos_limit_ = std::cos(limit_);
  const bool ends = limit_ < 0.5 * kRadPerDeg<double> * largest_field;
  radius_ = ends ? Radius(limit_) : std::numeric_limits<double>::infinity();
}

/// Distance from the axis at which a ray of this angle is seen, for a focal length of 1; tangential distortion aside.
double Lens::Radius(double angle) const {
  const double a2 = angle * angle;
  double r = 0;
  switch (distortion_.model) {
    case Model::kEquidistant:
      return angle * (1 + a2 * (k_[0] + a2 * (k_[1] + a2 * (k_[2] + a2 * k_[3]))));
    case Model::kUnified: {
      const double xi = k_[0], depth = std::cos(angle) + xi;
      if (!(depth > 0) || (xi > 1 && std::cos(angle) < -1 / xi)) return -1;
      r = std::sin(angle) / depth;
      break;
    }
    case Model::kExtendedUnified: {
      const double alpha = k_[0], z = std::cos(angle), x = std::sin(angle);
      const double depth = alpha * std::sqrt(k_[1] * x * x + z * z) + (1 - alpha) * z;
      return depth > 0 ? x / depth : -1;
    }
    case Model::kDoubleSphere: {
      if (!(k_[0] > -1)) return -1;  // the axis would not be seen in the middle
      const double alpha = k_[1], z = std::cos(angle) + k_[0], x = std::sin(angle);
      const double depth = alpha * std::sqrt(x * x + z * z) + (1 - alpha) * z;
      return depth > 0 ? x / depth : -1;
    }
    default:
      r = std::tan(angle);
  }
  return r * RadialFactor(r * r);
}

double Lens::RadialFactor(double r2) const {
  if (distortion_.model == Model::kUnified) return 1 + r2 * (k_[1] + r2 * k_[2]);
  const double above = 1 + r2 * (k_[0] + r2 * (k_[1] + r2 * k_[4]));
  const double below = 1 + r2 * (k_[5] + r2 * (k_[6] + r2 * k_[7]));
  return below > 0 ? above / below : -1;
}

/// Radial and tangential distortion of an image point, for a focal length of 1.
Eigen::Vector2d Lens::Bend(const Eigen::Vector2d& ideal) const {
  const size_t p = distortion_.model == Model::kUnified ? 3 : 2;
  const double x = ideal.x(), y = ideal.y(), r2 = x * x + y * y, radial = RadialFactor(r2);
  return {x * radial + 2 * k_[p] * x * y + k_[p + 1] * (r2 + 2 * x * x),
          y * radial + k_[p] * (r2 + 2 * y * y) + 2 * k_[p + 1] * x * y};
}

std::optional<Eigen::Vector2d> Lens::Project(const Eigen::Vector3d& ray) const {
  const double length = ray.norm();
  if (!(ray.z() >= cos_limit_ * length)) return std::nullopt;
  Eigen::Vector2d seen;
  switch (distortion_.model) {
    case Model::kEquirectangular:
      seen = {std::atan2(ray.x(), ray.z()), std::asin(std::clamp(ray.y() / length, -1.0, 1.0))};
      break;
    case Model::kEquidistant:
    case Model::kExtendedUnified:
    case Model::kDoubleSphere: {
      const double sine = ray.head<2>().norm();
      seen = ray.head<2>() * (sine > 0 ? Radius(std::atan2(sine, ray.z())) / sine : 1 / length);
      break;
    }
    case Model::kUnified:
      seen = Bend(ray.head<2>() / (ray.z() + k_[0] * length));
      break;
    default:
      if (!(ray.z() > 0)) return std::nullopt;
      seen = Bend(ray.head<2>() / ray.z());
  }
  return Eigen::Vector2d(camera_.fx * seen.x() + camera_.cx, camera_.fy * seen.y() + camera_.cy);
}

bool Lens::Shows(const Eigen::Vector2d& pixel) const {
  const double x = (pixel.x() - camera_.cx) / camera_.fx, y = (pixel.y() - camera_.cy) / camera_.fy;
  if (distortion_.model == Model::kEquirectangular) return std::cos(y) * std::cos(x) >= cos_limit_;
  return std::hypot(x, y) <= radius_;
}

std::optional<Eigen::Vector3d> Lens::Unproject(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d seen((pixel.x() - camera_.cx) / camera_.fx, (pixel.y() - camera_.cy) / camera_.fy);
  if (distortion_.model == Model::kEquirectangular) {
    if (std::abs(seen.x()) > kHalfTurn || std::abs(seen.y()) > 0.5 * kHalfTurn) return std::nullopt;
    const double level = std::cos(seen.y());
    return Eigen::Vector3d(level * std::sin(seen.x()), std::sin(seen.y()), level * std::cos(seen.x()));
  }
  constexpr int kRounds = 50;
  constexpr double kClose = 1e-12;
  Eigen::Vector2d aim = seen;  // what would be seen there without tangential distortion
  for (int round = 0; round < kRounds; ++round) {
    double low = 0, high = limit_;  // Radius grows in between
    if (distortion_.model == Model::kNone) {
      low = high = std::atan(aim.norm());
    } else if (!(Radius(limit_) >= aim.norm())) {
      return std::nullopt;
    }
    while (high - low > kClose) {
      const double middle = 0.5 * (low + high);
      (Radius(middle) < aim.norm() ? low : high) = middle;
    }
    const Eigen::Vector2d outwards = aim.norm() > 0 ? aim.normalized() : Eigen::Vector2d::Zero();
    const Eigen::Vector3d ray(std::sin(low) * outwards.x(), std::sin(low) * outwards.y(), std::cos(low));
    const auto found = Project(ray);
    if (!found) return std::nullopt;
    const Eigen::Vector2d error = pixel - *found;
    if (error.norm() < 1e-6) return ray.normalized();
    aim += Eigen::Vector2d(error.x() / camera_.fx, error.y() / camera_.fy);
  }
  return std::nullopt;
}

double Lens::FieldOfView() const {
  const auto angle_at = [&](double col, double row) {
    const auto ray = Unproject({col, row});
    return ray ? std::atan2(ray->head<2>().norm(), ray->z()) : limit_;
  };
  if (distortion_.model == Model::kEquirectangular) return 360;
  const PinholeCamera& c = camera_;
  const double across = angle_at(-0.5, c.cy) + angle_at(c.width - 0.5, c.cy);
  const double down = angle_at(c.cx, -0.5) + angle_at(c.cx, c.height - 0.5);
  return std::max(across, down) / kRadPerDeg<double>;
}

PinholeCamera Lens::Undistorted() const {
  PinholeCamera camera = camera_;
  if (distortion_.model == Model::kUnified || distortion_.model == Model::kDoubleSphere) {
    camera.fx /= 1 + k_[0];  // sin(a) / (cos(a) + xi), for small angles
    camera.fy /= 1 + k_[0];
  }
  return camera;
}

bool CanHaveRadialDistortion(Model model) { return LensModelOf(model).can_be_radial; }

LensDistortion WithRadialDistortion(const Lens& lens, double k1, double k2) {
  const PinholeCamera& c = lens.camera();
  LensDistortion fitted = lens.distortion();
  if (fitted.model == Model::kNone) fitted = {Model::kBrownConrady, {}};
  const size_t size = fitted.model == Model::kRational ? 8 : fitted.model == Model::kEquidistant ? 4 : 5;
  fitted.coefficients.resize(size);
  std::vector<Eigen::Vector3d> rays;
  std::vector<Eigen::Vector2d> seen;
  constexpr int kPlaces = 12;  // across and down
  for (int i = 0; i < kPlaces * kPlaces; ++i) {
    const Eigen::Vector2d place((i % kPlaces + 0.5) / kPlaces, (i / kPlaces + 0.5) / kPlaces);
    const Eigen::Vector3d ray = c.Unproject({place.x() * c.width - 0.5, place.y() * c.height - 0.5});
    const double r2 = ray.head<2>().squaredNorm(), factor = 1 + r2 * (k1 + r2 * k2);
    const auto pixel = lens.Project({factor * ray.x(), factor * ray.y(), 1});
    if (!pixel) continue;
    rays.push_back(ray);
    seen.push_back(*pixel);
  }
  const auto errors = [&](const LensDistortion& distortion) {
    const Lens tried(c, distortion);
    Eigen::VectorXd result = Eigen::VectorXd::Zero(2 * static_cast<Eigen::Index>(rays.size()));
    for (size_t i = 0; i < rays.size(); ++i) {
      const auto pixel = tried.Project(rays[i]);
      if (pixel) result.segment<2>(2 * static_cast<Eigen::Index>(i)) = *pixel - seen[i];
    }
    return result;
  };
  constexpr int kSteps = 5;  // the coefficients of most models are linear: one would do
  constexpr double kStep = 1e-5;
  for (int step = 0; step < kSteps; ++step) {
    const Eigen::VectorXd now = errors(fitted);
    Eigen::MatrixXd derivatives(now.size(), static_cast<Eigen::Index>(size));
    for (size_t k = 0; k < size; ++k) {
      LensDistortion moved = fitted;
      moved.coefficients[k] += kStep;
      derivatives.col(static_cast<Eigen::Index>(k)) = (errors(moved) - now) / kStep;
    }
    // Coefficients that hardly differ within the image share what there is (least norm).
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver;
    solver.setThreshold(1e-4);
    const Eigen::VectorXd change = solver.compute(derivatives).solve(now);
    for (size_t k = 0; k < size; ++k) fitted.coefficients[k] -= change[static_cast<Eigen::Index>(k)];
  }
  return fitted;
}

void CheckLens(const std::string& name, const PinholeCamera& camera, const LensDistortion& distortion,
               double field_of_view) {
  try {
    const Lens lens(camera, distortion, field_of_view);
  } catch (const InvalidInputError& error) {
    throw InvalidInputError(Concat(name, ": ", error.what()));
  }
}

std::vector<PinholeFace> FacesOf(const Lens& lens) {
  if (lens.FieldOfView() <= kWideFieldOfView) return {{"", lens.Undistorted()}};
  constexpr double kHalfWidth = 1.1;   // at z = 1: 3 degrees more than to the edge, so that windows there are whole
  constexpr double kLeastShare = 0.2;  // of a face: 15 degrees beyond the edge of the one ahead
  constexpr int kCells = 64;
  const PinholeCamera& c = lens.camera();
  const double focal = std::min(lens.Undistorted().fx, lens.Undistorted().fy);
  const int size = std::max(2, static_cast<int>(std::ceil(2 * kHalfWidth * focal)));
  const PinholeCamera whole = {size, size, focal, focal, 0.5 * (size - 1), 0.5 * (size - 1)};
  std::vector<PinholeFace> faces = {{"", whole},   {"left", whole}, {"right", whole},
                                    {"up", whole}, {"down", whole}, {"back", whole}};
  // Columns: x, y and z of the face.
  faces[1].lens_from_face << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  faces[2].lens_from_face << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  faces[3].lens_from_face << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  faces[4].lens_from_face << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  faces[5].lens_from_face << -1, 0, 0, 0, 1, 0, 0, 0, -1;
  std::vector<PinholeFace> shown;
  for (PinholeFace& face : faces) {
    int left = kCells, right = -1, top = kCells, bottom = -1, seen = 0;  // cells
    for (int row = 0; row < kCells; ++row) {
      for (int col = 0; col < kCells; ++col) {
        const double cell_px = static_cast<double>(size) / kCells;
        const Eigen::Vector2d pixel((col + 0.5) * cell_px - 0.5, (row + 0.5) * cell_px - 0.5);
        const auto in_lens = lens.Project(face.lens_from_face * whole.Unproject(pixel));
        if (!in_lens || !c.Contains(*in_lens)) continue;
        ++seen;
        left = std::min(left, col), right = std::max(right, col);
        top = std::min(top, row), bottom = std::max(bottom, row);
      }
    }
    if (seen < kLeastShare * kCells * kCells) continue;
    const auto pixel_at = [&](int cell) { return std::clamp(cell, 0, kCells) * size / kCells; };
    const int x = pixel_at(left - 1), y = pixel_at(top - 1);
    face.camera.width = pixel_at(right + 2) - x;
    face.camera.height = pixel_at(bottom + 2) - y;
    face.camera.cx -= x;
    face.camera.cy -= y;
    shown.push_back(face);
  }
  if (shown.empty()) {
    throw InvalidInputError(Concat("camera of ", c.width, "x", c.height, " pixels with its principal point at (", c.cx,
                                   ", ", c.cy, "): its lens shows hardly anything of any direction"));
  }
  return shown;
}

}  // namespace acmp
