#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <random>
#include <type_traits>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/image/mask.h"
#include "acmp_mapping/image/rectifier.h"
#include "gmock/gmock.h"
#include "support/lens.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<ImageView<const float>>, "kernels take views by value");
static_assert(std::is_trivially_copyable_v<PlaneHypothesis> && std::is_trivially_copyable_v<Vec3f>, "copied as bytes");
static_assert(!std::is_copy_constructible_v<Image<float>> && !std::is_copy_assignable_v<Image<float>>,
              "copies are explicit");

/// About one pixel in `rarity` is ignored.
Mask RandomMask(int width, int height, int rarity) {
  std::mt19937 random(static_cast<unsigned>(width * 1000 + height));
  Mask mask(width, height);
  for (unsigned char& used : mask) used = random() % static_cast<unsigned>(rarity) == 0 ? 0 : 255;
  return mask;
}

Mask Full(int width, int height) { return Mask(width, height, 255); }

/// A picture that is 0 where the mask ignores and 1000 elsewhere, resized as images are: what is mixed with an ignored
/// pixel is less than 1000.
void ExpectResizedAsImages(const Mask& mask, int width, int height) {
  GrayImage picture(mask.width(), mask.height());
  std::transform(mask.begin(), mask.end(), picture.begin(),
                 [](unsigned char used) { return used == 0 ? 0.0f : 1000.0f; });
  const GrayImage expected = Resize(picture, width, height);
  const Mask resized = ResizeMask(mask, width, height);
  ASSERT_EQ(resized.width(), width);
  ASSERT_EQ(resized.height(), height);
  int ignored = 0, mixed = 0;
  for (size_t i = 0; i < resized.size(); ++i) {
    const bool is_ignored = resized.data()[i] == 0, is_mixed = expected.data()[i] < 999.9f;
    EXPECT_TRUE(is_ignored || !is_mixed) << "pixel " << i << " of " << width << " x " << height;
    ignored += is_ignored ? 1 : 0;
    mixed += is_mixed ? 1 : 0;
  }
  // A pixel of which 1e-6 and less is ignored is ignored, too, but nothing that is farther away.
  EXPECT_LE(ignored, mixed + mixed / 50 + 1);
  EXPECT_GT(ignored, 0);
  EXPECT_LT(ignored, width * height);
}

TEST(MaskTest, ResizedItIgnoresWhatIsMixedWithAnIgnoredPixel) {
  const Mask mask = RandomMask(60, 45, 40);
  ExpectResizedAsImages(mask, 30, 15);
  ExpectResizedAsImages(mask, 41, 31);
  ExpectResizedAsImages(mask, 59, 44);
  ExpectResizedAsImages(mask, 60, 45);
  ExpectResizedAsImages(mask, 97, 70);
  EXPECT_TRUE(ResizeMask({}, 10, 10).empty());
}

TEST(MaskTest, HalvedItIgnoresPixelsThatCoverAnIgnoredOne) {
  for (int ignored_row = 0; ignored_row < 5; ++ignored_row) {
    for (int ignored_col = 0; ignored_col < 7; ++ignored_col) {
      Mask mask = Full(7, 5);
      mask(ignored_col, ignored_row) = 0;
      const Mask halved = HalveMask(mask);
      ASSERT_EQ(halved.width(), 3);
      ASSERT_EQ(halved.height(), 2);
      for (int row = 0; row < 2; ++row) {
        for (int col = 0; col < 3; ++col) {
          // The odd last column and row belong to the pixel before.
          const bool covers = col == std::min(ignored_col / 2, 2) && row == std::min(ignored_row / 2, 1);
          EXPECT_EQ(halved(col, row) == 0, covers) << ignored_col << ' ' << ignored_row;
        }
      }
    }
  }
  EXPECT_TRUE(HalveMask({}).empty());
}

TEST(MaskTest, IntersectedItIgnoresWhatEitherIgnores) {
  const Mask a = RandomMask(20, 10, 3), b = RandomMask(20, 10, 4);
  const Mask both = IntersectMasks(a.Clone(), b);
  for (size_t i = 0; i < both.size(); ++i) EXPECT_EQ(both.data()[i] == 0, a.data()[i] == 0 || b.data()[i] == 0);
  EXPECT_TRUE(std::equal(a.begin(), a.end(), IntersectMasks({}, a).begin()));
  EXPECT_TRUE(std::equal(a.begin(), a.end(), IntersectMasks(a.Clone(), {}).begin()));
  EXPECT_TRUE(IntersectMasks({}, {}).empty());
  EXPECT_THROW(IntersectMasks(a.Clone(), Full(10, 20)), InvalidInputError);
}

