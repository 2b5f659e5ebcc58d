#pragma once

#include <vector>

#include "acmp_mapping/fusion/fusion_setup.h"
#include "acmp_mapping/fusion/kernel/fuse_pixel.h"

namespace acmp {

using HostMaps = FusionMaps<Vec3f>;

/// The kernels' contexts for all views of a scene, with stamps; points in the world.
class FusionContexts {
 public:
  FusionContexts(const std::vector<FusionView>& views, const std::vector<std::vector<int>>& neighbors,
                 const FusionOptions& options) {
    for (const FusionView& view : views) stamps_.emplace_back(view.depth.width, view.depth.height, kUnusedStamp);
    for (size_t i = 0; i < views.size(); ++i) {
      setups_.emplace_back(CameraOf(views[i]), MapsOf(views[i]), MakeFusionLimits(options),
                           views[i].cam_from_world.inverse());
      setups_[i].SetStamps(stamps_[i].View(), static_cast<Stamp>(i));
      for (int k : neighbors[i]) setups_[i].AddSource(CameraOf(views[k]), MapsOf(views[k]), stamps_[k].View());
      log_odds_.emplace_back(views[i].depth.width, views[i].depth.height);
      const FusionContext<HostMaps> context = setups_[i].Context(setups_[i].sources().data());
      ForEachPixel(static_cast<int>(i), [&](int col, int row) { log_odds_[i](col, row) = LogOdds(context, col, row); });
    }
  }

  int count() const { return static_cast<int>(setups_.size()); }
  FusionContext<HostMaps> operator[](int view) const {
    FusionContext<HostMaps> context = setups_[view].Context(setups_[view].sources().data());
    context.log_odds = log_odds_[view].View();
    return context;
  }
  int stamp(int view, int col, int row) const { return stamps_[view](col, row); }

  template <class Function>
  void ForEachPixel(int view, const Function& function) const {
    for (int row = 0; row < stamps_[view].height(); ++row) {
      for (int col = 0; col < stamps_[view].width(); ++col) function(col, row);
    }
  }

 private:
  std::vector<Image<Stamp>> stamps_;
  std::vector<FusionSetup<HostMaps>> setups_;
  std::vector<Image<float>> log_odds_;
};

/// Number of sources that agree with each pixel of the reference.
inline Image<unsigned char> CountMatches(const FusionView& reference, const std::vector<FusionView>& sources,
                                         const FusionOptions& options) {
  std::vector<FusionView> views = {reference};
  std::vector<std::vector<int>> neighbors = {{}};
  for (const FusionView& source : sources) {
    neighbors[0].push_back(static_cast<int>(views.size()));
    neighbors.emplace_back();
    views.push_back(source);
  }
  const FusionContexts contexts(views, neighbors, options);
  Image<unsigned char> counts(reference.depth.width, reference.depth.height);
  contexts.ForEachPixel(0, [&](int col, int row) {
    ReferencePixel pixel;
    if (!LoadReferencePixel(contexts[0], col, row, &pixel)) return;
    MatchSum<kMaxFusionSources> sum;
    SumMatches(contexts[0], pixel, &sum);
    counts(col, row) = static_cast<unsigned char>(sum.count);
  });
  return counts;
}

}  // namespace acmp
