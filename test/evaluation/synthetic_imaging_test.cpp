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
