#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "acmp_mapping/common/degrees.h"
#include "acmp_mapping/geometry/interpolate.h"
#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/geometry/similarity.h"
#include "support/error_text.h"
#include "support/lens.h"

namespace acmp {
namespace {

using Model = LensDistortion::Model;

constexpr double kDeg = kRadPerDeg<double>;

const PinholeCamera kCamera = {640, 480, 190, 191, 322.3, 238.6};

Eigen::Vector3d RayAtAngle(double from_axis_deg, double around_deg) {
  const double sine = std::sin(from_axis_deg * kDeg);
  return {sine * std::cos(around_deg * kDeg), sine * std::sin(around_deg * kDeg), std::cos(from_axis_deg * kDeg)};
}

TEST(Lens, PutsRaysWhereTheModelsFormulasDo) {
  const PinholeCamera camera = {160, 120, 130, 128, 81.3, 58.6};
  for (const LensDistortion& distortion :
       {LensDistortion{Model::kNone, {}}, LensDistortion{Model::kBrownConrady, {-0.28, 0.07, 2e-4, 2e-5}},
        LensDistortion{Model::kBrownConrady, {0.12, -0.1, 1e-3, -5e-4, 0.02}},
        LensDistortion{Model::kRational, {0.4, -0.2, 1e-4, -1e-4, 0.01, 0.5, -0.1, 0.02}},
        LensDistortion{Model::kEquidistant, {-0.013, 0.02, -0.012, 0.002}}}) {
    const Lens lens(camera, distortion);
    for (double x = -0.6; x < 0.7; x += 0.1) {
      for (double y = -0.45; y < 0.5; y += 0.1) {
        const auto seen = lens.Project({2 * x, 2 * y, 2});
        ASSERT_TRUE(seen);
        EXPECT_NEAR((*seen - test::Distort(camera, distortion, x, y)).norm(), 0, 1e-9);
      }
    }
  }
}

TEST(Lens, WideModelsAreTheirFormulas) {
  const Lens sphere({400, 200, 200 / M_PI, 200 / M_PI, 199.5, 99.5}, {Model::kEquirectangular, {}});
  EXPECT_NEAR(sphere.Project(RayAtAngle(90, 0))->x(), 299.5, 1e-9);  // right: a quarter of 360 degrees from the middle
  EXPECT_NEAR(sphere.Project(RayAtAngle(45, 90))->y(), 149.5, 1e-9);
  EXPECT_NEAR(std::abs(sphere.Project({1e-9, 0, -1})->x() - 199.5), 200, 1e-6);
  EXPECT_NEAR(sphere.FieldOfView(), 360, 1e-9);

  // xi = 1 without distortion is the stereographic projection: 2 f tan(theta / 2) / 2.
  const Lens mei(kCamera, {Model::kUnified, {1, 0, 0, 0, 0}});
  EXPECT_NEAR(mei.Project(RayAtAngle(100, 0))->x(), 322.3 + 190 * std::tan(50 * kDeg), 1e-9);
  // xi = 0 is a pinhole with plumb_bob.
  const Lens plain(kCamera, {Model::kUnified, {0, -0.1, 0.02, 1e-3, 2e-3}});
  EXPECT_NEAR((*plain.Project({0.4, 0.3, 1}) -
               test::Distort(kCamera, {Model::kBrownConrady, {-0.1, 0.02, 1e-3, 2e-3}}, 0.4, 0.3))
                  .norm(),
              0, 1e-9);
}

/// The rays of EUCM and double sphere as their papers have them in closed form, of an image point for a focal length of
/// 1: Khomutenko et al. 2016, eq. 6, and Usenko et al. 2018, eqs. 46 to 52.
Eigen::Vector3d RayOfEucm(const Eigen::Vector2d& m, double alpha, double beta) {
  const double r2 = m.squaredNorm();
  const double z = (1 - beta * alpha * alpha * r2) / (alpha * std::sqrt(1 - (2 * alpha - 1) * beta * r2) + 1 - alpha);
  return Eigen::Vector3d(m.x(), m.y(), z).normalized();
}

Eigen::Vector3d RayOfDoubleSphere(const Eigen::Vector2d& m, double xi, double alpha) {
  const double r2 = m.squaredNorm();
  const double z = (1 - alpha * alpha * r2) / (alpha * std::sqrt(1 - (2 * alpha - 1) * r2) + 1 - alpha);
  const double factor = (z * xi + std::sqrt(z * z + (1 - xi * xi) * r2)) / (z * z + r2);
  return factor * Eigen::Vector3d(m.x(), m.y(), z) - Eigen::Vector3d(0, 0, xi);
}

TEST(Lens, ModelsOfKalibrAndBasaltAreTheirClosedForms) {
  // The first is TUM-VI's as basalt has it, the second one of an EUCM lens, the third UCM.
  const Lens sphere({512, 512, 158.28, 158.27, 254.96, 256.88}, {Model::kDoubleSphere, {-0.172, 0.593}});
  const Lens extended({512, 512, 190, 191, 254.9, 256.9}, {Model::kExtendedUnified, {0.6, 1.1}});
  const Lens unified({512, 512, 190, 191, 254.9, 256.9}, {Model::kExtendedUnified, {0.55, 1}});
  for (const Lens* lens : {&sphere, &extended, &unified}) {
    const PinholeCamera& c = lens->camera();
    const std::vector<double>& k = lens->distortion().coefficients;
    int beyond = 0;
    for (double u = 10; u < 510; u += 40) {
      for (double v = 10; v < 510; v += 40) {
        const Eigen::Vector2d m((u - c.cx) / c.fx, (v - c.cy) / c.fy);
        if (m.norm() > 2.1) continue;  // the corners lie outside of the circle
        const Eigen::Vector3d ray = lens == &sphere ? RayOfDoubleSphere(m, k[0], k[1]) : RayOfEucm(m, k[0], k[1]);
        const auto seen = lens->Project(3 * ray);
        const auto back = lens->Unproject({u, v});
        ASSERT_TRUE(seen && back) << m.transpose();
        EXPECT_NEAR((*seen - Eigen::Vector2d(u, v)).norm(), 0, 1e-9);
        EXPECT_NEAR((*back - ray).norm(), 0, 1e-7);
        beyond += ray.z() < 0 ? 1 : 0;
      }
    }
    EXPECT_TRUE(lens != &sphere || beyond > 0) << "it sees more than 180 degrees";
  }
  // UCM is Mei's camera without distortion: xi = alpha / (1 - alpha), and focal lengths divided by 1 - alpha.
  const Lens mei({512, 512, 190 / 0.45, 191 / 0.45, 254.9, 256.9}, {Model::kUnified, {0.55 / 0.45, 0, 0, 0, 0}});
  const Eigen::Vector3d aside = RayAtAngle(80, 20);
  EXPECT_NEAR((*mei.Project(aside) - *unified.Project(aside)).norm(), 0, 1e-9);
  EXPECT_GT((*unified.Project(aside) - *extended.Project(aside)).norm(), 1) << "alpha and beta count";
  EXPECT_REFUSED(Lens(kCamera, {Model::kDoubleSphere, {-1.2, 0.6}}), "up to 0 degrees");
}

TEST(Lens, UndistortedImagesHaveTheResolutionOfTheMiddle) {
  for (const LensDistortion& distortion :
       {LensDistortion{Model::kUnified, {1.5, -0.01, 0, 1e-4, 1e-4}}, LensDistortion{Model::kDoubleSphere, {-0.2, 0.6}},
        LensDistortion{Model::kExtendedUnified, {0.6, 1.1}}, LensDistortion{Model::kEquidistant, {0.1, 0, 0, 0}}}) {
    const Lens lens(kCamera, distortion);
    const Eigen::Vector3d near_axis(1e-4, -2e-4, 1);
    EXPECT_NEAR((*lens.Project(near_axis) - lens.Undistorted().Project(near_axis)).norm(), 0, 1e-5);
  }
}

TEST(WithRadialDistortion, SeesThroughBoth) {
  constexpr double k1 = 0.03, k2 = -0.02;
  const PinholeCamera camera = {160, 120, 130, 128, 81.3, 58.6};
  for (const LensDistortion& distortion :
       {LensDistortion{Model::kNone, {}}, LensDistortion{Model::kBrownConrady, {-0.28, 0.07, 2e-4, 2e-5}},
        LensDistortion{Model::kRational, {0.4, -0.2, 1e-4, -1e-4, 0.01, 0.5, -0.1, 0.02}},
        LensDistortion{Model::kEquidistant, {-0.013, 0.02, -0.012, 0.002}},
        LensDistortion{Model::kUnified, {0.9, -0.1, 0.02, 1e-3, 2e-3}}}) {
    const Lens lens(camera, distortion);
    const Lens both(camera, WithRadialDistortion(lens, k1, k2));
    for (double x = -0.6; x < 0.6; x += 0.1) {
      for (double y = -0.4; y < 0.5; y += 0.1) {
        const double r2 = x * x + y * y, factor = 1 + k1 * r2 + k2 * r2 * r2;
        const auto expected = lens.Project({factor * x, factor * y, 1}), found = both.Project({x, y, 1});
        ASSERT_TRUE(expected && found);
        // The distortion moves pixels by up to 0.7 px. What a model cannot say is less than remap's steps of 1/32 px.
        EXPECT_NEAR((*found - *expected).norm(), 0, 0.02) << static_cast<int>(distortion.model) << " " << x << " " << y;
      }
    }
  }
}

TEST(Lens, PixelsGoBackToTheirRays) {
  for (const LensDistortion& distortion :
       {LensDistortion{Model::kNone, {}}, LensDistortion{Model::kEquidistant, {-0.013, 0.02, -0.012, 0.002}},
        LensDistortion{Model::kUnified, {1.2, -0.1, 0.05, 1e-3, -2e-3}}}) {
    const Lens lens(kCamera, distortion);
    for (double from_axis = 0; from_axis < 90; from_axis += 7) {
      for (double around = 5; around < 360; around += 50) {
        const Eigen::Vector3d ray = RayAtAngle(from_axis, around);
        const auto pixel = lens.Project(ray);
        ASSERT_TRUE(pixel);
        if (!kCamera.Contains(*pixel)) continue;
        const auto back = lens.Unproject(*pixel);
        ASSERT_TRUE(back);
        EXPECT_NEAR((*back - ray).norm(), 0, 1e-7) << from_axis << ' ' << around;
      }
    }
  }
}

TEST(Lens, SeesAsFarAsImageFieldAndModelGo) {
  const LensDistortion fisheye = {Model::kEquidistant, {0, 0, 0, 1e-9}};
  const Lens whole(kCamera, fisheye);
  EXPECT_NEAR(whole.FieldOfView(), 640 / 190.0 / kDeg, 0.01);
  EXPECT_TRUE(whole.Project(RayAtAngle(120, 30)));
  const Lens circle(kCamera, fisheye, 150);
  EXPECT_NEAR(circle.FieldOfView(), 150, 0.01);
  EXPECT_TRUE(circle.Project(RayAtAngle(74.9, 30)));
  EXPECT_FALSE(circle.Project(RayAtAngle(75.1, 30)));
  // theta - theta^3 / 6 grows up to sqrt(2) rad = 81 degrees.
  const LensDistortion ends = {Model::kEquidistant, {-1.0 / 6, 0, 0, 0}};
  EXPECT_TRUE(Lens(kCamera, ends).Project(RayAtAngle(80, 30)));
  EXPECT_FALSE(Lens(kCamera, ends).Project(RayAtAngle(82, 30)));
  EXPECT_FALSE(Lens(kCamera, {Model::kNone, {}}).Project({1, 0, -1}));
  // 1 - 1.5 r^2 is 0 at 0.47: beyond, plumb_bob would show the middle once more.
  const Lens folds({64, 48, 60, 60, 31, 23}, {Model::kBrownConrady, {-0.5, 0, 0, 0}});
  EXPECT_TRUE(folds.Project({0.8, 0, 1}));
  EXPECT_FALSE(folds.Project({0.83, 0, 1}));
}

TEST(Lens, RefusesWhatCannotBe) {
  const LensDistortion ends = {Model::kEquidistant, {-1.0 / 6, 0, 0, 0}};
  EXPECT_REFUSED(Lens(kCamera, ends, 190), "up to 81", "at least 95 degrees (field_of_view)");
  EXPECT_REFUSED(Lens(kCamera, {Model::kEquidistant, {-8, 0, 0, 0}}), "go outwards", "at least 120 px");
  EXPECT_REFUSED(Lens(kCamera, {Model::kBrownConrady, {-0.1, 0, 0, 0}}, 190), "field_of_view of this lens = 190",
                 "[1, 180]");
  EXPECT_REFUSED(Lens(kCamera, {Model::kEquirectangular, {}}), "640x480", "twice as wide as high");
}

/// How many of the faces show a ray.
int NumThatShow(const std::vector<PinholeFace>& faces, const Eigen::Vector3d& ray) {
  int shown = 0;
  for (const PinholeFace& face : faces) {
    const Eigen::Vector3d in_face = face.lens_from_face.transpose() * ray;
    shown += in_face.z() > 0 && face.camera.Contains(face.camera.Project(in_face)) ? 1 : 0;
  }
  return shown;
}

std::vector<std::string> NamesOf(const std::vector<PinholeFace>& faces) {
  std::vector<std::string> names;
  for (const PinholeFace& face : faces) names.push_back(face.name);
  return names;
}

TEST(FacesOf, ALensThatShowsNothingHasNone) {
  for (const double cx : {1e9, -1e9}) {
    EXPECT_REFUSED(FacesOf(Lens({64, 48, 60, 60, cx, 24}, {Model::kNone, {}})),
                   "its lens shows hardly anything of any direction");
  }
}

TEST(FacesOf, ShowAllThatTheLensSees) {
  using ::testing::ElementsAre;
  const LensDistortion fisheye = {Model::kEquidistant, {-0.01, 0.004, -0.001, 1e-4}};
  EXPECT_THAT(NamesOf(FacesOf(Lens({640, 480, 460, 460, 320, 240}, fisheye))), ElementsAre(""));
  EXPECT_EQ(FacesOf(Lens({640, 480, 460, 460, 320, 240}, fisheye)).front().camera.width, 640) << "its own camera";
  const Lens round({480, 480, 145, 145, 239.5, 239.5}, fisheye, 190);
  EXPECT_THAT(NamesOf(FacesOf(round)), ElementsAre("", "left", "right", "up", "down"));
  // 150 degrees across, 94 down: hardly anything lies above and below.
  const Lens flat({640, 400, 244, 244, 319.5, 199.5}, fisheye);
  EXPECT_THAT(NamesOf(FacesOf(flat)), ElementsAre("", "left", "right"));
  const Lens sphere({400, 200, 200 / M_PI, 200 / M_PI, 199.5, 99.5}, {Model::kEquirectangular, {}});
  EXPECT_THAT(NamesOf(FacesOf(sphere)), ElementsAre("", "left", "right", "up", "down", "back"));
  for (const Lens& lens : {round, sphere}) {
    const std::vector<PinholeFace> faces = FacesOf(lens);
    for (double from_axis = 0; from_axis < 180; from_axis += 4) {
      for (double around = 0; around < 360; around += 7) {
        const Eigen::Vector3d ray = RayAtAngle(from_axis, around);
        const auto seen = lens.Project(ray);
        if (!seen || !lens.camera().Contains(*seen)) continue;
        EXPECT_GE(NumThatShow(faces, ray), 1) << from_axis << ' ' << around;
      }
    }
    for (const PinholeFace& face : faces) {
      EXPECT_NEAR(face.lens_from_face.determinant(), 1, 1e-12);
      EXPECT_TRUE((face.lens_from_face * face.lens_from_face.transpose()).isIdentity());
    }
  }
  // "right" looks to the right, "up" against y.
  EXPECT_EQ(FacesOf(round)[2].lens_from_face.col(2), Eigen::Vector3d(1, 0, 0));
  EXPECT_EQ(FacesOf(round)[3].lens_from_face.col(2), Eigen::Vector3d(0, -1, 0));
  // Only the strip that the lens sees, 5 degrees beyond the middle and a little more.
  EXPECT_LT(FacesOf(round)[2].camera.width, 0.65 * FacesOf(round)[0].camera.width);
}

constexpr double kExact = 1e-9;  ///< sums over a few hundred poses in double, values below 100

/// World_from_cam of a camera that walks along a curve and looks about.
RigidTransform OnCurve(int i) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << 0.1 * i, std::sin(0.05 * i), 0.2 * std::cos(0.11 * i);
  pose.rotate(Eigen::AngleAxisd(0.03 * i, Eigen::Vector3d(1, 2, 3).normalized()));
  return pose;
}

RigidTransform OnLine(int i) {
  RigidTransform pose = RigidTransform::Identity();
  pose.translation() << 0.1 * i, 0, 0;
  return pose;
}

Similarity AnySimilarity() {
  Similarity similarity;
  similarity.rigid.translation() << 3, -4, 5;
  similarity.rigid.rotate(Eigen::AngleAxisd(2.5, Eigen::Vector3d(-1, 1, 0.5).normalized()));
  similarity.scale = 1.7;
  return similarity;
}

TEST(Similarity, IsFoundFromPosesAlsoOnAStraightLine) {
  const Similarity expected = AnySimilarity();
  for (const auto& trajectory : {OnCurve, OnLine}) {
    std::vector<PosePair> poses;
    for (int i = 0; i < 8; ++i) poses.push_back({trajectory(i), expected.Moved(trajectory(i))});
    const Similarity found = FitSimilarity(poses);
    EXPECT_NEAR(found.scale, expected.scale, kExact);
    EXPECT_TRUE(found.rigid.isApprox(expected.rigid, kExact));
  }
}

/// Baselines are right, but each step turns the rest of the trajectory by 0.7 degrees.
TEST(Similarity, TakesNoDriftForAScale) {
  std::vector<PosePair> poses = {{OnLine(0), OnLine(0)}};
  for (int i = 1; i < 90; ++i) {
    RigidTransform received = poses.back().to * OnLine(i - 1).inverse() * OnLine(i);
    received.rotate(Eigen::AngleAxisd(0.012, Eigen::Vector3d::UnitZ()));
    poses.push_back({OnLine(i), received});
  }
  // Over four steps the turn shortens baselines by 0.03 %. Least squares of all centres give 0.97.
  EXPECT_NEAR(FitSimilarity(poses).scale, 1, 0.003);
}

TEST(PlaceAlong, PutsEachWorldWhereItsKeyframesWere) {
  std::vector<TrajectoryKeyframe> keyframes;
  for (int i = 0; i < 20; ++i) {
    Similarity received_from_refined = AnySimilarity();
    const uint64_t world = i < 8 ? 4 : 5;
    if (world == 5) received_from_refined.scale = 0.5;
    keyframes.push_back({i, {{world, OnCurve(i), 2}, received_from_refined.Moved(OnCurve(i))}});
  }
  keyframes.push_back({20, {{6, OnCurve(20), 1}, OnCurve(21)}});
  const std::vector<std::optional<Similarity>> placed = PlaceAlong(keyframes);
  ASSERT_EQ(placed.size(), keyframes.size());
  for (size_t i = 0; i < 20; ++i) {
    ASSERT_TRUE(placed[i]);
    EXPECT_TRUE(placed[i]->rigid.isApprox(keyframes[i].poses.received, kExact)) << i;
    EXPECT_NEAR(placed[i]->scale, (i < 8 ? 1.7 : 0.5) / 2, kExact) << "points had been multiplied by 2";
  }
  EXPECT_FALSE(placed[20]) << "one keyframe does not tell where its world lies";
}

/// Faces of a wide image have one centre: they say no more of the trajectory than one of them.
TEST(PlaceAlong, ACaptureOfSeveralKeyframesCountsOnce) {
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.004);
  std::vector<TrajectoryKeyframe> single, faces;
  const Eigen::AngleAxisd aside(1.5, Eigen::Vector3d::UnitY());
  for (int i = 0; i < 200; ++i) {
    RigidTransform refined = OnCurve(i);
    refined.translation() += Eigen::Vector3d(noise(random), noise(random), noise(random));
    const TrajectoryKeyframe front = {i, {{1, refined, 1}, OnCurve(i)}};
    single.push_back(front);
    for (int face = 0; face < 5; ++face) {
      faces.push_back(front);
      faces.back().poses.refined.world_from_cam.rotate(Eigen::AngleAxisd(face * aside.angle(), aside.axis()));
      faces.back().poses.received.rotate(Eigen::AngleAxisd(face * aside.angle(), aside.axis()));
    }
  }
  const auto expected = PlaceAlong(single), placed = PlaceAlong(faces);
  for (size_t i = 0; i < faces.size(); ++i) {
    ASSERT_TRUE(placed[i]);
    EXPECT_EQ(placed[i]->scale, expected[i / 5]->scale);
    EXPECT_EQ(placed[i]->rigid.translation(), expected[i / 5]->rigid.translation());
  }
}

