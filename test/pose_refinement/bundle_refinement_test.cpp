#include "bundle_refinement.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/mman.h>

#include "pose_scene.h"

namespace acmp {
namespace {

constexpr double kInterval = 0.1;  // s from view to view

/// A bundle without images: a hand-held camera sees random points through a rolling shutter and a lens.
class BundleRefinementTest : public ::testing::Test {
 protected:
  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(random_() - random_.min()) / (random_.max() - random_.min());
  }

  ViewPose PoseAt(double t) const {
    ViewPose pose;
    pose.rotation = RotationAbout({0.12 * std::sin(3.1 * t), 0.25 * std::sin(2.3 * t + 1), 0.15 * std::sin(2.7 * t)});
    pose.centre = {0.8 * t, 0.1 * std::sin(4 * t), 0.06 * std::cos(3 * t)};
    return pose;
  }

  /// Where a camera with errors sees a point: the row that sees it decides when.
  Eigen::Vector2d See(const Eigen::Vector3d& point, double t, const CameraErrors& errors) const {
    double row = camera_.cy;
    Eigen::Vector2d pixel;
    for (int i = 0; i < 10; ++i) {
      const ViewPose pose = PoseAt(t + errors.readout * ((row + 0.5) / camera_.height - 0.5));
      const Eigen::Vector3d y = pose.rotation * (point - pose.centre);
      const Eigen::Vector2d x = y.head<2>() / y.z();
      const double r2 = x.squaredNorm(), factor = 1 + errors.k1 * r2 + errors.k2 * r2 * r2;
      pixel = {camera_.fx * factor * x.x() + camera_.cx, camera_.fy * factor * x.y() + camera_.cy};
      row = pixel.y();
    }
    return pixel;
  }

  Bundle MakeBundle(const CameraErrors& errors, double rotation_error, double position_error) {
    Bundle bundle;
    constexpr int kViews = 12;
    PoseErrors pose_errors(rotation_error * 180 / M_PI, position_error);
    for (int i = 0; i < kViews; ++i) {
      truth_.push_back(PoseAt(kInterval * i));
      bundle.Add(i, kInterval * i, camera_, pose_errors.Perturbed(ToRigidTransform(truth_.back())));
    }
    bundle.expected = bundle.received;
    for (int anchor = 0; anchor < kViews; ++anchor) {
      for (int k = 0; k < 60; ++k) {
        const ViewPose& pose = truth_[static_cast<size_t>(anchor)];
        // One draw after the other: compilers take arguments in an order of their own.
        const double row = Uniform(10, camera_.height - 10);
        const Eigen::Vector2d where(Uniform(10, camera_.width - 10), row);
        const double depth = Uniform(1.2, 5);
        const Eigen::Vector3d point = pose.rotation.conjugate() * camera_.Unproject(where, depth) + pose.centre;
        Landmark landmark;
        landmark.anchor = anchor;
        landmark.pixel = See(point, kInterval * anchor, errors);
        landmark.held_out = k % 5 == 0;
        for (int view = std::max(0, anchor - 5); view <= std::min(kViews - 1, anchor + 5); ++view) {
          if (view == anchor) continue;
          const Eigen::Vector2d pixel = See(point, kInterval * view, errors);
          if (!camera_.Contains(pixel)) continue;
          const double row_error = Uniform(-0.2, 0.2);
          landmark.sightings.push_back({view, pixel + Eigen::Vector2d(Uniform(-0.2, 0.2), row_error)});
        }
        if (landmark.sightings.size() < 2) continue;
        landmark.inverse_depth = 1 / 2.5;
        Triangulate(bundle.poses, bundle.cameras, &landmark);
        if (!(landmark.inverse_depth > 0)) continue;
        bundle.landmarks.push_back(landmark);
        true_inverse_depths_.push_back(1 / depth);
      }
    }
    return bundle;
  }

  /// Median relative error of the held-out landmarks' depths, triangulated with these poses.
  double DepthError(const Bundle& bundle, const std::vector<ViewPose>& poses) const {
    std::vector<double> ratios;
    for (size_t i = 0; i < bundle.landmarks.size(); ++i) {
      Landmark landmark = bundle.landmarks[i];
      if (!landmark.held_out) continue;
      Triangulate(poses, bundle.cameras, &landmark);
      ratios.push_back(landmark.inverse_depth / true_inverse_depths_[i]);
    }
    const auto median = [](std::vector<double> v) {
      std::sort(v.begin(), v.end());
      return v[v.size() / 2];
    };
    const double scale = median(ratios);
    for (double& ratio : ratios) ratio = std::abs(ratio / scale - 1);
    return median(ratios);
  }

