#pragma once

#include <algorithm>
#include <random>
#include <vector>

#include "support/planar_scene.h"

namespace acmp {

/// Uniform numbers that are the same with every standard library.
class TestRandom {
 public:
  explicit TestRandom(uint32_t seed) : engine_(seed) {}
  double operator()(double low, double high) { return low + (high - low) * (engine_() / 4294967296.0); }
  int Below(int count) { return static_cast<int>((*this)(0, 1) * count); }

 private:
  std::mt19937 engine_;
};

/// Image of independent random grey values smoothed by a 3 x 3 box (steep gradients, but not white noise).
inline GrayImage RandomImage(int width, int height, uint32_t seed, double low = 0, double high = 255) {
  TestRandom random(seed);
  GrayImage noise(width, height), image(width, height);
  for (float& value : noise) value = static_cast<float>(random(low, high));
  for (int row = 0; row < height; ++row) {
    for (int col = 0; col < width; ++col) {
      double sum = 0;
      int count = 0;
      for (int y = row - 1; y <= row + 1; ++y) {
        for (int x = col - 1; x <= col + 1; ++x) {
          if (!noise.View().Contains(x, y)) continue;
          sum += noise(x, y);
          ++count;
        }
      }
      image(col, row) = static_cast<float>(sum / count);
    }
  }
  return image;
}

/// Views of unequal, odd sizes with unrelated random images around the origin: good for costs of every size.
inline std::vector<PlanarView> RandomViews(int count, int width, int height, uint32_t seed) {
  TestRandom random(seed);
  std::vector<PlanarView> views;
  for (int i = 0; i < count; ++i) {
    PlanarView view;
    const int w = i == 0 ? width : std::max(15, width + random.Below(21) - 10);
    const int h = i == 0 ? height : std::max(15, height + random.Below(17) - 8);
    view.camera = TestCamera(w, h);
    view.camera.fy *= 1.03;
    if (i > 0) {
      view.cam_from_world = LookAhead({random(-0.5, 0.5), random(-0.5, 0.5), random(-0.3, 0.3)}, random(-6, 6),
                                      random(-6, 6), random(-20, 20));
    }
    view.gray = RandomImage(w, h, seed * 100 + i);
    view.depth = DepthMap(w, h);
    for (float& depth : view.depth) depth = random(0, 1) < 0.1 ? 0.0f : static_cast<float>(random(2.5, 6.0));
    views.push_back(std::move(view));
  }
  return views;
}

}  // namespace acmp
