#pragma once

#include <random>

#include "fusion/analytic_views.h"

namespace acmp {

/// Four noisy views of a wall with a box front before it, of unequal sizes.
inline std::vector<TestView> NoisyViews() {
  const std::vector<Quad> quads = {{{0, 0, 5}, {9, 0, 3}, {0, 9, 1}, {200, 100, 50}},
                                   {{0.3, 0, 3}, {0.4, 0, 0.1}, {0, 0.5, 0}, {10, 20, 30}}};
  const PinholeCamera camera = {64, 48, 75, 76, 31.2, 24.4};
  std::vector<TestView> views;
  views.push_back(Render(camera, LookAt({0, 0, 0}, {0, 0, 5}), quads));
  views.push_back(Render(camera.Resized(90, 71), LookAt({0.8, 0.1, 0}, {0.1, 0, 5}), quads));
  views.push_back(Render(camera, LookAt({-0.7, -0.2, 0.3}, {0, 0.1, 5}), quads));
  views.push_back(Render(camera.Resized(50, 37), LookAt({0.1, 0.6, -0.4}, {0, 0, 5}), quads));
  std::mt19937 generator(2);
  std::normal_distribution<float> relative_noise(0, 0.004f), normal_noise(0, 0.05f);
  std::uniform_int_distribution<int> any_color(0, 255);
  for (TestView& view : views) {
    for (float& z : view.depth) z *= 1 + relative_noise(generator);
    for (Vec3f& n : view.normal) {
      n = Normalized(n + Vec3f{normal_noise(generator), normal_noise(generator), normal_noise(generator)});
    }
    for (Rgb& rgb : view.color) rgb.b = static_cast<unsigned char>(any_color(generator));
  }
  return views;
}

/// Odd depths, costs and normals here and there.
inline void SpoilSomePixels(std::vector<TestView>* views) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const float odd[] = {kNan, kInfinity, -kInfinity, -1.0f, 0.0f, 1e-38f, 1e38f};
  for (TestView& view : *views) {
    const int pixels = static_cast<int>(view.depth.size());
    for (int k = 0; k < 7 * 15; ++k) {
      view.depth.data()[17 * k % pixels] = odd[k % 7];
      view.cost.data()[(17 * k + 3) % pixels] = odd[k % 7];
      view.normal.data()[(17 * k + 6) % pixels] = {odd[k % 7], odd[(k + 1) % 7], 0};
      view.normal.data()[(17 * k + 7) % pixels] = {0, 0, 0};
    }
  }
}

/// All other views, in no particular order, and for one view not all of them.
inline std::vector<std::vector<int>> NoisyNeighbors() { return {{1, 2, 3}, {0, 2}, {3, 1, 0}, {2, 0, 1}}; }

}  // namespace acmp