/// What a monocular frontend may do: its scale falls by a fifth and comes back.
TEST(PlaceAlong, KeepsTheFormWhereTheFrontendsScaleWanders) {
  std::vector<TrajectoryKeyframe> keyframes;
  RigidTransform received = OnLine(0);
  for (int i = 0; i < 90; ++i) {
    const double scale = 1 - 0.2 * std::exp(-0.5 * std::pow((i - 45) / 8.0, 2));
    keyframes.push_back({i, {{1, OnLine(i), 1}, received}});
    received.translation() += scale * (OnLine(i + 1).translation() - OnLine(i).translation());
  }
  const std::vector<std::optional<Similarity>> placed = PlaceAlong(keyframes);
  double smallest = 2, largest = 0;
  for (size_t i = 0; i < placed.size(); ++i) {
    ASSERT_TRUE(placed[i]);
    smallest = std::min(smallest, placed[i]->scale);
    largest = std::max(largest, placed[i]->scale);
    // The frontend is a fifth too slow over about 20 keyframes of 0.1: at most 0.4 in all.
    EXPECT_LT((placed[i]->rigid.translation() - keyframes[i].poses.received.translation()).norm(), 0.2);
  }
  // Over all keyframes the frontend is short by 4.5 %. Twice that is left of 20 %.
  EXPECT_LT(largest - smallest, 0.04);
  EXPECT_NEAR(0.5 * (smallest + largest), 0.955, 0.03);
}