TEST(MaskDistanceTest, IsTheChessboardDistance) {
  const Mask mask = RandomMask(50, 30, 300);
  const MaskDistanceMap mask_distance = MakeMaskDistance(mask);
  for (int row = 0; row < 30; ++row) {
    for (int col = 0; col < 50; ++col) {
      int nearest = kMaxMaskDistance;
      for (int r = 0; r < 30; ++r) {
        for (int c = 0; c < 50; ++c) {
          if (mask(c, r) == 0) nearest = std::min(nearest, std::max(std::abs(c - col), std::abs(r - row)));
        }
      }
      ASSERT_EQ(mask_distance(col, row), nearest) << col << ' ' << row;
    }
  }
}

using test::Distort;
using test::RayAt;
using Model = LensDistortion::Model;

Lens MakeLens(Model model, std::vector<double> coefficients) {
  return {{160, 120, 130, 128, 81.3, 58.6}, {model, std::move(coefficients)}};
}

/// A smooth pattern over the rays of the ideal camera.
double Pattern(double x, double y) { return 128 + 60 * std::sin(9 * x) * std::cos(7 * y); }

class RectifierModels : public ::testing::TestWithParam<Lens> {};

TEST_P(RectifierModels, UndoesTheLens) {
  const Lens& lens = GetParam();
  const PinholeCamera& camera = lens.camera();
  cv::Mat distorted(camera.height, camera.width, CV_8UC3);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector2d ray = RayAt(lens.camera(), lens.distortion(), u, v);
      distorted.at<cv::Vec3b>(v, u) = cv::Vec3b::all(cv::saturate_cast<uchar>(Pattern(ray.x(), ray.y())));
    }
  }
  Rectifier rectifier(lens);
  const ColorImage rectified = rectifier.Rectify(distorted);
  const Mask rim = rectifier.RectifyMask({});
  int compared = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const double x = (u - camera.cx) / camera.fx, y = (v - camera.cy) / camera.fy;
      const Eigen::Vector2d source = Distort(lens.camera(), lens.distortion(), x, y);
      const bool inside =
          source.x() >= 0 && source.y() >= 0 && source.x() <= camera.width - 1 && source.y() <= camera.height - 1;
      const bool valid = rim.empty() || rim(u, v) != 0;
      // remap's steps of 1/32 px: on the border itself either answer is right
      constexpr double kStep = 1.0 / 32;
      const bool border = std::abs(source.x()) < kStep || std::abs(source.x() - camera.width + 1) < kStep ||
                          std::abs(source.y()) < kStep || std::abs(source.y() - camera.height + 1) < kStep;
      if (!border) {
        ASSERT_EQ(valid, inside) << u << " " << v;
      }
      if (!inside || border) continue;
      // Steepest slope 60 * 9 / 130 = 4.2 grey levels per px: rounding, bilinear interpolation and 1/32 px steps stay
      // below 1.5 levels; half a pixel of offset would be 2.
      ASSERT_NEAR(rectified(u, v).g, Pattern(x, y), 1.5) << u << " " << v;
      ++compared;
    }
  }
  EXPECT_GT(compared, camera.width * camera.height / 2);
}

INSTANTIATE_TEST_SUITE_P(Models, RectifierModels,
                         ::testing::Values(MakeLens(Model::kBrownConrady,
                                                    {-0.28, 0.07, 2e-4, 2e-5}),  // the EuRoC camera's
                                           MakeLens(Model::kBrownConrady, {0.12, -0.1, 1e-3, -5e-4, 0.02}),
                                           MakeLens(Model::kRational, {0.4, -0.2, 1e-4, -1e-4, 0.01, 0.5, -0.1, 0.02}),
                                           MakeLens(Model::kEquidistant, {-0.013, 0.02, -0.012, 0.002})));

