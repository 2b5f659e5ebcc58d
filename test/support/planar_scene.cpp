#include "support/planar_scene.h"

#include <cmath>
#include <random>

namespace acmp {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kRad = kPi / 180;

}  // namespace

WaveTexture::WaveTexture(uint32_t seed, double shortest, double longest) {
  // The engine's numbers are fixed by the standard; the distributions' are not, so they are not used.
  std::mt19937 engine(seed);
  const auto uniform = [&] { return engine() / 4294967296.0; };
  for (int i = 0; i < 24; ++i) {
    const double direction = 2 * kPi * uniform();
    const double wavelength = shortest * std::pow(longest / shortest, uniform());
    const double frequency = 2 * kPi / wavelength;
    waves_.push_back({frequency * std::cos(direction), frequency * std::sin(direction), 2 * kPi * uniform()});
  }
}

double WaveTexture::operator()(double x, double y) const {
  double sum = 0;
  for (const Wave& wave : waves_) sum += std::sin(wave.kx * x + wave.ky * y + wave.phase);
  return 128 + 12 * sum;  // standard deviation 12 * sqrt(24 / 2) = 42
}

WorldPlane WorldPlane::Slanted(double tilt_x_deg, double tilt_y_deg, double distance) {
  const Eigen::Matrix3d turn = (Eigen::AngleAxisd(tilt_x_deg * kRad, Eigen::Vector3d::UnitX()) *
                                Eigen::AngleAxisd(tilt_y_deg * kRad, Eigen::Vector3d::UnitY()))
                                   .toRotationMatrix();
  WorldPlane plane;
  plane.normal = turn * Eigen::Vector3d(0, 0, -1);
  plane.d = -plane.normal.dot(Eigen::Vector3d(0, 0, distance));
  return plane;
}

MatchView PlanarView::View(bool with_depth) const {
  MatchView view;
  view.gray = gray.View();
  view.camera = camera;
  view.cam_from_world = cam_from_world;
  if (with_depth) view.depth = depth.View();
  return view;
}

PinholeCamera TestCamera(int width, int height) {
  const double focal = 0.8660254037844386 * width;
  return {width, height, focal, focal, 0.51 * width - 0.5, 0.48 * height - 0.5};
}

RigidTransform LookAhead(const Eigen::Vector3d& center, double yaw_deg, double pitch_deg, double roll_deg) {
  RigidTransform world_from_cam = RigidTransform::Identity();
  world_from_cam.linear() = (Eigen::AngleAxisd(yaw_deg * kRad, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(pitch_deg * kRad, Eigen::Vector3d::UnitX()) *
                             Eigen::AngleAxisd(roll_deg * kRad, Eigen::Vector3d::UnitZ()))
                                .toRotationMatrix();
  world_from_cam.translation() = center;
  return world_from_cam.inverse();
}

PlanarView RenderPlane(const WorldPlane& plane, const WaveTexture& texture, const PinholeCamera& camera,
                       const RigidTransform& cam_from_world) {
  PlanarView view;
  view.camera = camera;
  view.cam_from_world = cam_from_world;
  view.gray = GrayImage(camera.width, camera.height);
  view.depth = DepthMap(camera.width, camera.height);
  const RigidTransform world_from_cam = cam_from_world.inverse();
  const Eigen::Vector3d center = world_from_cam.translation();
  // Axes of the texture on the plane: any two that span it.
  const Eigen::Vector3d axis_x = plane.normal.cross(Eigen::Vector3d(0.1, 1, 0.2)).normalized();
  const Eigen::Vector3d axis_y = plane.normal.cross(axis_x);
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector3d ray = world_from_cam.linear() * camera.Unproject({1.0 * col, 1.0 * row});
      const double depth = -(plane.normal.dot(center) + plane.d) / plane.normal.dot(ray);
      const Eigen::Vector3d point = center + depth * ray;
      view.gray(col, row) = static_cast<float>(texture(axis_x.dot(point), axis_y.dot(point)));
      view.depth(col, row) = depth > 0 ? static_cast<float>(depth) : 0.0f;
    }
  }
  return view;
}

std::vector<PlanarView> RenderPlanarScene(const WorldPlane& plane, int width, int height, int views) {
  const PinholeCamera camera = TestCamera(width, height);
  // Wavelengths of 6 to 30 px: several within a window, and long enough for bilinear sampling.
  const double pixel_m = plane.d / camera.fx;
  const WaveTexture texture(11, 6 * pixel_m, 30 * pixel_m);
  std::vector<PlanarView> rendered;
  for (int i = 0; i < views; ++i) {
    // The first in the middle, the others on a ring around it.
    const double angle = 2 * kPi * i / std::max(1, views - 1) + 0.3;
    const double radius = i == 0 ? 0.0 : 0.3;
    const Eigen::Vector3d center(radius * std::cos(angle), radius * std::sin(angle), i == 0 ? 0.0 : 0.04 * (i % 3 - 1));
    rendered.push_back(RenderPlane(plane, texture, camera,
                                   LookAhead(center, -4 * center.x(), 3 * center.y(), i == 0 ? 0.0 : 2.0 * (i % 2))));
  }
  return rendered;
}

PatchMatchProblem MakeProblem(const std::vector<PlanarView>& views, size_t reference, const DepthRange& range,
                              bool with_depths) {
  PatchMatchProblem problem;
  problem.reference = views[reference].View();
  for (size_t i = 0; i < views.size(); ++i) {
    if (i != reference) problem.sources.push_back(views[i].View(with_depths));
  }
  problem.depth_range = range;
  return problem;
}

}  // namespace acmp
