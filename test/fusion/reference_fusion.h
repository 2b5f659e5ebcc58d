#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// Plain double-precision rewrite of section "Fusion" of the paper, point by point through world coordinates.
namespace reference {

struct Match {
  int source, col, row;
  Eigen::Vector3d point_in_world, normal_in_world;
};

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

inline std::vector<Match> FindMatches(const FusionView& view, const std::vector<const FusionView*>& sources, int col,
                                      int row, const FusionOptions& options) {
  std::vector<Match> matches;
  if (!(view.depth(col, row) > 0)) return matches;
  const Eigen::Vector3d point = PointInWorld(view, col, row);
  for (size_t i = 0; i < sources.size(); ++i) {
    const FusionView& source = *sources[i];
    const Eigen::Vector3d in_source = source.cam_from_world * point;
    if (in_source.z() <= 0) continue;
    const Eigen::Vector2d pixel = source.camera.Project(in_source);
    const int source_col = static_cast<int>(std::round(pixel.x())),
              source_row = static_cast<int>(std::round(pixel.y()));
    if (!source.depth.Contains(source_col, source_row) || !(source.depth(source_col, source_row) > 0)) continue;
    const Eigen::Vector3d source_point = PointInWorld(source, source_col, source_row);
    const Eigen::Vector3d back = view.cam_from_world * source_point;
    if (back.z() <= 0) continue;
    const double px = (view.camera.Project(back) - Eigen::Vector2d(col, row)).norm();
    const double relative = std::abs(back.z() - view.depth(col, row)) / view.depth(col, row);
    const Eigen::Vector3d source_normal = NormalInWorld(source, source_col, source_row);
    const double angle = AngleRad(NormalInWorld(view, col, row), source_normal);
    if (px >= options.max_reprojection_px || relative >= options.max_relative_depth) continue;
    if (angle * 180 / M_PI >= options.max_normal_angle_deg) continue;
    matches.push_back({static_cast<int>(i), source_col, source_row, source_point, source_normal});
  }
  return matches;
}

/// Whether enough agrees; the confidence is another matter.
inline bool Accepts(const std::vector<Match>& matches, const FusionOptions& options) {
  return static_cast<int>(matches.size()) >= options.min_consistent_views;
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

/// See ExpectedRelativeError; sources without a depth of their own where the point falls count as views.
inline double ExpectedError(const FusionView& view, const std::vector<const FusionView*>& sources, int col, int row) {
  const Eigen::Vector3d point = PointInWorld(view, col, row);
  const Eigen::Vector3d center = view.cam_from_world.inverse().translation();
  double views = 0, agreement = 0, contradicting = 0;
  for (const FusionView* source : sources) {
    const Eigen::Vector3d in_source = source->cam_from_world * point;
    if (in_source.z() <= 0) continue;
    const Eigen::Vector2d pixel = source->camera.Project(in_source);
    const int source_col = static_cast<int>(std::round(pixel.x())),
              source_row = static_cast<int>(std::round(pixel.y()));
    if (!source->depth.Contains(source_col, source_row)) continue;
    ++views;
    if (!(source->depth(source_col, source_row) > 0) || source->cost(source_col, source_row) >= 2) continue;
    contradicting += source->depth(source_col, source_row) > 1.03 * in_source.z();
    const Eigen::Vector3d back = view.cam_from_world * PointInWorld(*source, source_col, source_row);
    const double px = (view.camera.Project(back) - Eigen::Vector2d(col, row)).norm();
    const double relative = std::abs(back.z() / view.depth(col, row) - 1);
    const double angle = AngleRad(point - center, point - source->cam_from_world.inverse().translation());
    agreement += std::exp(-(px + 200 * relative)) * std::min(1.0, std::sin(angle / 2) / std::sin(5 * M_PI / 180));
  }
  const double share = views > 0 ? 1 / views : 0;
  const double likelihood = std::exp(-std::pow(view.cost(col, row), 2) / 0.18);
  return 0.5 * std::pow(Unevenness(view, col, row) + 0.01, 0.9) *
         std::exp(2 * contradicting * share - 0.9 * agreement * share - 0.3 * likelihood);
}

/// Of the geometric mean of the pixel's expected error and those of the 24 around that lie within 10 % of its depth,
/// colours that differ by 20 counting half.
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
        sum += weight * std::log(ExpectedError(view, sources, c, r));
        weights += weight;
      }
    }
  }
  return 1 / (1 + std::exp(sum / weights) / 0.01);
}

struct Point {
  Eigen::Vector3d position, normal, color;
  double confidence;
};

inline Point Average(const FusionView& view, const std::vector<const FusionView*>& sources, int col, int row,
                     const std::vector<Match>& matches) {
  const auto color_of = [](const FusionView& v, int c, int r) {
    return Eigen::Vector3d(v.color(c, r).r, v.color(c, r).g, v.color(c, r).b);
  };
  Point sum{PointInWorld(view, col, row), NormalInWorld(view, col, row), color_of(view, col, row), 0};
  for (const Match& match : matches) {
    sum.position += match.point_in_world;
    sum.normal += match.normal_in_world;
    sum.color += color_of(*sources[match.source], match.col, match.row);
  }
  const double count = 1 + static_cast<double>(matches.size());
  return {sum.position / count, sum.normal.normalized(), sum.color / count, Confidence(view, sources, col, row)};
}

/// A view's pixel.
struct Place {
  int view, col, row;
};

/// All views one after the other; each marks what its points used only once all its pixels have been decided. If
/// wanted, used_by_view gets the marks that each view set.
inline std::vector<Point> Fuse(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                               const FusionOptions& options, std::vector<std::vector<Place>>* used_by_view = nullptr) {
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
          return used[neighbors[i][match.source]](match.col, match.row) != 0;
        };
        matches.erase(std::remove_if(matches.begin(), matches.end(), is_used), matches.end());
        if (!Accepts(matches, options)) continue;
        const Point point = Average(views[i], sources, col, row, matches);
        used_now.push_back({static_cast<int>(i), col, row});
        for (const Match& match : matches) used_now.push_back({neighbors[i][match.source], match.col, match.row});
        points.push_back(point);
      }
    }
    for (const Place& place : used_now) used[place.view](place.col, place.row) = 1;
    if (used_by_view != nullptr) used_by_view->push_back(used_now);
  }
  return points;
}

}  // namespace reference
}  // namespace acmp
