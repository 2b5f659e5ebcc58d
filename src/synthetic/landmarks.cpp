#include "world.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

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

struct Landmark {
  Vec3d truth;
  Vec3d mapped;
};

Vec3d PointInCamera(const CameraPose& pose, const Vec3d& point) {
  const Vec3d offset = point - pose.center;
  return {Dot(pose.right, offset), Dot(pose.down, offset), Dot(pose.forward, offset)};
}

// Pixel of a point when it is in view and nothing stands before it.
bool Observes(const SyntheticWorld& world, const Rendering& view, const Vec3d& truth, int* col, int* row) {
  constexpr double kTolerance_m = 1e-3;  // the point itself is hit at the same depth up to float rounding
  constexpr double kMinCosine = 0.2;     // flatter than 11 degrees no frontend matches it
  const Vec3d p = PointInCamera(view.pose, truth);
  if (p.z <= 0) return false;
  const int window = HalfWindow(view.camera);
  const double u = view.camera.fx * p.x / p.z + view.camera.cx;
  const double v = view.camera.fy * p.y / p.z + view.camera.cy;
  if (u < window || v < window || u > view.camera.width - 1 - window || v > view.camera.height - 1 - window)
    return false;
  const Ray ray = {view.pose.center, truth - view.pose.center};
  const WorldHit hit = Trace(world, ray);
  const double distance = Norm(ray.direction);
  if (hit.where.t * distance < distance - kTolerance_m) return false;
  if (-Dot(hit.where.normal, ray.direction) < kMinCosine * distance) return false;
  *col = static_cast<int>(std::floor(u + 0.5));
  *row = static_cast<int>(std::floor(v + 0.5));
  return true;
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

class LandmarkMaker {
 public:
  LandmarkMaker(const SyntheticWorld& world, const std::vector<Rendering>& views, uint32_t seed)
      : world_(world), views_(views), seed_(seed) {
    for (size_t i = 0; i < views_.size(); ++i) AddCorners(i);
  }

  std::vector<std::vector<Eigen::Vector3d>> ObservedByView() const {
    std::vector<std::vector<char>> seen(views_.size(), std::vector<char>(landmarks_.size()));
    tbb::parallel_for(size_t{0}, views_.size(), [&](size_t view) {
      int col, row;
      for (size_t i = 0; i < landmarks_.size(); ++i)
        seen[view][i] = Observes(world_, views_[view], landmarks_[i].truth, &col, &row);
    });
    const int min_views = views_.size() > 2 ? 3 : 2;
    std::vector<std::vector<Eigen::Vector3d>> observed(views_.size());
    for (size_t i = 0; i < landmarks_.size(); ++i) {
      int count = 0;
      for (const std::vector<char>& by_view : seen) count += by_view[i];
      if (count < min_views) continue;
      const Vec3d& p = landmarks_[i].mapped;
      for (size_t view = 0; view < views_.size(); ++view) {
        if (seen[view][i]) observed[view].emplace_back(p.x, p.y, p.z);
      }
    }
    return observed;
  }

 private:
  void AddCorners(size_t view_index) {
    const Rendering& view = views_[view_index];
    const int cell_px = std::max(2 * HalfWindow(view.camera), view.camera.width / kCellsAcross);
    const int cells_x = (view.camera.width + cell_px - 1) / cell_px;
    const int cells_y = (view.camera.height + cell_px - 1) / cell_px;
    std::vector<char> taken(static_cast<size_t>(cells_x) * cells_y);
    for (const Landmark& landmark : landmarks_) {
      int col, row;
      if (Observes(world_, view, landmark.truth, &col, &row))
        taken[static_cast<size_t>(row / cell_px) * cells_x + col / cell_px] = 1;
    }
    for (int cell = 0; cell < cells_x * cells_y; ++cell) {
      if (!taken[cell]) AddBestCorner(view, cell % cells_x * cell_px, cell / cells_x * cell_px, cell_px);
    }
  }

  void AddBestCorner(const Rendering& view, int first_col, int first_row, int cell_px) {
    const int window = HalfWindow(view.camera);
    const int border = window + 1;
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
    const Vec3d truth = ray.origin + Trace(world_, ray).where.t * ray.direction;
    RandomStream random(seed_, static_cast<uint32_t>(landmarks_.size()), 0x1a4d);
    const Vec3d error = {BellNoise(&random, kNoise_m), BellNoise(&random, kNoise_m),
                         BellNoise(&random, kNoise_m)};  // braces fix the order of draws
    landmarks_.push_back({truth, truth + error});
  }

  const SyntheticWorld& world_;
  const std::vector<Rendering>& views_;
  uint32_t seed_;
  std::vector<Landmark> landmarks_;
};

}  // namespace

std::vector<std::vector<Eigen::Vector3d>> MakeLandmarks(const SyntheticWorld& world,
                                                        const std::vector<Rendering>& views, uint32_t seed) {
  return LandmarkMaker(world, views, seed).ObservedByView();
}

}  // namespace acmp
