#include <memory>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "gtest/gtest.h"

#include "acmp_mapping/common/random.h"
#include "acmp_mapping/evaluation/depth_metrics.h"
#include "acmp_mapping/image/image_processing.h"
#include "support/devices.h"
#include "support/scene_run.h"

// Depth from outside end to end: what is right, for all its faults, helps blank walls; what says nothing, or is wrong,
// does no harm.

namespace acmp {
namespace {

constexpr DepthRange kRange = {0.6f, 8};
constexpr int kWidth = 120, kHeight = 90, kKeyframes = 6;

const std::vector<SyntheticView>& Room() {
  static const std::vector<SyntheticView> views = MakeSyntheticScene({kWidth, kHeight, kKeyframes});
  return views;
}

/// From the true depth of a view, by its number.
using MakePrior = DepthMap (*)(const DepthMap& truth, int view);

DepthMap None(const DepthMap&, int) { return {}; }

/// Edges blurred as by 3 px of 540; another scale in each image, which drifts by a tenth over it; a part that is
/// missing or a wall that is wrong.
DepthMap Degraded(const DepthMap& truth, int view, bool half_missing) {
  DepthMap depth = truth.Clone();
  cv::Mat pixels = AsMat(depth);
  cv::GaussianBlur(pixels, pixels, {}, 0.7);
  const float scale = 0.8f + 0.1f * static_cast<float>(view);
  for (int row = 0; row < kHeight; ++row) {
    for (int col = 0; col < kWidth; ++col) {
      depth(col, row) *= scale * (0.95f + 0.1f * static_cast<float>(col) / kWidth);
      const bool is_left = col < kWidth / 2;
      if (half_missing && is_left == (view % 2 == 0)) depth(col, row) = 0;
      if (!half_missing && is_left && row > kHeight / 2) depth(col, row) = 2.5f;
    }
  }
  return depth;
}
DepthMap HalfMissing(const DepthMap& truth, int view) { return Degraded(truth, view, true); }
DepthMap WrongWall(const DepthMap& truth, int view) { return Degraded(truth, view, false); }

DepthMap Noise(const DepthMap&, int view) {
  DepthMap depth(kWidth, kHeight);
  RandomStream random(1, static_cast<uint32_t>(view), 0);
  for (float& z : depth) z = random.NextUniform(0.6f, 8);
  return depth;
}

struct Shares {
  double all, blank;  ///< percent below 5 cm
  int rejected;       ///< images whose prior depth is not used
};

class PriorDepthTest : public EngineTest {
 protected:
  Shares Run(MakePrior make_prior) {
    std::vector<FramePtr> frames;
    for (int i = 0; i < kKeyframes; ++i) {
      const SyntheticView& made = Room()[static_cast<size_t>(i)];
      frames.push_back(std::make_shared<const Frame>(MakeFrame(i, 0, made.frame.color.Clone(), made.frame.camera,
                                                               made.frame.cam_from_world, made.frame.landmarks_in_world,
                                                               {}, {}, make_prior(made.true_depth, i))));
    }
    std::vector<EngineView> views = LoadFrames(frames, engine_.get());
    DepthEstimator estimator(engine_.get(), MakePreset("balanced"));
    Shares shares = {};
    for (const KeyframeStep& step : estimator.schedule()) {
      const std::vector<EngineView> before = views;
      for (size_t i = 0; i < views.size(); ++i) {
        views[i].estimate = estimator.Run(step, {before[i], Others(before, i), kRange});
        const bool is_last = step.kind == KeyframeStep::Kind::kFillUnverified;
        shares.rejected += is_last && !estimator.prior_depth_rejection().empty() ? 1 : 0;
      }
    }
    DepthErrors all, blank;
    for (size_t i = 0; i < views.size(); ++i) {
      const DepthMap depth = engine_->DownloadDepth(views[i].estimate);
      all.Add(depth, Room()[i].true_depth);
      blank.Add(depth, Room()[i].true_depth, Room()[i].low_texture.View());
    }
    constexpr int k5Centimetres = 1;
    shares.all = all.Metrics().below_absolute[k5Centimetres];
    shares.blank = blank.Metrics().below_absolute[k5Centimetres];
    return shares;
  }
};
INSTANTIATE_TEST_SUITE_P(Devices, PriorDepthTest, ::testing::Values(Device::kCpu, Device::kCuda), DeviceName);

TEST_P(PriorDepthTest, HelpsBlankWallsForAllItsFaultsAndDoesNoHarmWhenItSaysNothing) {
  const Shares none = Run(None);
  EXPECT_EQ(none.rejected, 0);
  for (const MakePrior good : {HalfMissing, WrongWall}) {
    const Shares shares = Run(good);
    EXPECT_GT(shares.blank, none.blank + 3) << (good == HalfMissing ? "half missing" : "wrong wall");
    EXPECT_GT(shares.all, none.all + 3);
    EXPECT_LE(shares.rejected, 1);
  }
  const Shares useless = Run(Noise);  // constant maps and ramps are in test/fill
  EXPECT_EQ(useless.rejected, kKeyframes);
  EXPECT_EQ(useless.all, none.all) << "it changes no bit";
  EXPECT_EQ(useless.blank, none.blank);
}

}  // namespace
}  // namespace acmp
