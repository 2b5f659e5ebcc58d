#include "world.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <set>
#include <utility>

#include <tbb/parallel_for.h>

namespace acmp {
namespace {

constexpr int kCellsAcross = 16;  // image cells with at most one new corner each
// Mean over the window of the squared gradient's smaller eigenvalue, (grey/2px)^2. Noise of s grey levels alone gives
// 2 s^2: 20 in the hard scene.
constexpr double kMinCornerScore = 150;
constexpr double kMaxDepthStep = 0.03;  // relative depth change within the window: points at outlines are not stable
constexpr double kNoise_m = 0.003;      // standard deviation of a landmark's position per axis

// Half size in px of the window that a corner is judged by.
int HalfWindow(const PinholeCamera& camera) { return std::clamp(camera.width / 80, 1, 3); }

struct SlamLandmark {
  Vec3d truth;
  Vec3d mapped;
};

Vec3d PointInCamera(const CameraPose& pose, const Vec3d& point) {
  const Vec3d offset = point - pose.center;
  return {Dot(pose.right, offset), Dot(pose.down, offset), Dot(pose.forward, offset)};
}

// Pixel of a point when it is in view and nothing stands before it.
std::optional<Eigen::Vector2i> Observe(const SyntheticWorld& world, const Rendering& view, const Vec3d& truth) {
  constexpr double kTolerance_m = 1e-3;  // the point itself is hit at the same depth up to float rounding
  constexpr double kMinCosine = 0.2;     // flatter than 11 degrees no frontend matches it
  const Vec3d p = PointInCamera(view.pose, truth);
  if (p.z <= 0) return std::nullopt;
  const int window = HalfWindow(view.camera);
  const double u = view.camera.fx * p.x / p.z + view.camera.cx;
  const double v = view.camera.fy * p.y / p.z + view.camera.cy;
  if (u < window || v < window || u > view.camera.width - 1 - window || v > view.camera.height - 1 - window) {
    return std::nullopt;
  }
  const Ray ray = {view.pose.center, truth - view.pose.center};
  const WorldHit hit = Trace(world, ray);
  const double distance = Norm(ray.direction);
  if (hit.where.t * distance < distance - kTolerance_m) return std::nullopt;
  if (-Dot(hit.where.normal, ray.direction) < kMinCosine * distance) return std::nullopt;
  return Eigen::Vector2i(static_cast<int>(std::floor(u + 0.5)), static_cast<int>(std::floor(v + 0.5)));
}

int Grey(const Rgb& c) { return (77 * c.r + 150 * c.g + 29 * c.b + 128) >> 8; }

// Shi-Tomasi score; sums are integers, so it is the same on every machine.
double CornerScore(const ColorImage& image, int col, int row, int window) {
  int64_t xx = 0, xy = 0, yy = 0;
  for (int v = row - window; v <= row + window; ++v) {
    for (int u = col - window; u <= col + window; ++u) {
      const int gx = Grey(image(u + 1, v)) - Grey(image(u - 1, v));
      const int gy = Grey(image(u, v + 1)) - Grey(image(u, v - 1));
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  const auto difference = static_cast<double>(xx - yy);
  const auto twice_xy = static_cast<double>(2 * xy);
  const double smaller =
      0.5 * (static_cast<double>(xx + yy) - std::sqrt(difference * difference + twice_xy * twice_xy));
  return smaller / ((2 * window + 1) * (2 * window + 1));
}

bool OnTexturedSurface(const Rendering& view, int col, int row) {
  const int window = HalfWindow(view.camera);
  const double depth = view.depth(col, row);
  for (int v = row - window; v <= row + window; ++v) {
    for (int u = col - window; u <= col + window; ++u) {
      if (view.low_texture(u, v) || std::abs(view.depth(u, v) - depth) > kMaxDepthStep * depth) return false;
    }
  }
  return true;
}

// Adds the best corner of each cell of the image in which no earlier landmark is seen.
void AddCorners(const SyntheticWorld& world, const Rendering& view, uint32_t seed,
                std::vector<SlamLandmark>* landmarks) {
  const int window = HalfWindow(view.camera), border = window + 1;
  const int cell_px = std::max(2 * window, view.camera.width / kCellsAcross);
  std::set<std::pair<int, int>> taken;  // column and row of the cell
  for (const SlamLandmark& landmark : *landmarks) {
    const auto pixel = Observe(world, view, landmark.truth);
    if (pixel) taken.insert({pixel->x() / cell_px, pixel->y() / cell_px});
  }
  const auto add_best_of = [&](int first_col, int first_row) {
    const int col_end = std::min(first_col + cell_px, view.camera.width - border);
    const int row_end = std::min(first_row + cell_px, view.camera.height - border);
    double best_score = kMinCornerScore;
    int best_col = -1, best_row = -1;
    for (int row = std::max(first_row, border); row < row_end; ++row) {
      for (int col = std::max(first_col, border); col < col_end; ++col) {
        const double score = CornerScore(view.color, col, row, window);
        if (score <= best_score || !OnTexturedSurface(view, col, row)) continue;
        best_score = score;
        best_col = col;
        best_row = row;
      }
    }
    if (best_col < 0) return;
    const Ray ray = PixelRay(view.camera, view.pose, best_col, best_row);
    const Vec3d truth = ray.origin + Trace(world, ray).where.t * ray.direction;
    RandomStream random(seed, static_cast<uint32_t>(landmarks->size()), 0x1a4d);
    const Vec3d error = {BellNoise(&random, kNoise_m), BellNoise(&random, kNoise_m),
                         BellNoise(&random, kNoise_m)};  // braces fix the order of draws
    landmarks->push_back({truth, truth + error});
  };
  for (int row = 0; row < view.camera.height; row += cell_px) {
    for (int col = 0; col < view.camera.width; col += cell_px) {
      if (taken.count({col / cell_px, row / cell_px}) == 0) add_best_of(col, row);
    }
  }
}

}  // namespace

std::vector<std::vector<Eigen::Vector3d>> MakeLandmarks(const SyntheticWorld& world,
                                                        const std::vector<Rendering>& views, uint32_t seed) {
  std::vector<SlamLandmark> landmarks;
  for (const Rendering& view : views) AddCorners(world, view, seed, &landmarks);
  std::vector<std::vector<char>> seen(views.size(), std::vector<char>(landmarks.size()));
  tbb::parallel_for(size_t{0}, views.size(), [&](size_t view) {
    for (size_t i = 0; i < landmarks.size(); ++i) {
      seen[view][i] = Observe(world, views[view], landmarks[i].truth) ? 1 : 0;
    }
  });
  const int min_views = views.size() > 2 ? 3 : 2;
  std::vector<std::vector<Eigen::Vector3d>> observed(views.size());
  for (size_t i = 0; i < landmarks.size(); ++i) {
    int count = 0;
    for (const std::vector<char>& by_view : seen) count += by_view[i];
    const Vec3d& p = landmarks[i].mapped;
    for (size_t view = 0; view < views.size() && count >= min_views; ++view) {
      if (seen[view][i]) observed[view].emplace_back(p.x, p.y, p.z);
    }
  }
  return observed;
}

}  // namespace acmp
