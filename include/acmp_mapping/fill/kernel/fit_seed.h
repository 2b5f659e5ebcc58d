#pragma once

#include "acmp_mapping/fill/kernel/fill_grid.h"

namespace acmp {

constexpr int kFitRadius = 10;     ///< cells: the fit sees a square of 21 x 21 cells, 19 % of the image's width ...
constexpr int kFitStep = 2;        ///< ... of which every second one in every second row gives a seed
constexpr int kFitIterations = 3;  ///< of reweighted least squares
constexpr float kFitTolerance = 0.01f;       ///< relative inverse depth that counts as the same plane's
constexpr float kFirstFitTolerance = 0.02f;  ///< at first, when the plane is that of one pixel
constexpr float kCutOff = 3.0f;              ///< Tukey's biweight vanishes at so many tolerances
constexpr float kMinFitViews = 4.0f;         ///< summed over the seeds; with less the pixel's own plane is as good

/// Normal equations of inverse depth, relative to that of the seed, as a linear function of the place: 1, x, y.
struct PlaneFit {
  float s1 = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;  ///< weighted sums
  float q = 0, qx = 0, qy = 0;

  ACMP_HOST_DEVICE void Add(float weight, float x, float y, float value) {
    s1 += weight;
    sx += weight * x;
    sy += weight * y;
    sxx += weight * x * x;
    sxy += weight * x * y;
    syy += weight * y * y;
    q += weight * value;
    qx += weight * x * value;
    qy += weight * y * value;
  }

  /// Offset and slopes. A slope that the points leave open is small: places are of size 1, and a ten-thousandth of the
  /// points' weight pulls it to zero.
  ACMP_HOST_DEVICE Vec3f Solve() const {
    const float ridge = 1e-4f * s1;
    const float inv = 1.0f / s1;
    const float xx = sxx + ridge - sx * sx * inv, xy = sxy - sx * sy * inv, yy = syy + ridge - sy * sy * inv;
    const float x = qx - sx * q * inv, y = qy - sy * q * inv;
    const float inv_det = 1.0f / (xx * yy - xy * xy);  // positive: both are at least the ridge
    const float slope_x = (yy * x - xy * y) * inv_det, slope_y = (xx * y - xy * x) * inv_det;
    return {inv * (q - slope_x * sx - slope_y * sy), slope_x, slope_y};
  }
};

/// How many of `threads`, a power of two, share a row of `count` seeds: the fewest that take it at once.
ACMP_HOST_DEVICE constexpr int ThreadsOfRow(int threads, int count) {
  return threads / 2 < count ? threads : ThreadsOfRow(threads / 2, count);
}

/// Tukey's biweight.
ACMP_HOST_DEVICE inline float RobustWeight(float residual, float tolerance) {
  const float ratio = residual / (kCutOff * tolerance);
  const float rest = 1.0f - ratio * ratio;
  return rest > 0 ? rest * rest : 0;
}

/// Fills one cell of `fitted`: the seed with the plane of the seeds around that agree with it, by reweighted least
/// squares from the plane of the seed's own pixel. The threads of a group share its rows and columns.
template <class Group>
ACMP_HOST_DEVICE inline void FitSeed(const FillContext& context, int cell_col, int cell_row, const Group& group) {
  constexpr int kMaxSeeds = 2 * kFitRadius / kFitStep + 1;  // of a row
  constexpr int kThreadsOfRow = ThreadsOfRow(Group::kSize, kMaxSeeds);
  constexpr int kRowsAtOnce = Group::kSize / kThreadsOfRow;
  SeedCell seed = context.seeds(cell_col, cell_row);
  if (seed.views == 0) {
    if (group.Rank() == 0) context.fitted(cell_col, cell_row) = seed;
    return;
  }
  const float reach = static_cast<float>(kFitRadius * context.cell_size);  // px that are 1 in the fit
  const float inv_reach = 1.0f / reach;
  const float inv_depth = seed.inverse_depth, depth = 1.0f / inv_depth;
  Vec3f m = seed.inverse_plane;
  // Relative to the seed's inverse depth: its own value, slopes per reach.
  Vec3f fit = {1.0f, m.x * context.rays.inv_fx * reach / inv_depth, m.y * context.rays.inv_fy * reach / inv_depth};
  static_assert(kFitRadius % kFitStep == 0, "the seed itself is one of those");
  const int first_col = cell_col > kFitRadius ? cell_col - kFitRadius : cell_col % kFitStep;
  const int first_row = cell_row > kFitRadius ? cell_row - kFitRadius : cell_row % kFitStep;
  const int last_col = cell_col + kFitRadius < context.seeds.width ? cell_col + kFitRadius : context.seeds.width - 1;
  const int last_row = cell_row + kFitRadius < context.seeds.height ? cell_row + kFitRadius : context.seeds.height - 1;
  for (int iteration = 0; iteration < kFitIterations; ++iteration) {
    const float tolerance = iteration == 0 ? kFirstFitTolerance : kFitTolerance;
    PlaneFit sums;
    for (int row = first_row + kFitStep * (group.Rank() / kThreadsOfRow); row <= last_row;
         row += kFitStep * kRowsAtOnce) {
      for (int col = first_col + kFitStep * (group.Rank() % kThreadsOfRow); col <= last_col;
           col += kFitStep * kThreadsOfRow) {
        const SeedCell& other = context.seeds(col, row);
        if (other.views == 0) continue;
        const float x = static_cast<float>(other.col - seed.col) * inv_reach;
        const float y = static_cast<float>(other.row - seed.row) * inv_reach;
        const float value = other.inverse_depth * depth;
        const float weight = RobustWeight(value - (fit.x + fit.y * x + fit.z * y), tolerance);
        if (weight > 0) sums.Add(weight * static_cast<float>(other.views), x, y, value);
      }
    }
    group.AddUp(&sums);
    if (!(sums.s1 > kMinFitViews)) break;
    fit = sums.Solve();
  }
  const Vec3f ray = context.rays.Ray(static_cast<float>(seed.col), static_cast<float>(seed.row));
  m.x = inv_depth * fit.y / (reach * context.rays.inv_fx);
  m.y = inv_depth * fit.z / (reach * context.rays.inv_fy);
  m.z = inv_depth * fit.x - m.x * ray.x - m.y * ray.y;
  seed.inverse_plane = m;
  if (group.Rank() == 0) context.fitted(cell_col, cell_row) = seed;
}

}  // namespace acmp
