#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fusion/analytic_views.h"

namespace acmp {

/// Plain double-precision rewrite of section "Fusion" of the paper and of what we do otherwise, point by point through
/// world coordinates.
namespace reference {

inline Eigen::Vector3d PointInWorld(const FusionView& view, int col, int row) {
  return view.cam_from_world.inverse() * view.camera.Unproject({col, row}, view.depth(col, row));
}

inline Eigen::Vector3d NormalInWorld(const FusionView& view, int col, int row) {
  const Vec3f& n = view.normal(col, row);
  return view.cam_from_world.linear().transpose() * Eigen::Vector3d(n.x, n.y, n.z);
}

inline double AngleRad(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::min(1.0, std::max(-1.0, a.normalized().dot(b.normalized()))));
}

/// What a source shows where a point of the world falls in its image.
struct Sight {
  bool in_image = false, has_depth = false;
  int col = 0, row = 0;   ///< the nearest pixel
  Eigen::Vector3d point;  ///< world
};

/// The papers take the nearest pixel's point, we that of its plane on the ray through the exact place, as long as it is
/// within 5 % of the depth.
inline Sight LookUp(const FusionView& source, const Eigen::Vector3d& point, bool exact_place) {
  Sight sight;
  const Eigen::Vector3d in_source = source.cam_from_world * point;
  if (in_source.z() <= 0) return sight;
  const Eigen::Vector2d place = source.camera.Project(in_source);
  sight.col = static_cast<int>(std::round(place.x()));
  sight.row = static_cast<int>(std::round(place.y()));
  sight.in_image = source.depth.Contains(sight.col, sight.row);
  sight.has_depth = sight.in_image && source.depth(sight.col, sight.row) > 0;
  if (!sight.has_depth) return sight;
  sight.point = PointInWorld(source, sight.col, sight.row);
  if (!exact_place) return sight;
  const Eigen::Vector3d center = source.cam_from_world.inverse().translation();
  const Eigen::Vector3d normal = NormalInWorld(source, sight.col, sight.row);
  const Eigen::Vector3d ray = source.cam_from_world.linear().transpose() * source.camera.Unproject(place);  // z = 1
  const double facing = normal.dot(sight.point - center), depth = source.depth(sight.col, sight.row);
  const double depth_there = facing / normal.dot(ray);
  if (!(facing < 0 && std::abs(depth_there / depth - 1) < 0.05)) return sight;
  sight.point = center + depth_there * ray;
  return sight;
}

struct Error {
  double px, relative;
};

inline Error ErrorOfSight(const FusionView& view, int col, int row, const Eigen::Vector3d& seen) {
  const Eigen::Vector3d back = view.cam_from_world * seen;
  return {(view.camera.Project(back) - Eigen::Vector2d(col, row)).norm(),
          std::abs(back.z() / view.depth(col, row) - 1)};
}

struct Match {
  int source;
  Sight sight;
  double weight;
};

inline std::vector<Match> FindMatches(const FusionView& view, const std::vector<const FusionView*>& sources, int col,
                                      int row, const FusionOptions& options) {
  const bool papers = options.min_consistent_views > 0;
  std::vector<Match> matches;
  if (!(view.depth(col, row) > 0)) return matches;
  for (size_t i = 0; i < sources.size(); ++i) {
    const FusionView& source = *sources[i];
    const Sight sight = LookUp(source, PointInWorld(view, col, row), !papers);
    if (!sight.has_depth || (view.cam_from_world * sight.point).z() <= 0) continue;
    const float cost = source.cost(sight.col, sight.row);
    if (papers ? cost >= kWorstCost : cost > kWorstCost) continue;
    const Error error = ErrorOfSight(view, col, row, sight.point);
    const double angle = AngleRad(NormalInWorld(view, col, row), NormalInWorld(source, sight.col, sight.row));
    if (error.px >= options.max_reprojection_px || error.relative >= options.max_relative_depth) continue;
    if (angle * 180 / M_PI >= options.max_normal_angle_deg) continue;
    const double weight = papers ? 1 : std::sqrt(std::exp(-(error.px + 200 * error.relative)));
    matches.push_back({static_cast<int>(i), sight, weight});
  }
  return matches;
}

/// Whether the pixel becomes a point.
inline bool Accepts(const FusionView& view, int col, int row, double confidence, const std::vector<Match>& matches,
                    const FusionOptions& options) {
  const bool papers = options.min_consistent_views > 0;
  const float cost = view.cost(col, row);
  return confidence >= options.min_confidence && !(papers ? cost >= kWorstCost : cost > kWorstCost) &&
         static_cast<int>(matches.size()) >= options.min_consistent_views;
}

/// Colours that differ by 20, summed over the channels, count half.
inline double ColorWeightOf(const Rgb& a, const Rgb& b) {
  const double distance = std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b);
  return 1 / (1 + std::pow(distance / 20, 2));
}

