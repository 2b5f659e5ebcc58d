#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "matching.h"

namespace acmp {
namespace {

constexpr int kSearchHalf = 3;  // px of the level
constexpr int kSearchSide = 2 * kSearchHalf + 1;
constexpr int kSearchPixels = kSearchSide * kSearchSide;

/// Pixel and its change with the anchor's pixel, for a plane parallel to the anchor's image.
struct Projection {
  bool in_front = false;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d warp = Eigen::Matrix2d::Identity();
};

/// The geometry between an anchor and a view, worked out once.
struct RelativeView {
  RelativeView(const PosedView& anchor, const PosedView& posed)
      : rotation((posed.pose.rotation * anchor.pose.rotation.conjugate()).toRotationMatrix()),
        baseline(posed.pose.rotation * (anchor.pose.centre - posed.pose.centre)),
        anchor_camera(anchor.view->camera),
        camera(posed.view->camera) {}

  Projection Project(const Eigen::Vector2d& anchor_pixel, double inverse_depth) const {
    Projection result;
    const Eigen::Vector3d y = rotation * anchor_camera.Unproject(anchor_pixel) + inverse_depth * baseline;
    if (!(y.z() > 0.05)) return result;
    result.in_front = true;
    result.pixel = camera.Project(y);
    Eigen::Matrix<double, 2, 3> j;
    j << camera.fx / y.z(), 0, -camera.fx * y.x() / (y.z() * y.z()), 0, camera.fy / y.z(),
        -camera.fy * y.y() / (y.z() * y.z());
    result.warp.col(0) = j * rotation.col(0) / anchor_camera.fx;
    result.warp.col(1) = j * rotation.col(1) / anchor_camera.fy;
    return result;
  }