  const PinholeCamera camera_ = {540, 360, 495, 495, 269.5, 169};
  std::vector<ViewPose> truth_;
  std::vector<double> true_inverse_depths_;  ///< of the landmarks
  std::minstd_rand random_{3};
};

TEST_F(BundleRefinementTest, AViewWithoutLandmarksMovesWithItsNeighbours) {
  Bundle bundle = MakeBundle({}, 0.0005, 0.002);
  constexpr int kBlank = 6;
  const auto sees = [](const Landmark& l) { return l.anchor == kBlank; };
  auto& landmarks = bundle.landmarks;
  landmarks.erase(std::remove_if(landmarks.begin(), landmarks.end(), sees), landmarks.end());
  for (Landmark& landmark : landmarks) {
    auto& s = landmark.sightings;
    s.erase(std::remove_if(s.begin(), s.end(), [](const Sighting& x) { return x.view == kBlank; }), s.end());
  }
  const Eigen::Vector3d drift(0.03, -0.02, 0.01);  // grows from view to view
  for (size_t i = 0; i < bundle.size(); ++i) bundle.received[i].centre += static_cast<double>(i) * drift;
  bundle.poses = bundle.expected = bundle.received;
  for (Landmark& landmark : landmarks) Triangulate(bundle.poses, bundle.cameras, &landmark);
  RefinementState state;
  ASSERT_TRUE(RefineBundle(3, 30, 0, &bundle, &state));
  const auto moved = [&](size_t i) -> Eigen::Vector3d { return bundle.poses[i].centre - bundle.received[i].centre; };
  const Eigen::Vector3d around = (moved(kBlank - 1) + moved(kBlank + 1)) / 2;
  EXPECT_LT((moved(kBlank) - around).norm(), 0.01);
}

/// Calls it in a thread whose stack lies below the heap, where stacks usually lie above it. False where that cannot be.
bool CallOnLowStack(std::function<void()> work) {
  constexpr size_t kBytes = 8 << 20;
  void* const low = reinterpret_cast<void*>(size_t{1} << 24);
  void* const stack = ::mmap(low, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_STACK, -1, 0);
  if (stack == MAP_FAILED) return false;
  pthread_attr_t attributes;
  pthread_t thread;
  const auto call = [](void* function) -> void* {
    (*static_cast<std::function<void()>*>(function))();
    return nullptr;
  };
  const bool called = stack == low && pthread_attr_init(&attributes) == 0 &&
                      pthread_attr_setstack(&attributes, stack, kBytes) == 0 &&
                      pthread_create(&thread, &attributes, call, &work) == 0 && pthread_join(thread, nullptr) == 0;
  ::munmap(stack, kBytes);
  return called;
}

/// Ceres orders what it eliminates by address.
TEST_F(BundleRefinementTest, PosesDoNotDependOnWhereMemoryLies) {
  Bundle bundle = MakeBundle({0.04, -0.05, 0.012}, 0.003, 0.008), again = bundle;
  RefinementState state, state_again;
  ASSERT_TRUE(RefineBundle(3, 30, 0, &bundle, &state));
  if (!CallOnLowStack([&] { EXPECT_TRUE(RefineBundle(3, 30, 0, &again, &state_again)); })) {
    GTEST_SKIP() << "low addresses are taken";
  }
  for (size_t i = 0; i < bundle.size(); ++i) {
    EXPECT_EQ(bundle.poses[i].centre, again.poses[i].centre) << i;
    EXPECT_EQ(bundle.poses[i].rotation.coeffs(), again.poses[i].rotation.coeffs()) << i;
  }
}

// What fixed views tell of the depths is not lost: it places the one view that is free.
TEST_F(BundleRefinementTest, FixedViewsPlaceTheFreeOne) {
  Bundle bundle = MakeBundle({}, 0.01, 0.03);
  const size_t fixed = bundle.size() - 1;
  std::copy_n(truth_.begin(), fixed, bundle.poses.begin());
  bundle.expected = bundle.poses;
  bundle.expected[fixed].centre += Eigen::Vector3d(0.03, 0, -0.03);
  for (Landmark& landmark : bundle.landmarks) Triangulate(bundle.poses, bundle.cameras, &landmark);
  BundleWeights weights;
  weights.camera_sigma = {0.1, 0.1, 0.1};
  CameraErrors camera;
  ASSERT_TRUE(AdjustBundle(weights, 30, fixed, &bundle, &camera));
  for (size_t i = 0; i < fixed; ++i) {
    EXPECT_EQ(bundle.poses[i].centre, truth_[i].centre);
    EXPECT_EQ(bundle.poses[i].rotation.coeffs(), truth_[i].rotation.coeffs());
  }
  // Noise of 0.1 px in some hundred sightings gives a tenth of a millimetre. With depths from this view alone: 0.28.
  EXPECT_LT((bundle.poses[fixed].centre - truth_[fixed].centre).norm(), 0.0002);
}

// A bundle adjustment that knows nothing of the camera's errors explains them by the scene. The resected poses give
// whoever triangulates the pixels as they are better depths, at the scale that fits best.
TEST_F(BundleRefinementTest, ResectedPosesGiveBetterDepthsThanAPlainBundleAdjustment) {
  const CameraErrors errors = {0.04, -0.05, 0.012};
  Bundle bundle = MakeBundle(errors, 0.003, 0.008);
  Bundle plain_bundle = bundle;
  RefinementState state;
  ASSERT_TRUE(RefineBundle(3, 30, 0, &bundle, &state));
  EXPECT_NEAR(state.camera.readout, errors.readout, 0.002);
  EXPECT_NEAR(state.camera.k1, errors.k1, 0.02);
  BundleWeights weights = state.weights;
  weights.camera_sigma = {1e-9, 1e-9, 1e-9};
  CameraErrors none;
  ASSERT_TRUE(AdjustBundle(weights, 60, 0, &plain_bundle, &none));
  const double error = DepthError(bundle, ResectViews(bundle, state.camera));
  EXPECT_LT(error, DepthError(bundle, bundle.received) / 3);
  EXPECT_LT(error, 0.8 * DepthError(bundle, plain_bundle.poses));
}

/// One exact pose, and refined ones that differ by noise: the scale between them is one noise over another.
TEST_F(BundleRefinementTest, LaterWindowsUndoThatPosesAreBent) {
  RefinementState state;
  const auto add = [&](double to_pinhole, double to_camera) {
    ModelComparison& sums = state.comparison;
    ++sums.bundles;
    sums.sightings += 1500;
    sums.pinhole_cost += 110;
    sums.camera_cost += 100;
    sums.to_pinhole += to_pinhole;
    sums.to_camera += to_camera;
    state.bent = AreBentByWindows(state);
  };
  for (int i = 0; i < 2; ++i) add(0.002, 0.008);
  EXPECT_TRUE(state.bent);
  add(0.008, 0.008);
  EXPECT_TRUE(state.bent) << "the sums still say so, though less clearly than it was asked at first";
  for (int i = 0; i < 4; ++i) add(0.008, 0.008);
  EXPECT_FALSE(state.bent);
  add(0.002, 0.008);
  EXPECT_FALSE(state.bent);
}

TEST_F(BundleRefinementTest, ACameraThatStandsContradictsNothing) {
  Bundle bundle = MakeBundle({}, 0, 0);
  const ViewPose still = bundle.received.back();
  for (const double noise : {0.0, 1e-4}) {  // of received poses
    for (size_t i = bundle.size() - kContradictionImages; i < bundle.size(); ++i) {
      bundle.received[i] = bundle.poses[i] = still;
      bundle.received[i].centre += noise * Eigen::Vector3d(Uniform(-1, 1), Uniform(-1, 1), Uniform(-1, 1));
      bundle.poses[i].centre += 1e-3 * Eigen::Vector3d(Uniform(-1, 1), Uniform(-1, 1), Uniform(-1, 1));
    }
    ASSERT_TRUE(MeasureContradiction(bundle, 1));
    EXPECT_LT(*MeasureContradiction(bundle, 1), 0.002) << noise;
  }
  const Bundle stands = [&] {
    Bundle all = bundle;
    std::fill(all.received.begin(), all.received.end(), still);
    return all;
  }();
  EXPECT_FALSE(MeasureContradiction(stands, 1)) << "without a baseline landmarks have no depth";
  bundle.poses = truth_;  // and where the images say that it moved, the frontend has lost track
  EXPECT_GT(*MeasureContradiction(bundle, 1), 0.03);
}

}  // namespace
}  // namespace acmp
