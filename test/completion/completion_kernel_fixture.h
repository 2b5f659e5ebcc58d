#pragma once

#include "gtest/gtest.h"

#include "acmp_mapping/completion/kernel/complete_pixel.h"
#include "acmp_mapping/completion/kernel/fit_anchor.h"

namespace acmp {

/// Maps and anchors of an image in cells of 4 px.
class CompletionKernelTest : public ::testing::Test {
 protected:
  static constexpr int kWidth = 40, kHeight = 30, kCell = 4;

  explicit CompletionKernelTest(int width = kWidth, int height = kHeight)
      : sightings_(width, height),
        planes_(width, height),
        cost_(width, height),
        anchors_(CellsOf(width, kCell), CellsOf(height, kCell)),
        fitted_(anchors_.width(), anchors_.height()),
        nearest_(anchors_.width(), anchors_.height()) {
    context_.rays = {1 / 50.0f, 1 / 52.0f, 19.5f, 14.5f};
    context_.depth_min = 1;
    context_.depth_max = 20;
    context_.anchor_views = 2;
    context_.min_views = 2;
    context_.cell_size = kCell;
    context_.sightings = sightings_.View();
    context_.planes = planes_.View();
    context_.cost = cost_.View();
    context_.anchors = anchors_.View();
    context_.fitted = fitted_.View();
    context_.nearest = nearest_.View();
  }

  Vec3f Ray(int col, int row) const { return context_.rays.Ray(static_cast<float>(col), static_cast<float>(row)); }
  float DepthAt(const PlaneHypothesis& plane, int col, int row) const { return PlaneDepth(plane, Ray(col, row)); }

  void FindAll() {
    for (int row = 0; row < anchors_.height(); ++row) {
      for (int col = 0; col < anchors_.width(); ++col) FindAnchor(context_, col, row, SingleThread());
    }
  }
  void FitAll() {
    for (int row = 0; row < anchors_.height(); ++row) {
      for (int col = 0; col < anchors_.width(); ++col) FitAnchor(context_, col, row, SingleThread());
    }
  }
  void FindAllNearest() {
    for (int row = 0; row < nearest_.height(); ++row) {
      for (int col = 0; col < nearest_.width(); ++col) {
        for (int i = 0; i < kNumDirections; ++i) FindNearestAnchor(context_, col, row, i);
      }
    }
  }

  Image<Sightings> sightings_;
  PlaneMap planes_;
  CostMap cost_;
  Image<AnchorCell> anchors_, fitted_;
  Image<NearestAnchors> nearest_;
  CompletionContext context_ = {};
};

}  // namespace acmp