  Eigen::Matrix3d rotation;
  Eigen::Vector3d baseline;
  const PinholeCamera& anchor_camera;
  const PinholeCamera& camera;
};

/// Pixels of a window, with what a correlation needs of them.
struct Window {
  float values[kSearchPixels];
  float sum = 0;
  float inverse_norm = 0;  ///< 1 / sqrt(sum of squares about the mean)
};

/// False where the window leaves the image or is blank.
bool SampleWindow(const Image<uint8_t>& image, const Eigen::Vector2d& centre, const Eigen::Matrix2d& warp,
                  Window* window) {
  const Eigen::Vector2d reach = warp.cwiseAbs() * Eigen::Vector2d::Constant(kSearchHalf);
  constexpr double kRounding = 0.01;  // px: of steps in float
  if (centre.x() - reach.x() < kRounding || centre.y() - reach.y() < kRounding ||
      centre.x() + reach.x() >= image.width() - 1 - kRounding ||
      centre.y() + reach.y() >= image.height() - 1 - kRounding) {
    return false;
  }
  const Eigen::Matrix2f w = warp.cast<float>();
  const Eigen::Vector2f c = centre.cast<float>();
  float sum = 0, squares = 0;
  for (int row = -kSearchHalf, i = 0; row <= kSearchHalf; ++row) {
    float u = c.x() + w(0, 1) * static_cast<float>(row) - w(0, 0) * kSearchHalf;
    float v = c.y() + w(1, 1) * static_cast<float>(row) - w(1, 0) * kSearchHalf;
    for (int col = -kSearchHalf; col <= kSearchHalf; ++col, ++i, u += w(0, 0), v += w(1, 0)) {
      const float value = Sample(image, u, v);
      window->values[i] = value;
      sum += value;
      squares += value * value;
    }
  }
  const float about_mean = squares - sum * sum / kSearchPixels;
  if (!(about_mean > kSearchPixels)) return false;  // a standard deviation of one grey value
  window->sum = sum;
  window->inverse_norm = 1 / std::sqrt(about_mean);
  return true;
}

float Correlation(const Window& a, const Window& b) {
  float product = 0;
  for (int i = 0; i < kSearchPixels; ++i) product += a.values[i] * b.values[i];
  return (product - a.sum * b.sum / kSearchPixels) * a.inverse_norm * b.inverse_norm;
}

/// The search works where the image is about 400 px wide.
int SearchLevel(const GrayPyramid& pyramid) {
  int level = 0;
  while (level + 1 < pyramid.levels() && pyramid.level(level).width() > 400) ++level;
  return level;
}

/// The same for the same anchor and pixel, one in five.
bool IsHeldOut(int64_t anchor_id, const Eigen::Vector2d& pixel) {
  uint64_t hash = static_cast<uint64_t>(anchor_id) * 0x9e3779b97f4a7c15u;
  hash ^= (static_cast<uint64_t>(std::lround(pixel.x())) << 32) + static_cast<uint64_t>(std::lround(pixel.y()));
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9u;  // splitmix64
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebu;
  return (hash ^ (hash >> 31)) % 5 == 0;
}

}  // namespace

double SearchInverseDepth(const PosedView& anchor, const Eigen::Vector2d& pixel, const DepthRange& range,
                          const std::vector<PosedView>& others) {
  const int level = SearchLevel(anchor.view->pyramid);
  const double scale = 1 << level;
  Window reference;
  if (!SampleWindow(anchor.view->pyramid.level(level), {ToLevel(pixel.x(), level), ToLevel(pixel.y(), level)},
                    Eigen::Matrix2d::Identity(), &reference)) {
    return 0;
  }
  const double nearest = 1.0 / range.min, farthest = 1.0 / range.max;
  std::vector<RelativeView> views;
  double steps = 1;
  for (const PosedView& other : others) {
    views.emplace_back(anchor, other);
    const Projection a = views.back().Project(pixel, nearest), b = views.back().Project(pixel, farthest);
    if (a.in_front && b.in_front) steps = std::max(steps, (a.pixel - b.pixel).norm() / scale);
  }
  constexpr double kMaxSteps = 256;
  const int count = static_cast<int>(std::ceil(std::min(steps, kMaxSteps))) + 1;
  std::vector<float> scores(static_cast<size_t>(count), -1);
  Window window;
  std::vector<float> nccs;
  for (int k = 0; k < count; ++k) {
    const double inverse_depth = farthest + (nearest - farthest) * k / (count - 1);
    nccs.clear();
    for (size_t v = 0; v < std::min<size_t>(views.size(), 8); ++v) {
      const Projection p = views[v].Project(pixel, inverse_depth);
      const GrayPyramid& pyramid = others[v].view->pyramid;
      if (!p.in_front || level >= pyramid.levels()) continue;
      if (!others[v].view->IsClear(p.pixel, scale * (kSearchHalf + 1))) continue;
      if (SampleWindow(pyramid.level(level), {ToLevel(p.pixel.x(), level), ToLevel(p.pixel.y(), level)}, p.warp,
                       &window)) {
        nccs.push_back(Correlation(reference, window));
      }
    }
    if (nccs.empty()) continue;
    // The better half: others may be occluded.
    std::sort(nccs.begin(), nccs.end(), std::greater<float>());
    nccs.resize((nccs.size() + 1) / 2);
    scores[static_cast<size_t>(k)] = std::accumulate(nccs.begin(), nccs.end(), 0.0f) / static_cast<float>(nccs.size());
  }
  const auto best = static_cast<int>(std::max_element(scores.begin(), scores.end()) - scores.begin());
  constexpr float kMinScore = 0.8f;
  if (scores[static_cast<size_t>(best)] < kMinScore) return 0;
  // A second place that looks as good: not unique. One hill may be wide.
  constexpr float kMargin = 0.04f;
  const auto score = [&](int k) { return k < 0 || k >= count ? -1.0f : scores[static_cast<size_t>(k)]; };
  for (int k = 0; k < count; ++k) {
    const bool is_peak = score(k) >= score(k - 1) && score(k) >= score(k + 1);
    if (is_peak && std::abs(k - best) > 4 && score(k) > score(best) - kMargin) return 0;
  }
  return farthest + (nearest - farthest) * best / (count - 1);
}

Alignment FindInView(const Landmark& landmark, const PosedView& anchor, const PosedView& view) {
  const Projection p = RelativeView(anchor, view).Project(landmark.pixel, landmark.inverse_depth);
  if (!p.in_front || !view.view->camera.Contains(p.pixel)) return {};
  Alignment alignment = Align(anchor.view->pyramid, landmark.pixel, p.warp, view.view->pyramid, p.pixel);
  alignment.found = alignment.found && view.view->IsClear(alignment.pixel, kPatchHalfWidth + 1);
  return alignment;
}

std::vector<Sighting> ImageBundle::FindSightings(const Landmark& landmark, const std::set<int>& seen_by) const {
  std::vector<Sighting> sightings;
  for (const int view : seen_by) {
    const Alignment alignment = FindInView(landmark, Posed(landmark.anchor), Posed(view));
    if (alignment.found) sightings.push_back({view, alignment.pixel});
  }
  return sightings;
}

std::optional<Landmark> ImageBundle::FindLandmark(int anchor, const Eigen::Vector2d& corner, const DepthRange& range,
                                                  const std::vector<int>& searched,
                                                  const std::set<int>& seen_by) const {
  std::vector<PosedView> others;
  for (const int view : searched) others.push_back(Posed(view));
  Landmark landmark;
  landmark.anchor = anchor;
  landmark.pixel = corner;
  landmark.inverse_depth = SearchInverseDepth(Posed(anchor), corner, range, others);
  if (!(landmark.inverse_depth > 0)) return std::nullopt;
  landmark.held_out = IsHeldOut(bundle.ids[static_cast<size_t>(anchor)], corner);
  landmark.sightings = FindSightings(landmark, seen_by);
  if (landmark.sightings.size() < kMinSightings) return std::nullopt;
  Triangulate(bundle.poses, bundle.cameras, &landmark);
  if (!(landmark.inverse_depth > 0)) return std::nullopt;
  return landmark;
}

}  // namespace acmp
