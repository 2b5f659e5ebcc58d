#pragma once

#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// From light to grey levels: a lens, a shutter and a linear sensor with the noise of the EMVA 1288 standard (variance
/// linear in the signal), clipped and rounded to 8 bits. The default is a camera that only has noise.
struct ImagingModel {
  double read_noise_grey = 1.5;  ///< standard deviation per colour channel in the dark, 0..50; in grey two thirds
  double grey_per_electron = 0;  ///< gain K: shot noise has the variance K * signal (grey^2). 0..1; 0: none
  double psf_sigma_px = 0;       ///< standard deviation of the point spread of lens and demosaicing, 0..5
  double shake_deg = 0;          ///< how far the camera turns about each axis while the shutter is open (bell-shaped
                                 ///< with this standard deviation, per image): motion blur. 0..2
  double exposure_spread = 0;    ///< s: exposures from (1 - s) / (1 + s) to (1 + s) / (1 - s), per image. 0..0.5
  bool vignetting = false;       ///< natural vignetting: cos^4 of the angle from the optical axis
};

struct SyntheticSceneOptions {
  int width = 240;     ///< px
  int height = 180;    ///< px
  int keyframes = 14;  ///< 2..1000
  uint32_t seed = 1;
  ImagingModel imaging;
};

/// What the renderer knows exactly about one image.
struct SyntheticView {
  Frame frame;          ///< colour as the camera gives it, landmarks as a SLAM frontend would have them
  DepthMap true_depth;  ///< z of the first surface at each pixel centre, at the middle of the exposure as the pose
  NormalMap true_normal;
  Image<unsigned char> low_texture;  ///< 1 on surfaces of one colour, 0 elsewhere
  double exposure = 1;               ///< factor on the light
};

/// A room with analytic geometry: blank walls and floor (a faint gradient and sensor noise only), a textured table,
/// boxes, a sphere and pictures on a wall, seen from a hand-held path with about 5 degrees between keyframes. Unit:
/// metres; world z up. The same options give the same bytes on every machine (integer noise, no
/// function of libm that may differ).
std::vector<SyntheticView> MakeSyntheticScene(const SyntheticSceneOptions& options);

/// Points on the true surfaces seen by at least one of the views, about `spacing_m` apart, for cloud metrics.
PointCloud SampleSyntheticSurface(const std::vector<SyntheticView>& views, float spacing_m);

}  // namespace acmp