/// The camera turns about y and moves along y while it reads out: the first rows are taken before the middle one.
TEST(Rectifier, TakesTheRollingShutterOut) {
  const Lens lens = MakeLens(Model::kNone, {});
  const PinholeCamera& camera = lens.camera();
  constexpr double kTurn = 0.05, kMove = 0.03;  // 6.5 px, 3.8 px
  cv::Mat taken(camera.height, camera.width, CV_8UC3);
  for (int v = 0; v < camera.height; ++v) {
    const double time = (v + 0.5) / camera.height - 0.5;
    const Eigen::Matrix3d back = Eigen::AngleAxisd(-time * kTurn, Eigen::Vector3d::UnitY()).toRotationMatrix();
    for (int u = 0; u < camera.width; ++u) {
      Eigen::Vector3d ray = camera.Unproject({static_cast<double>(u), static_cast<double>(v)});
      ray = back * (ray + time * Eigen::Vector3d(0, kMove, 0));
      taken.at<cv::Vec3b>(v, u) =
          cv::Vec3b::all(cv::saturate_cast<uchar>(Pattern(ray.x() / ray.z(), ray.y() / ray.z())));
    }
  }
  const ColorImage freed = Rectifier(lens, ReadoutMotion{{0, kTurn, 0}, {0, kMove, 0}}).Rectify(taken);
  constexpr int kRim = 5;
  for (int v = kRim; v < camera.height - kRim; ++v) {
    for (int u = kRim; u < camera.width - kRim; ++u) {
      // As above, 1.5 levels, and 0.06 px of rows that are looked up where their pixels are after it.
      ASSERT_NEAR(freed(u, v).g, Pattern((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy), 2) << u << " " << v;
    }
  }
}

TEST(Rectifier, MasksAreRectifiedWithTheirImages) {
  const Lens lens = MakeLens(Model::kBrownConrady, {-0.28, 0.07, 2e-4, 2e-5});
  const PinholeCamera& camera = lens.camera();
  Mask mask(camera.width, camera.height, 1);
  for (int row = 20; row < 30; ++row) {
    for (int col = 10; col < 25; ++col) mask(col, row) = 0;
  }
  Rectifier rectifier(lens);
  rectifier.Rectify(cv::Mat::zeros(camera.height, camera.width, CV_8UC3));
  const Mask rectified = rectifier.RectifyMask(mask);
  int ignored = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector2d source =
          Distort(lens.camera(), lens.distortion(), (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
      // Interpolation reaches a pixel to each side.
      const auto is_within = [&](double margin) {
        return source.x() > 10 - margin && source.x() < 24 + margin && source.y() > 20 - margin &&
               source.y() < 29 + margin;
      };
      const bool is_ignored = rectified(u, v) == 0;
      ASSERT_TRUE(is_ignored || !is_within(0.9)) << u << ' ' << v;
      ASSERT_TRUE(!is_ignored || is_within(1.1)) << u << ' ' << v;
      ignored += is_ignored ? 1 : 0;
    }
  }
  EXPECT_GT(ignored, 100);
  EXPECT_THROW(rectifier.RectifyMask(Mask(camera.width, camera.height + 1, 255)), InvalidInputError);
}

TEST(Rectifier, DepthOfAnySizeIsRectifiedWithoutInterpolation) {
  const Lens lens = MakeLens(Model::kBrownConrady, {-0.28, 0.07, 2e-4, 2e-5});
  const PinholeCamera& camera = lens.camera();
  DepthMap depth(camera.width / 2, camera.height / 2, 4);
  for (int row = 0; row < depth.height(); ++row) {
    for (int col = 0; col < 15; ++col) depth(col, row) = 2;
  }
  Rectifier rectifier(lens);
  rectifier.Rectify(cv::Mat::zeros(camera.height, camera.width, CV_8UC3));
  const DepthMap rectified = rectifier.RectifyDepth(depth);
  int near = 0;
  for (int v = 5; v < camera.height - 5; ++v) {
    for (int u = 5; u < camera.width - 5; ++u) {
      const Eigen::Vector2d source =
          Distort(lens.camera(), lens.distortion(), (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
      if (std::abs(source.x() - 29.5) < 0.6) continue;
      ASSERT_EQ(rectified(u, v), source.x() < 29.5 ? 2 : 4) << u << ' ' << v;
      near += rectified(u, v) == 2 ? 1 : 0;
    }
  }
  EXPECT_GT(near, 1000);
  EXPECT_TRUE(rectifier.RectifyDepth({}).empty());
}

TEST(Rectifier, DepthOfFacesIsMadeOfDistances) {
  const Lens lens({240, 240, 72, 72, 119.5, 119.5}, {Model::kEquidistant, {-0.01, 0.004, 0, 0}}, 190);
  const std::vector<PinholeFace> faces = FacesOf(lens);
  ASSERT_EQ(faces.size(), 5u);
  DepthMap distances(24, 24);
  std::fill(distances.begin(), distances.end(), 2.0f);
  for (const PinholeFace& face : faces) {
    const DepthMap depth = Rectifier(lens, face).RectifyDepth(distances);
    const Mask mask = Rectifier(lens, face).RectifyMask({});
    for (int v = 0; v < depth.height(); ++v) {
      for (int u = 0; u < depth.width(); ++u) {
        if (!mask.empty() && mask(u, v) == 0) continue;
        const double z = 2 / face.camera.Unproject({static_cast<double>(u), static_cast<double>(v)}).norm();
        ASSERT_NEAR(depth(u, v), z, 1e-5) << face.name << u << ' ' << v;
      }
    }
  }
}

/// Smooth over the sphere.
double PatternOn(const Eigen::Vector3d& ray) { return 128 + 50 * ray.x() + 40 * ray.y() * ray.z() + 20 * ray.z(); }

TEST(Rectifier, FacesOfAWideLensShowTheWorldTheRightWayRound) {
  const double kFocal = 400 / (2 * M_PI);
  for (const Lens& lens :
       {Lens({400, 200, kFocal, kFocal, 199.5, 99.5}, {Model::kEquirectangular, {}}),
        Lens({400, 200, kFocal, kFocal, 199.5, 99.5}, {Model::kEquirectangular, {}}, 190),
        Lens({240, 240, 72, 72, 119.5, 119.5}, {Model::kEquidistant, {-0.01, 0.004, 0, 0}}, 190),
        Lens({240, 240, 150, 150, 119.5, 119.5}, {Model::kUnified, {1.5, -0.01, 0, 1e-4, 1e-4}}, 200)}) {
    const PinholeCamera& sent = lens.camera();
    cv::Mat image(sent.height, sent.width, CV_8UC3, cv::Scalar(0, 0, 0));
    for (int v = 0; v < sent.height; ++v) {
      for (int u = 0; u < sent.width; ++u) {
        const Eigen::Vector2d pixel(u, v), centre(sent.cx, sent.cy);
        auto ray = lens.Unproject(pixel);
        // The circle leaves tangential distortion aside, here up to 0.2 px: its rim is painted, too.
        if (!ray && lens.Shows(pixel)) ray = lens.Unproject(centre + 0.998 * (pixel - centre));
        if (ray) image.at<cv::Vec3b>(v, u) = cv::Vec3b::all(cv::saturate_cast<uchar>(PatternOn(*ray)));
      }
    }
    int masked = 0, shown = 0;
    const std::vector<PinholeFace> faces = FacesOf(lens);
    EXPECT_GT(faces.size(), 1u);
    for (const PinholeFace& face : faces) {
      const Rectifier rectifier(lens, face);
      const ColorImage rectified = rectifier.Rectify(image);
      const Mask mask = rectifier.RectifyMask({});
      ASSERT_EQ(rectified.width(), face.camera.width);
      for (int v = 0; v < face.camera.height; ++v) {
        for (int u = 0; u < face.camera.width; ++u) {
          if (!mask.empty() && mask(u, v) == 0) {
            ++masked;
            continue;
          }
          ++shown;
          const Eigen::Vector3d ray = face.camera.Unproject({static_cast<double>(u), static_cast<double>(v)});
          // At most 2 levels per pixel at 64 px per rad: rounding twice and steps of 1/32 px stay below 1.5. A black
          // pixel from outside of the circle, or another face, is off by tens.
          ASSERT_NEAR(rectified(u, v).g, PatternOn(face.lens_from_face * ray.normalized()), 3)
              << face.name << u << ' ' << v;
        }
      }
    }
    EXPECT_EQ(masked == 0, lens.Shows({0, 99})) << "a whole sphere has something behind";
    EXPECT_GT(shown, masked);
  }
}

TEST(Rectifier, TheZenithOfASphereIsNotMixedWithTheNadir) {
  const double kFocal = 400 / (2 * M_PI);
  const Lens lens({400, 200, kFocal, kFocal, 199.5, 99.5}, {Model::kEquirectangular, {}});
  cv::Mat image(200, 400, CV_8UC3, cv::Scalar(255, 255, 255));
  image.rowRange(100, 200) = 0;
  int above = 0;
  for (const PinholeFace& face : FacesOf(lens)) {
    const ColorImage rectified = Rectifier(lens, face).Rectify(image);
    for (int v = 0; v < face.camera.height; ++v) {
      for (int u = 0; u < face.camera.width; ++u) {
        const Eigen::Vector3d ray = face.camera.Unproject({static_cast<double>(u), static_cast<double>(v)});
        const double down = (face.lens_from_face * ray.normalized()).y();
        if (std::abs(down) < 0.2) continue;
        ASSERT_EQ(rectified(u, v).g, down > 0 ? 0 : 255) << face.name << u << ' ' << v;
        above += down < -0.99 ? 1 : 0;
      }
    }
  }
  EXPECT_GT(above, 0);
}

}  // namespace
}  // namespace acmp
