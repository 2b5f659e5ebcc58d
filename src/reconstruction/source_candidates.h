#pragma once

#include <array>
#include <map>
#include <vector>

#include "acmp_mapping/dataset/scene.h"

namespace acmp {

/// Chooses source views among the images of a scene without looking at all pairs: SelectSourceViews gives the same for
/// the images around, once none of those farther away could be worth as much as the least of what it chose.
class SourceCandidates {
 public:
  /// @param scene outlives this; its poses do not change
  /// @param indices of the images that take part, ascending
  SourceCandidates(const Scene& scene, std::vector<int> indices);

  /// Scene indices, most useful first. Any number of threads may ask.
  /// @param typical_depth see SelectSourceViews
  std::vector<int> Select(int index, double typical_depth, int max_sources) const;

 private:
  using Cell = std::array<int64_t, 3>;

  Cell CellOf(const Eigen::Vector3d& point) const;
  /// Images but for `index` that are within a distance of it, and perhaps some more; ascending.
  std::vector<int> Around(int index, double distance) const;
  /// No view farther away can gain as much (SelectedSourceView::gain, 0..1).
  double DistanceOfGain(int index, double typical_depth, double gain) const;

  const Scene& scene_;
  const std::vector<int> indices_;
  double extent_ = 0;  ///< no two images are farther apart
  double cell_size_ = 1;
  double most_focal_length_ = 0;  ///< px, of all images
  double least_cosine_ = 1;       ///< between a ray of any image and its optical axis
  std::map<Cell, std::vector<int>> cells_;
};

}  // namespace acmp
