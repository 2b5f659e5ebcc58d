#pragma once

#include <cstdint>

#include "acmp_mapping/common/random.h"
#include "geometry.h"

namespace acmp {

/// Linear colour, 0..255 per channel.
struct ColorD {
  double r, g, b;
};

enum class Pattern {
  kBlank,   ///< one colour
  kNoise,   ///< two colours mixed by noise of six octaves, cells of 24 cm down to 7.5 mm
  kWood,    ///< the same, drawn out along the solid's x axis
  kMosaic,  ///< square tiles of `cell_m` with colours of their own
  kTiles,   ///< equal tiles of `cell_m` with a joint of a tenth between them
  kBooks,   ///< rows of upright spines, `cell_m` wide on average, each with a colour of its own
};

struct Material {
  Pattern pattern = Pattern::kBlank;
  ColorD color = {128, 128, 128};
  ColorD other = {128, 128, 128};  ///< not read by kBlank
  double cell_m = 0.05;            ///< kMosaic, kTiles and kBooks
  double gloss = 0;                ///< 0..1: brightness of the lamp's highlight; not part of TextureColor()
};

inline Material Plain(const ColorD& color) { return {Pattern::kBlank, color, {}, 0}; }

/// Colour without light at a point of a solid, given in the solid's own frame. `key` tells equal materials apart.
ColorD TextureColor(const Material& material, uint32_t key, const Vec3d& local, const Vec3d& local_normal);

/// Bell-shaped random number with mean 0: four uniform draws, scaled. Never beyond 3.5 sigma; no libm.
double BellNoise(RandomStream* random, double sigma);

/// Smooth value noise in 0..1 of one cell per unit.
double ValueNoise(uint32_t key, const Vec3d& position);

}  // namespace acmp