const PinholeCamera kVgaCamera = {640, 480, 525.5, 520.25, 311.75, 244.5};

TEST(PinholeCameraTest, ProjectsAsItsMatrixDoes) {
  for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1.5), {-4, 2, 9}, {0, 0, 0.01}}) {
    const Eigen::Vector3d homogeneous = kVgaCamera.K() * point;
    const Eigen::Vector2d pixel = kVgaCamera.Project(point);
    EXPECT_NEAR(pixel.x(), homogeneous.x() / homogeneous.z(), 1e-9);  // double rounding of hundreds of px
    EXPECT_NEAR(pixel.y(), homogeneous.y() / homogeneous.z(), 1e-9);
    EXPECT_NEAR((kVgaCamera.Unproject(pixel, point.z()) - point).norm(), 0, 1e-12);
  }
  EXPECT_NEAR((kVgaCamera.Unproject({7, 8}) - kVgaCamera.K().inverse() * Eigen::Vector3d(7, 8, 1)).norm(), 0, 1e-12);
}

TEST(PinholeCameraTest, ContainsPixelsWhoseRoundedPositionIsInside) {
  EXPECT_TRUE(kVgaCamera.Contains({0, 0}));
  EXPECT_TRUE(kVgaCamera.Contains({-0.5, -0.5}));
  EXPECT_TRUE(kVgaCamera.Contains({639.49, 479.49}));
  EXPECT_FALSE(kVgaCamera.Contains({-0.51, 0}));
  EXPECT_FALSE(kVgaCamera.Contains({0, -0.51}));
  EXPECT_FALSE(kVgaCamera.Contains({639.5, 0}));
  EXPECT_FALSE(kVgaCamera.Contains({0, 479.5}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(kVgaCamera.Contains({nan, 3}));
  EXPECT_FALSE(kVgaCamera.Contains({3, nan}));
}

TEST(PinholeCameraTest, ResizedKeepsWhatEachPixelAreaSees) {
  // With centres at integers, pixel u covers [u - 0.5, u + 0.5]: u -> (u + 0.5) s - 0.5, per axis.
  for (const auto& [width, height] : {std::pair(320, 240), {641, 100}, {1, 1}, {2000, 1500}}) {
    const PinholeCamera resized = kVgaCamera.Resized(width, height);
    EXPECT_EQ(resized.width, width);
    EXPECT_EQ(resized.height, height);
    for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1.5), {-4, 2, 9}, {0, 0, 1}}) {
      const Eigen::Vector2d before = kVgaCamera.Project(point), after = resized.Project(point);
      EXPECT_NEAR(after.x(), (before.x() + 0.5) * width / 640.0 - 0.5, 1e-9);
      EXPECT_NEAR(after.y(), (before.y() + 0.5) * height / 480.0 - 0.5, 1e-9);
    }
  }
}

