#include "synthetic_imaging.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

ImagingModel Perfect() {
  ImagingModel model;
  model.read_noise_grey = 0;
  return model;
}

std::vector<SyntheticView> MakeRoom(const ImagingModel& imaging) {
  SyntheticSceneOptions options;
  options.width = 96;
  options.height = 72;
  options.keyframes = 4;
  options.imaging = imaging;
  return MakeSyntheticScene(options);
}

int Channel(const Rgb& color, int channel) { return channel == 0 ? color.r : channel == 1 ? color.g : color.b; }

void ExpectColor(const Rgb& color, int r, int g, int b) {
  EXPECT_EQ(color.r, r);
  EXPECT_EQ(color.g, g);
  EXPECT_EQ(color.b, b);
}

TEST(Digitize, NoiseHasTheModelsMeanAndVariance) {
  ImagingModel model;
  model.read_noise_grey = 1.0;
  model.grey_per_electron = 0.1;
  constexpr int kPixels = 20000;
  constexpr double kSamples = 3.0 * kPixels;
  for (const double signal : {20.0, 100.0, 220.0}) {  // no draw is beyond 3.5 * 4.8: none is clipped
    double sum = 0, sum_squares = 0;
    for (uint32_t pixel = 0; pixel < kPixels; ++pixel) {
      RandomStream random(5, pixel, 0);
      const Rgb color = Digitize(model, {signal, signal, signal}, &random);
      for (int channel = 0; channel < 3; ++channel) {
        const double difference = Channel(color, channel) - signal;
        sum += difference;
        sum_squares += difference * difference;
      }
    }
    // Rounding adds 1/12 to the variance: its error is uniform where the noise is wider than a grey level.
    const double variance = 1.0 + 0.1 * signal + 1.0 / 12;
    // Five standard deviations of a sample mean; of a sample variance, with the fourth moment 2.7 sigma^4 of a sum of
    // four uniform draws.
    EXPECT_NEAR(sum / kSamples, 0.0, 5 * std::sqrt(variance / kSamples)) << signal;
    EXPECT_NEAR(sum_squares / kSamples, variance, 5 * variance * std::sqrt(1.7 / kSamples)) << signal;
  }
}

TEST(Digitize, ClipsAtBothEnds) {
  ImagingModel model = Perfect();
  RandomStream random(1, 2, 3);
  ExpectColor(Digitize(model, {254.4, 254.6, 400.0}, &random), 254, 255, 255);
  model.read_noise_grey = 2;
  for (uint32_t pixel = 0; pixel < 1000; ++pixel) {
    RandomStream noise(1, pixel, 0);
    ExpectColor(Digitize(model, {300.0, 300.0, 300.0}, &noise), 255, 255, 255);
  }
}

TEST(Exposure, ScalesTheImagesLightAsTheViewSays) {
  ImagingModel model = Perfect();
  const std::vector<SyntheticView> even = MakeRoom(model);
  model.exposure_spread = 0.25;
  const std::vector<SyntheticView> uneven = MakeRoom(model);
  double least = 10, most = 0;
  for (size_t i = 0; i < even.size(); ++i) {
    const double exposure = uneven[i].exposure;
    EXPECT_EQ(even[i].exposure, 1.0);
    EXPECT_GE(exposure, 0.6);  // 0.75 / 1.25
    EXPECT_LE(exposure, 1.25 / 0.75);
    least = std::min(least, exposure);
    most = std::max(most, exposure);
    for (size_t k = 0; k < even[i].frame.color.size(); ++k) {
      for (int channel = 0; channel < 3; ++channel) {
        const double light = Channel(even[i].frame.color.data()[k], channel);
        if (light == 255) continue;  // how much more there was is lost
        // Both images are rounded to whole grey levels.
        ASSERT_NEAR(Channel(uneven[i].frame.color.data()[k], channel), std::min(255.0, exposure * light),
                    0.5 + 0.5 * exposure);
      }
    }
  }
  EXPECT_GT(most, 1.1 * least);  // four draws from 0.6 to 1.67
}

