#pragma once

#include "gtest/gtest.h"

#include "acmp_mapping/fill/kernel/fill_pixel.h"
#include "acmp_mapping/fill/kernel/fit_seed.h"

namespace acmp {

/// Maps and seeds of an image in cells of 4 px.
class FillKernelTest : public ::testing::Test {
 protected:
  static constexpr int kWidth = 40, kHeight = 30, kCell = 4;

  explicit FillKernelTest(int width = kWidth, int height = kHeight)
      : support_(width, height),
        planes_(width, height),
        cost_(width, height),
        seeds_(CellsOf(width, kCell), CellsOf(height, kCell)),
        fitted_(seeds_.width(), seeds_.height()),
        nearest_(seeds_.width(), seeds_.height()) {
    context_.rays = {1 / 50.0f, 1 / 52.0f, 19.5f, 14.5f};
    context_.depth_min = 1;
    context_.depth_max = 20;
    context_.seed_views = 2;
    context_.min_views = 2;
    context_.cell_size = kCell;
    context_.support = support_.View();
    context_.planes = planes_.View();
    context_.cost = cost_.View();
    context_.seeds = seeds_.View();
    context_.fitted = fitted_.View();
    context_.nearest = nearest_.View();
  }

  Vec3f Ray(int col, int row) const { return context_.rays.Ray(static_cast<float>(col), static_cast<float>(row)); }
  float DepthAt(const PlaneHypothesis& plane, int col, int row) const { return PlaneDepth(plane, Ray(col, row)); }

  void FindAll() {
    for (int row = 0; row < seeds_.height(); ++row) {
      for (int col = 0; col < seeds_.width(); ++col) FindSeed(context_, col, row, SingleThread());
    }
  }
  void FitAll() {
    for (int row = 0; row < seeds_.height(); ++row) {
      for (int col = 0; col < seeds_.width(); ++col) FitSeed(context_, col, row, SingleThread());
    }
  }
  void FindAllNearest() {
    for (int row = 0; row < nearest_.height(); ++row) {
      for (int col = 0; col < nearest_.width(); ++col) {
        for (int i = 0; i < kNumDirections; ++i) FindNearestSeed(context_, col, row, i);
      }
    }
  }

  Image<ViewSupport> support_;
  PlaneMap planes_;
  CostMap cost_;
  Image<SeedCell> seeds_, fitted_;
  Image<NearestSeeds> nearest_;
  FillContext context_ = {};
};

}  // namespace acmp
