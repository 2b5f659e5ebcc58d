#include "acmp_mapping/fusion/depth_fusion.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/fusion/consistency_check.h"
#include "acmp_mapping/fusion/voxel_map.h"

namespace acmp {
namespace {

/// Rows whose matches are held in memory at a time while a view is fused.
constexpr int kRowsPerBlock = 32;

/// Matches of one image row, by pixel: those of cols[i] are matches[first[i]] to matches[first[i + 1] - 1].
struct RowMatches {
  std::vector<int> cols;
  std::vector<size_t> first;
  std::vector<PixelMatch> matches;
};

using UsedMap = Image<unsigned char>;  ///< 1: the pixel went into a point

RowMatches MatchRow(const ConsistencyChecker& checker, const UsedMap& used, int row) {
  RowMatches result;
  for (int col = 0; col < used.width(); ++col) {
    if (used(col, row)) continue;
    const size_t first = result.matches.size();
    checker.FindMatches(col, row, &result.matches);
    if (result.matches.size() == first) continue;
    result.cols.push_back(col);
    result.first.push_back(first);
  }
  result.first.push_back(result.matches.size());
  return result;
}

/// Turns the row's pixels into points from left to right, leaving out whatever an earlier point has used. (The row's
/// own pixels are unused since MatchRow: a view is no neighbour of itself.)
void FuseRow(const ConsistencyChecker& checker, const RowMatches& row_matches, int row, int reference,
             const std::vector<int>& neighbors, std::vector<UsedMap>* used, PointCloud* points_in_camera) {
  std::vector<PixelMatch> unused;
  for (size_t i = 0; i < row_matches.cols.size(); ++i) {
    const int col = row_matches.cols[i];
    unused.clear();
    for (size_t k = row_matches.first[i]; k < row_matches.first[i + 1]; ++k) {
      const PixelMatch& match = row_matches.matches[k];
      if (!(*used)[neighbors[match.source]](match.col, match.row)) unused.push_back(match);
    }
    if (!checker.Accepts(unused)) continue;
    (*used)[reference](col, row) = 1;
    for (const PixelMatch& match : unused) (*used)[neighbors[match.source]](match.col, match.row) = 1;
    points_in_camera->push_back(checker.Average(col, row, unused));
  }
}

/// The geometry is matched in parallel; who uses a pixel is decided serially, in row-major order.
PointCloud FuseView(const ConsistencyChecker& checker, int reference, const std::vector<int>& neighbors,
                    std::vector<UsedMap>* used) {
  const UsedMap& own = (*used)[reference];
  PointCloud points_in_camera;
  for (int block = 0; block < own.height(); block += kRowsPerBlock) {
    const int rows = std::min(kRowsPerBlock, own.height() - block);
    std::vector<RowMatches> matches(rows);
    tbb::parallel_for(0, rows, [&](int i) { matches[i] = MatchRow(checker, own, block + i); });
    for (int i = 0; i < rows; ++i) {
      FuseRow(checker, matches[i], block + i, reference, neighbors, used, &points_in_camera);
    }
  }
  return points_in_camera;
}

void CheckNeighbors(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors) {
  if (neighbors.size() != views.size()) {
    throw InvalidInputError(Concat("neighbour lists for ", neighbors.size(), " views but ", views.size(),
                                   " views: must be one list per view"));
  }
  const int count = static_cast<int>(views.size());
  for (int i = 0; i < count; ++i) {
    std::vector<int> sorted = neighbors[i];
    std::sort(sorted.begin(), sorted.end());
    const auto repeated = std::adjacent_find(sorted.begin(), sorted.end());
    if (repeated != sorted.end()) {
      throw InvalidInputError(Concat("neighbour ", *repeated, " of view ", i, " is given more than once"));
    }
    for (int neighbor : sorted) {
      if (neighbor < 0 || neighbor >= count || neighbor == i) {
        throw InvalidInputError(
            Concat("neighbour ", neighbor, " of view ", i, ": must be another view in [0, ", count - 1, "]"));
      }
    }
  }
}

}  // namespace

// C = 0.2 P + 0.5 S + 0.3 P S with
//   P = exp(-cost^2 / 0.18), the paper's photometric likelihood (eq. 5), and
//   S = 1 - 2^(-n min(angle / 10 deg, 1)): each of the n consistent views halves the remaining doubt, less so if rays
//   to
//       the point are nearly parallel, when agreement says little about depth.
// All coefficients are positive, so C never falls when the cost falls or n or the angle grows. Without a consistent
// view C <= 0.2; two views at 10 degrees give 0.375 to 0.8. A NaN cost counts as no photometric evidence.
float ComputeConfidence(float cost, int consistent_views, float angle_deg) {
  const double used_cost = std::max(0.0, static_cast<double>(cost));
  const double photometric = std::isnan(cost) ? 0.0 : std::exp(-used_cost * used_cost / 0.18);
  const double evidence = std::max(0, consistent_views) * Clamp(angle_deg / 10, 0.0f, 1.0f);
  const double support = 1 - std::exp2(-evidence);
  return static_cast<float>(0.2 * photometric + 0.5 * support + 0.3 * photometric * support);
}

ConsistencyResult FilterByConsistency(const FusionView& reference, const std::vector<FusionView>& sources,
                                      const FusionOptions& options) {
  Validate(options);
  ConsistencyResult result;
  if (reference.depth.empty()) return result;
  std::vector<const FusionView*> source_pointers;
  source_pointers.reserve(sources.size());
  for (const FusionView& source : sources) source_pointers.push_back(&source);
  const ConsistencyChecker checker(reference, source_pointers, options);

  const int width = reference.depth.width, height = reference.depth.height;
  result.consistent_views = Image<unsigned char>(width, height);
  result.confidence = ConfidenceMap(width, height);
  std::vector<PointCloud> points_of_row(height);
  tbb::parallel_for(0, height, [&](int row) {
    std::vector<PixelMatch> matches;
    for (int col = 0; col < width; ++col) {
      if (!checker.HasDepth(col, row)) continue;
      matches.clear();
      checker.FindMatches(col, row, &matches);
      result.consistent_views(col, row) = static_cast<unsigned char>(matches.size());
      result.confidence(col, row) = checker.Confidence(col, row, matches);
      if (checker.Accepts(matches)) points_of_row[row].push_back(checker.Average(col, row, matches));
    }
  });
  for (const PointCloud& points : points_of_row) {
    result.points_in_camera.insert(result.points_in_camera.end(), points.begin(), points.end());
  }
  return result;
}

PointCloud FuseDepthMaps(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                         const FusionOptions& options) {
  Validate(options);
  CheckNeighbors(views, neighbors);
  std::vector<UsedMap> used;
  used.reserve(views.size());
  for (const FusionView& view : views) used.emplace_back(view.depth.width, view.depth.height);

  PointCloud points_in_world;
  for (size_t i = 0; i < views.size(); ++i) {
    if (views[i].depth.empty()) continue;
    std::vector<const FusionView*> sources;
    for (int neighbor : neighbors[i]) sources.push_back(&views[neighbor]);
    const ConsistencyChecker checker(views[i], sources, options);
    const PointCloud points =
        Transform(views[i].cam_from_world.inverse(), FuseView(checker, static_cast<int>(i), neighbors[i], &used));
    points_in_world.insert(points_in_world.end(), points.begin(), points.end());
  }
  return points_in_world;
}

}  // namespace acmp
