#pragma once

#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

struct SyntheticSceneOptions {
  int width = 240;     ///< px
  int height = 180;    ///< px
  int keyframes = 14;  ///< 2..1000
  uint32_t seed = 1;
  /// Standard deviation of the sensor noise per colour channel, 0..50; in grey it is two thirds of this.
  double noise_grey = 1.5;
};

/// What the renderer knows exactly about one image.
struct SyntheticView {
  Frame frame;          ///< colour with sensor noise, landmarks as a SLAM frontend would have them
  DepthMap true_depth;  ///< z of the first surface at each pixel centre
  NormalMap true_normal;
  Image<unsigned char> low_texture;  ///< 1 on blank walls and floor, 0 elsewhere
};

/// A room with analytic geometry: blank walls and floor (a faint gradient and sensor noise only), a textured table,
/// boxes, a sphere and pictures on a wall, seen from a hand-held path with about 5 degrees between keyframes. Unit:
/// metres; world z up. The same options give the same bytes on every machine (integer noise, no libm-dependent texture
/// lookups).
std::vector<SyntheticView> MakeSyntheticScene(const SyntheticSceneOptions& options);

/// Points on the true surfaces seen by at least one of the views, about `spacing_m` apart, for cloud metrics.
PointCloud SampleSyntheticSurface(const std::vector<SyntheticView>& views, float spacing_m);

}  // namespace acmp
