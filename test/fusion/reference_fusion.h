#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "acmp_mapping/fusion/depth_fusion.h"

namespace acmp {

/// Plain double-precision rewrite of section "Fusion" of the paper, point by point through world coordinates.
namespace reference {

struct Match {
  int source, col, row;
  Eigen::Vector3d point_in_world, normal_in_world;
  double agreement, angle_deg;
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
    const Eigen::Vector3d center = view.cam_from_world.inverse().translation();
    const Eigen::Vector3d source_center = source.cam_from_world.inverse().translation();
    matches.push_back({static_cast<int>(i), source_col, source_row, source_point, source_normal,
                       std::exp(-(px + 200 * relative + 10 * angle)),
                       AngleRad(point - center, point - source_center) * 180 / M_PI});
  }
  return matches;
}

inline bool Accepts(const std::vector<Match>& matches, const FusionOptions& options) {
  if (!options.dynamic_consistency) return static_cast<int>(matches.size()) >= options.min_consistent_views;
  double sum = 0;
  for (const Match& match : matches) sum += match.agreement;
  return !matches.empty() && sum / static_cast<double>(matches.size()) > 0.3;
}

inline double MedianAngleDeg(const std::vector<Match>& matches) {
  std::vector<double> angles;
  angles.reserve(matches.size());
  for (const Match& match : matches) angles.push_back(match.angle_deg);
  std::sort(angles.begin(), angles.end());
  if (angles.empty()) return 0;
  const size_t half = angles.size() / 2;
  return angles.size() % 2 == 1 ? angles[half] : (angles[half - 1] + angles[half]) / 2;
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
  const double photometric = std::exp(-std::pow(view.cost(col, row), 2) / 0.18);
  const double support =
      1 - std::pow(0.5, static_cast<double>(matches.size()) * std::min(1.0, MedianAngleDeg(matches) / 10));
  return {sum.position / count, sum.normal.normalized(), sum.color / count,
          0.2 * photometric + 0.5 * support + 0.3 * photometric * support};
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
        used_now.push_back({static_cast<int>(i), col, row});
        for (const Match& match : matches) used_now.push_back({neighbors[i][match.source], match.col, match.row});
        points.push_back(Average(views[i], sources, col, row, matches));
      }
    }
    for (const Place& place : used_now) used[place.view](place.col, place.row) = 1;
    if (used_by_view != nullptr) used_by_view->push_back(used_now);
  }
  return points;
}

}  // namespace reference
}  // namespace acmp