TEST(Vignetting, FollowsTheFourthPowerOfTheCosine) {
  ImagingModel model = Perfect();
  const SyntheticView even = std::move(MakeRoom(model)[1]);
  model.vignetting = true;
  const SyntheticView dark = std::move(MakeRoom(model)[1]);
  const PinholeCamera& camera = even.frame.camera;
  double least = 1;
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      const double off_axis = std::hypot((col - camera.cx) / camera.fx, (row - camera.cy) / camera.fy);
      const double factor = std::pow(std::cos(std::atan(off_axis)), 4);
      least = std::min(least, factor);
      ASSERT_NEAR(VignettingAt(model, camera, col, row), factor, 1e-12);
      // Both images are rounded.
      ASSERT_NEAR(dark.frame.color(col, row).g, factor * even.frame.color(col, row).g, 1.0);
    }
  }
  EXPECT_LT(least, 0.45);  // 36 degrees off the axis in a corner
}

TEST(Psf, HasTheModelsVarianceAndKeepsTheLight) {
  for (const double sigma : {0.3, 0.7, 1.0, 2.4}) {
    ImagingModel model;
    model.psf_sigma_px = sigma;
    const int border = PsfBorder(model);
    Image<ColorD> light(4 * border + 1, 4 * border + 1, ColorD{0, 0, 0});
    light(2 * border, 2 * border) = {1, 0, 2};
    const Image<ColorD> blurred = BlurByPsf(model, std::move(light));
    ASSERT_EQ(blurred.width(), 2 * border + 1);
    double sum = 0, along_x = 0, along_y = 0, blue = 0;
    for (int v = -border; v <= border; ++v) {
      for (int u = -border; u <= border; ++u) {
        const ColorD& c = blurred(u + border, v + border);
        sum += c.r;
        along_x += u * u * c.r;
        along_y += v * v * c.r;
        blue += c.b;
        EXPECT_EQ(c.g, 0.0);
      }
    }
    EXPECT_NEAR(sum, 1.0, 1e-12);
    EXPECT_NEAR(blue, 2.0, 1e-12);
    EXPECT_NEAR(along_x, sigma * sigma, 1e-12);
    EXPECT_NEAR(along_y, sigma * sigma, 1e-12);
  }
}

TEST(Psf, RendersTheBlurOfTheSharpImageUpToItsBorders) {
  ImagingModel model = Perfect();
  const SyntheticView sharp = std::move(MakeRoom(model)[2]);
  model.psf_sigma_px = 0.5;
  const SyntheticView blurred = std::move(MakeRoom(model)[2]);
  const ColorImage& image = sharp.frame.color;
  constexpr double kTaps[3] = {0.125, 0.75, 0.125};  // variance 1/4
  int changed = 0;
  for (int row = 1; row < image.height() - 1; ++row) {
    for (int col = 1; col < image.width() - 1; ++col) {
      double sum = 0;
      for (int v = -1; v <= 1; ++v) {
        for (int u = -1; u <= 1; ++u) sum += kTaps[u + 1] * kTaps[v + 1] * image(col + u, row + v).g;
      }
      ASSERT_NEAR(blurred.frame.color(col, row).g, sum, 1.0);  // both are rounded
      changed += std::abs(sum - image(col, row).g) > 2;
    }
  }
  EXPECT_GT(changed, 500);  // of 6580: edges and texture
  EXPECT_EQ(blurred.frame.color.width(), image.width());
}