TEST(PinholeCameraTest, HalvedSeesTheMeansOfTwoByTwoPixels) {
  // Pixel 0 of the halved image covers pixels 0 and 1, whose middle is 0.5: u -> (u - 0.5) / 2, whatever the size.
  for (const auto& [width, height] : {std::pair(640, 480), {641, 483}, {7, 2}}) {
    PinholeCamera camera = kVgaCamera;
    camera.width = width;
    camera.height = height;
    const PinholeCamera halved = camera.Halved();
    EXPECT_EQ(halved.width, width / 2);
    EXPECT_EQ(halved.height, height / 2);
    for (const Eigen::Vector3d& point : {Eigen::Vector3d(0.3, -0.2, 1.5), {-4, 2, 9}, {0, 0, 1}}) {
      const Eigen::Vector2d before = camera.Project(point), after = halved.Project(point);
      EXPECT_NEAR(after.x(), (before.x() - 0.5) / 2, 1e-9);
      EXPECT_NEAR(after.y(), (before.y() - 0.5) / 2, 1e-9);
    }
  }
  // Where nothing is left out it is the camera of the resized image.
  const PinholeCamera halved = kVgaCamera.Halved(), resized = kVgaCamera.Resized(320, 240);
  EXPECT_NEAR(halved.cx, resized.cx, 1e-12);
  EXPECT_NEAR(halved.cy, resized.cy, 1e-12);
  EXPECT_EQ(halved.fx, resized.fx);
  EXPECT_EQ(halved.fy, resized.fy);
}