/// Mean deviation of 24 depths around the pixel from its plane, found by intersecting their rays with it; colours that
/// differ by 20 count half.
inline double Unevenness(const FusionView& view, int col, int row) {
  const Vec3f& n = view.normal(col, row);
  const Eigen::Vector3d normal(n.x, n.y, n.z);
  const double offset = normal.dot(view.camera.Unproject({col, row}, view.depth(col, row)));
  double sum = 0, weights = 0;
  for (const auto& [straight, diagonal] : {std::pair(4, 3), {8, 6}, {16, 12}}) {
    for (const auto& [dc, dr] : {std::pair(straight, 0),
                                 {-straight, 0},
                                 {0, straight},
                                 {0, -straight},
                                 {diagonal, diagonal},
                                 {-diagonal, diagonal},
                                 {diagonal, -diagonal},
                                 {-diagonal, -diagonal}}) {
      if (!view.depth.Contains(col + dc, row + dr) || !(view.depth(col + dc, row + dr) > 0)) continue;
      const double plane = offset / normal.dot(view.camera.Unproject({col + dc, row + dr}, 1));
      const double weight =
          view.color.empty() ? 1 : ColorWeightOf(view.color(col, row), view.color(col + dc, row + dr));
      sum += weight * std::min(0.1, std::abs(view.depth(col + dc, row + dr) / plane - 1));
      weights += weight;
    }
  }
  return offset < 0 && weights > 0 ? sum / weights : 0.1;
}

/// See LogOddsOf; an unsupported pixel has a quarter of the odds. Sources without a depth of their own where the point
/// falls are silent. The others' depths are those of their planes at the exact
/// place, whatever fusion takes.
inline double LogOdds(const FusionView& view, const std::vector<const FusionView*>& sources, int col, int row) {
  const Eigen::Vector3d point = PointInWorld(view, col, row);
  const Eigen::Vector3d center = view.cam_from_world.inverse().translation();
  double views = 0, silent = 0, best = 0;
  for (const FusionView* source : sources) {
    const Sight sight = LookUp(*source, point, true);
    views += sight.in_image;
    const bool has_own_depth = sight.has_depth && source->cost(sight.col, sight.row) < kWorstCost;
    silent += sight.in_image && !has_own_depth;
    if (!has_own_depth) continue;
    const Error error = ErrorOfSight(view, col, row, sight.point);
    const double angle = AngleRad(point - center, point - source->cam_from_world.inverse().translation());
    best = std::max(best, std::exp(-(error.px + 200 * error.relative)) *
                              std::min(1.0, std::sin(angle / 2) / std::sin(5 * M_PI / 180)));
  }
  return -7 - 1.74 * std::log(Unevenness(view, col, row) + 0.01) + 2.22 * best -
         (views > 0 ? 1.59 * silent / views : 0) - (view.cost(col, row) > kWorstCost ? 1.4 : 0);
}

/// From the mean of the log odds of the pixel and those of the 24 around that lie within 10 % of its depth, colours
/// that differ by 20 counting half.
inline double Confidence(const FusionView& view, const std::vector<const FusionView*>& sources, int col, int row) {
  double sum = 0, weights = 0;
  for (int step : {0, 4, 8, 16}) {
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        if ((dc == 0 && dr == 0) != (step == 0)) continue;
        const int length = dc == 0 || dr == 0 ? step : step * 3 / 4;
        const int c = col + dc * length, r = row + dr * length;
        if (!view.depth.Contains(c, r) || !(view.depth(c, r) > 0)) continue;
        if (std::abs(view.depth(c, r) / view.depth(col, row) - 1) >= 0.1) continue;
        const double weight = view.color.empty() ? 1 : ColorWeightOf(view.color(col, row), view.color(c, r));
        sum += weight * LogOdds(view, sources, c, r);
        weights += weight;
      }
    }
  }
  return 1 / (1 + std::exp(-sum / weights));
}