TEST(Shake, TurnsAsFarAsTheModelSaysAroundTheTruePose) {
  const CameraPose pose = PoseOnPath(HandHeldPath{{0, 1, 1}, 2.0, 0.03}, 1, 4, 1);
  ImagingModel model;
  model.shake_deg = 0.3;
  constexpr int kImages = 2000, kMoments = 16;
  constexpr double kRadPerDeg = M_PI / 180;
  double pan_squares = 0, tilt_squares = 0, roll_squares = 0;
  for (int index = 0; index < kImages; ++index) {
    const std::vector<CameraPose> poses = PosesDuringExposure(model, pose, 1, index, kMoments);
    ASSERT_EQ(poses.size(), static_cast<size_t>(kMoments));
    Vec3d mean = {0, 0, 0};
    for (const CameraPose& p : poses) {
      mean = mean + (1.0 / kMoments) * p.forward;
      ASSERT_NEAR(Dot(p.right, p.down), 0, 1e-12);
      ASSERT_NEAR(Norm(Cross(p.right, p.down) - p.forward), 0, 1e-12);
      // The cosine of an angle of up to 1.6 degrees.
      ASSERT_GT(Dot(p.forward, pose.forward), std::cos(LargestTurn(model)) - 1e-12);
    }
    // Opposite turns cancel but for the square of the angle, 0.027^2 at most.
    ASSERT_NEAR(Norm(mean - pose.forward), 0, 1e-3);
    const Vec3d turn = poses.back().forward - poses.front().forward;
    pan_squares += std::pow(Dot(turn, pose.right), 2);
    tilt_squares += std::pow(Dot(turn, pose.down), 2);
    roll_squares += std::pow(Dot(poses.back().right - poses.front().right, pose.down), 2);
  }
  // The moments are the middles of 16 equal parts: 15/16 of the whole turn lies between the first and the last. Five
  // standard deviations of a sample variance (see NoiseHasTheModelsMeanAndVariance).
  const double variance = std::pow(15.0 / 16 * 0.3 * kRadPerDeg, 2);
  for (const double squares : {pan_squares, tilt_squares, roll_squares}) {
    EXPECT_NEAR(squares / kImages / variance, 1.0, 5 * std::sqrt(1.7 / kImages));
  }
}

TEST(Shake, BlursTheImageAndLeavesTheTruthAlone) {
  ImagingModel model = Perfect();
  const SyntheticView still = std::move(MakeRoom(model)[3]);
  model.shake_deg = 2.0;  // 2.9 px per standard deviation and axis
  const SyntheticView shaken = std::move(MakeRoom(model)[3]);
  EXPECT_TRUE(std::equal(still.true_depth.begin(), still.true_depth.end(), shaken.true_depth.begin()));
  EXPECT_TRUE(still.frame.cam_from_world.isApprox(shaken.frame.cam_from_world, 0));
  const auto gradient_energy = [](const ColorImage& image) {
    double energy = 0;
    for (int row = 1; row < image.height(); ++row) {
      for (int col = 1; col < image.width(); ++col) {
        const int here = image(col, row).g;
        energy += std::pow(here - image(col - 1, row).g, 2) + std::pow(here - image(col, row - 1).g, 2);
      }
    }
    return energy;
  };
  // Edges one pixel wide lose more than half of their energy across a turn of two, and all lie across one axis or the
  // other; broad texture loses little.
  EXPECT_LT(gradient_energy(shaken.frame.color), 0.7 * gradient_energy(still.frame.color));
}

TEST(ImagingModel, RefusesFieldsOutOfBounds) {
  const auto refuses = [](double ImagingModel::*field, double value) {
    ImagingModel model;
    model.*field = value;
    EXPECT_THROW(Validate(model), InvalidInputError) << value;
  };
  refuses(&ImagingModel::read_noise_grey, -0.1);
  refuses(&ImagingModel::read_noise_grey, 50.1);
  refuses(&ImagingModel::grey_per_electron, 1.1);
  refuses(&ImagingModel::grey_per_electron, std::nan(""));
  refuses(&ImagingModel::psf_sigma_px, 5.1);
  refuses(&ImagingModel::shake_deg, 2.1);
  refuses(&ImagingModel::exposure_spread, 0.51);
  EXPECT_NO_THROW(Validate(ImagingModel()));
}

}  // namespace
}  // namespace acmp