TEST(InterpolateTest, FollowsASteadyMotionWhicheverFrameMapsToTheOther) {
  RigidTransform start = RigidTransform::Identity(), step = RigidTransform::Identity(),
                 arm = RigidTransform::Identity();
  start.linear() = Eigen::AngleAxisd(2, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  start.translation() = Eigen::Vector3d(512345.6, 5403210.7, 312.4);
  step.linear() = Eigen::AngleAxisd(0.02, Eigen::Vector3d(0.2, 1, 0.3).normalized()).toRotationMatrix();
  step.translation() = Eigen::Vector3d(0.05, -0.02, 0.1);
  arm.linear() = Eigen::AngleAxisd(1, Eigen::Vector3d::UnitX()).toRotationMatrix();
  arm.translation() = Eigen::Vector3d(0.3, 0, -0.1);
  std::vector<RigidTransform> way = {start};
  for (int i = 0; i < 10; ++i) way.push_back(way.back() * step);
  const auto expect_same = [](const RigidTransform& a, const RigidTransform& b) {
    EXPECT_LT((a.matrix() - b.matrix()).cwiseAbs().maxCoeff(), 1e-7);  // some roundings of 1e-9 m, in UTM
  };
  for (int i = 0; i <= 10; ++i) {
    expect_same(Interpolate(way.front(), way.back(), 0.1 * i), way[static_cast<size_t>(i)]);
    expect_same(Interpolate(way.front().inverse(), way.back().inverse(), 0.1 * i),
                way[static_cast<size_t>(i)].inverse());
    expect_same(Interpolate(way.front() * arm, way.back() * arm, 0.1 * i), way[static_cast<size_t>(i)] * arm);
  }
  RigidTransform moved = start;
  moved.translation().x() += 2;
  EXPECT_NEAR(Interpolate(start, moved, 0.25).translation().x(), start.translation().x() + 0.5, 1e-9);
}

}  // namespace
}  // namespace acmp