struct Point {
  Eigen::Vector3d position, normal, color;
  double confidence;
};

/// Colours count alike.
inline Point Average(const FusionView& view, const std::vector<const FusionView*>& sources, int col, int row,
                     const std::vector<Match>& matches, double confidence) {
  const auto color_of = [](const FusionView& v, int c, int r) {
    return Eigen::Vector3d(v.color(c, r).r, v.color(c, r).g, v.color(c, r).b);
  };
  Point sum{PointInWorld(view, col, row), NormalInWorld(view, col, row), color_of(view, col, row), confidence};
  double weights = 1;
  for (const auto& [source, sight, weight] : matches) {
    sum.position += weight * sight.point;
    sum.normal += weight * NormalInWorld(*sources[source], sight.col, sight.row);
    sum.color += color_of(*sources[source], sight.col, sight.row);
    weights += weight;
  }
  return {sum.position / weights, sum.normal.normalized(), sum.color / (1 + static_cast<double>(matches.size())),
          confidence};
}

/// Kernels compute in float: depths deviate by 2e-7, which is 2e-5 of an unevenness of 0.01 (the least that counts) and
/// 4e-5 in the exponent of a graded agreement; times their coefficients, and a quarter for the logistic function.
constexpr double kConfidenceTolerance = 3e-5;

/// In float: coordinates up to 5 are sums of a few numbers, each rounded to 2.4e-7, normals of such up to 1.
inline void ExpectNear(const SurfacePoint& point, const Point& expected) {
  ASSERT_NEAR(point.position.x, expected.position.x(), 3e-6);
  ASSERT_NEAR(point.position.y, expected.position.y(), 3e-6);
  ASSERT_NEAR(point.position.z, expected.position.z(), 3e-6);
  ASSERT_NEAR(point.normal.x, expected.normal.x(), 2e-6);
  ASSERT_NEAR(point.normal.y, expected.normal.y(), 2e-6);
  ASSERT_NEAR(point.normal.z, expected.normal.z(), 2e-6);
  ASSERT_NEAR(point.color.r, expected.color.x(), 0.5);
  ASSERT_NEAR(point.color.g, expected.color.y(), 0.5);
  ASSERT_NEAR(point.color.b, expected.color.z(), 0.5);
  ASSERT_NEAR(point.confidence, expected.confidence, kConfidenceTolerance);
}

/// A view's pixel.
struct Place {
  int view, col, row;
};

/// All views one after the other; each marks what its points used only once all its pixels have been decided.
inline std::vector<Point> Fuse(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                               const FusionOptions& options) {
  std::vector<Image<unsigned char>> used;
  used.reserve(views.size());
  for (const FusionView& view : views) used.emplace_back(view.depth.width, view.depth.height);
  std::vector<Point> points;
  for (size_t i = 0; i < views.size(); ++i) {
    std::vector<const FusionView*> sources;
    for (int neighbor : neighbors[i]) sources.push_back(&views[neighbor]);
    std::vector<Place> used_now;
    for (int row = 0; row < views[i].depth.height; ++row) {
      for (int col = 0; col < views[i].depth.width; ++col) {
        if (used[i](col, row)) continue;
        std::vector<Match> matches = FindMatches(views[i], sources, col, row, options);
        const auto is_used = [&](const Match& match) {
          return used[neighbors[i][match.source]](match.sight.col, match.sight.row) != 0;
        };
        matches.erase(std::remove_if(matches.begin(), matches.end(), is_used), matches.end());
        const double confidence = Confidence(views[i], sources, col, row);
        if (!Accepts(views[i], col, row, confidence, matches, options)) continue;
        used_now.push_back({static_cast<int>(i), col, row});
        for (const auto& [source, sight, weight] : matches) {
          used_now.push_back({neighbors[i][source], sight.col, sight.row});
        }
        points.push_back(Average(views[i], sources, col, row, matches, confidence));
      }
    }
    for (const Place& place : used_now) used[place.view](place.col, place.row) = 1;
  }
  return points;
}

}  // namespace reference
}  // namespace acmp
