#include "moved_pixels.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace acmp {
namespace {

constexpr double kConfirmed_px = 1, kContradicted_px = 2;
constexpr double kMinShare = 0.5;  ///< of the pixels around, itself one of them

/// A view's cameras as matrices, for many pixels.
struct InstantPair {
  InstantPair(const EngineView& of_reference, const InstantView& of_view)
      : reference(of_reference.frame->camera),
        view(of_view.view.frame->camera),
        depth(of_view.depth),
        to_view(of_view.view.cam_from_world() * of_reference.cam_from_world().inverse()),
        back(to_view.inverse()) {}

  /// Forward-backward error of a depth, px; none where the view does not see the point or knows no depth there.
  std::optional<double> Error(const Eigen::Vector2d& pixel, double z) const {
    const Eigen::Vector3d point = to_view * reference.Unproject(pixel, z);
    if (!(point.z() > 0)) return std::nullopt;
    const Eigen::Vector2d there = view.Project(point);
    const auto col = std::lround(there.x()), row = std::lround(there.y());
    if (!(col >= 0 && row >= 0 && col < depth.width() && row < depth.height())) return std::nullopt;
    const double seen = depth(static_cast<int>(col), static_cast<int>(row));
    if (!(seen > 0)) return std::nullopt;
    const Eigen::Vector3d returned = back * view.Unproject(there, seen);
    if (!(returned.z() > 0)) return std::nullopt;
    return (reference.Project(returned) - pixel).norm();
  }

  const PinholeCamera &reference, &view;
  const DepthMap& depth;
  RigidTransform to_view, back;
};

}  // namespace

Image<unsigned char> FindMovedPixels(const EngineView& reference, const std::vector<InstantView>& views,
                                     const DepthMap& matched, const DepthMap& instant) {
  const int width = matched.width(), height = matched.height();
  std::vector<InstantPair> pairs;
  for (const InstantView& view : views) pairs.emplace_back(reference, view);
  Image<unsigned char> differs(width, height, 0);
  tbb::parallel_for(0, height, [&](int row) {
    for (int col = 0; col < width; ++col) {
      const double all = matched(col, row), own = instant(col, row);
      if (!(all > 0 && own > 0)) continue;
      const Eigen::Vector2d pixel(col, row);
      differs(col, row) = std::any_of(pairs.begin(), pairs.end(), [&](const InstantPair& pair) {
        const std::optional<double> of_own = pair.Error(pixel, own), of_all = pair.Error(pixel, all);
        return of_own && of_all && *of_own<kConfirmed_px&& * of_all> kContradicted_px;
      });
    }
  });
  // Sums over rectangles from the first pixel on.
  Image<int> sums(width + 1, height + 1, 0);
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      sums(col + 1, row + 1) = differs(col, row) + sums(col, row + 1) + sums(col + 1, row) - sums(col, row);
    }
  }
  const int reach = std::max(2, width / 64);
  Image<unsigned char> moved(width, height, 0);
  tbb::parallel_for(0, height, [&](int row) {
    for (int col = 0; col < width; ++col) {
      if (!(instant(col, row) > 0)) continue;
      const int left = std::max(0, col - reach), right = std::min(width, col + reach + 1);
      const int top = std::max(0, row - reach), bottom = std::min(height, row + reach + 1);
      const int around = sums(right, bottom) - sums(left, bottom) - sums(right, top) + sums(left, top);
      moved(col, row) = around >= kMinShare * (right - left) * (bottom - top) ? 1 : 0;
    }
  });
  return moved;
}

}  // namespace acmp
