#include "bundle.h"

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <utility>

namespace acmp {
namespace {

using PixelErrors = Eigen::Matrix<double, 2, 3>;
constexpr int kPoseSize = 6;  // a turn, and the centre

/// A pose in Ceres' terms: its start turned on the left, by the axis times 2 tan(angle / 2). Corrections are small, so
/// that no manifold is needed.
template <class T>
Eigen::Quaternion<T> RotationOf(const ViewPose& start, const T* pose) {
  const T half(0.5);
  return Eigen::Quaternion<T>(T(1), half * pose[0], half * pose[1], half * pose[2]).normalized() *
         start.rotation.cast<T>();
}

/// The small turn on the left of such a rotation, as axis times angle, by its three numbers.
Eigen::Matrix3d TurnsOf(const double* pose) {
  const Eigen::Vector3d half = 0.5 * Eigen::Map<const Eigen::Vector3d>(pose);
  return (Eigen::Matrix3d::Identity() + CrossMatrix(half)) / (1 + half.squaredNorm());
}

/// Parameters: the anchor's pose, the view's, the inverse depth, the camera's errors (k1, k2, readout).
class SightingCost : public ceres::SizedCostFunction<2, kPoseSize, kPoseSize, 1, 3> {
 public:
  /// @param anchor, view where the poses start; outlive it
  SightingCost(const ViewPose& anchor, const PinholeCamera& anchor_camera, const Eigen::Vector2d& anchor_pixel,
               const PixelErrors& anchor_errors, const ViewPose& view, const PinholeCamera& camera,
               const Eigen::Vector2d& pixel, const PixelErrors& errors, double sigma)
      : anchor_(anchor),
        view_(view),
        ray_(anchor_camera.Unproject(anchor_pixel)),
        camera_(camera),
        pixel_(pixel),
        errors_(errors),
        weight_(1 / sigma) {
    ray_errors_.row(0) = anchor_errors.row(0) / anchor_camera.fx;
    ray_errors_.row(1) = anchor_errors.row(1) / anchor_camera.fy;
    ray_errors_.row(2).setZero();
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Matrix3d anchor = RotationOf(anchor_, parameters[0]).toRotationMatrix();
    const Eigen::Matrix3d view = RotationOf(view_, parameters[1]).toRotationMatrix();
    const Eigen::Map<const Eigen::Vector3d> anchor_centre(parameters[0] + 3), centre(parameters[1] + 3);
    const double inverse_depth = parameters[2][0];
    const Eigen::Map<const Eigen::Vector3d> camera_errors(parameters[3]);
    const Eigen::Vector3d ray = ray_ - ray_errors_ * camera_errors;
    const Eigen::Matrix3d turn = view * anchor.transpose();
    const Eigen::Vector3d moved = view * (anchor_centre - centre);
    const Eigen::Vector3d y = turn * ray + inverse_depth * moved;
    if (!(y.z() > kMinDepthRatio)) return false;
    Eigen::Map<Eigen::Vector2d> r(residuals);
    r = weight_ * (camera_.Project(y) + errors_ * camera_errors - pixel_);
    if (!jacobians) return true;
    const Eigen::Matrix<double, 2, 3> j = weight_ * ProjectionJacobian(camera_, y);
    using PoseJacobian = Eigen::Map<Eigen::Matrix<double, 2, kPoseSize, Eigen::RowMajor>>;
    if (jacobians[0]) {
      PoseJacobian a(jacobians[0]);
      a << j * turn * CrossMatrix(ray) * TurnsOf(parameters[0]), inverse_depth * j * view;
    }
    if (jacobians[1]) {
      PoseJacobian v(jacobians[1]);
      v << -j * CrossMatrix(y) * TurnsOf(parameters[1]), -inverse_depth * j * view;
    }
    if (jacobians[2]) {
      Eigen::Map<Eigen::Vector2d> d(jacobians[2]);
      d = j * moved;
    }
    if (jacobians[3]) {
      Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> e(jacobians[3]);
      e = weight_ * errors_ - j * turn * ray_errors_;
    }
    return true;
  }

  /// Smallest z in the view over z in the anchor: nearer to its plane no projection is of use.
  static constexpr double kMinDepthRatio = 1e-2;

 private:
  const ViewPose &anchor_, &view_;
  const Eigen::Vector3d ray_;
  Eigen::Matrix3d ray_errors_;
  const PinholeCamera camera_;
  const Eigen::Vector2d pixel_;
  const PixelErrors errors_;
  const double weight_;
};

/// An expected motion between two views, in the frame of the first.
struct MotionPrior {
  const ViewPose &start_a, &start_b;  ///< outlive it
  const Eigen::Quaterniond turn;
  const Eigen::Vector3d move;
  const double turn_sigma, move_sigma;

  template <class T>
  bool operator()(const T* pose_a, const T* pose_b, T* residuals) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    const Eigen::Quaternion<T> a = RotationOf(start_a, pose_a), b = RotationOf(start_b, pose_b);
    const Eigen::Quaternion<T> error = b * a.conjugate() * turn.conjugate().cast<T>();
    const Vector3 moved = a * (Eigen::Map<const Vector3>(pose_b + 3) - Eigen::Map<const Vector3>(pose_a + 3));
    const T twice(error.w() < T(0) ? -2 : 2);  // of the sine of half the angle: the angle, as errors are small
    Eigen::Map<Eigen::Matrix<T, 6, 1>> r(residuals);
    r << error.vec() * (twice / turn_sigma), (moved - move.cast<T>()) / T(move_sigma);
    return true;
  }
};

/// The problem in Ceres' terms; keeps what it points to.
class Adjustment {
 public:
  Adjustment(const BundleWeights& weights, size_t fixed_views, Bundle* bundle, CameraErrors* camera)
      : weights_(weights),
        fixed_views_(fixed_views),
        bundle_(*bundle),
        camera_(*camera),
        parameters_(kPoseSize * bundle->size() + 3),
        camera_errors_(&parameters_[kPoseSize * bundle->size()]),
        problem_(KeepOurs()) {
    for (size_t i = 0; i < bundle_.size(); ++i) {
      const ViewPose &start = bundle_.poses[i], &expected = bundle_.expected[i];
      std::copy_n(start.centre.data(), 3, PoseOf(i) + 3);
      problem_.AddParameterBlock(PoseOf(i), kPoseSize);
      ordering_->AddElementToGroup(PoseOf(i), 1);
      if (i < fixed_views) {
        problem_.SetParameterBlockConstant(PoseOf(i));
        continue;
      }
      Eigen::Matrix<double, kPoseSize, 1> nearest, pose_weights;  // turns are small: they add up
      nearest << RotationVector(expected.rotation * start.rotation.conjugate()), expected.centre;
      pose_weights << Eigen::Vector3d::Constant(1 / weights.rotation_sigma),
          Eigen::Vector3d::Constant(1 / weights.position_sigma);
      AddPrior<ceres::NormalPrior>({PoseOf(i)}, pose_weights.asDiagonal(), nearest);
    }
    for (size_t i = fixed_views > 0 ? fixed_views - 1 : 0; i + 1 < bundle_.size(); ++i) {
      const ViewPose &a = bundle_.expected[i], &b = bundle_.expected[i + 1];
      using Cost = ceres::AutoDiffCostFunction<MotionPrior, 6, kPoseSize, kPoseSize>;
      AddPrior<Cost>({PoseOf(i), PoseOf(i + 1)},
                     new MotionPrior{bundle_.poses[i], bundle_.poses[i + 1], b.rotation * a.rotation.conjugate(),
                                     a.rotation * (b.centre - a.centre), weights.turn_sigma, weights.move_sigma});
    }
    const Eigen::Vector3d camera_errors = ToVector(camera_);
    std::copy_n(camera_errors.data(), 3, camera_errors_);
    problem_.AddParameterBlock(camera_errors_, 3);
    ordering_->AddElementToGroup(camera_errors_, 1);
    const Eigen::Vector3d camera_weights = ToVector(weights.camera_sigma).cwiseInverse();
    AddPrior<ceres::NormalPrior>({camera_errors_}, camera_weights.asDiagonal(), camera_errors);
    const std::vector<CameraMotion> motions = MotionsOf(bundle_);
    for (Landmark& landmark : bundle_.landmarks) {
      if (!landmark.held_out && IsSeenFrom(landmark, fixed_views)) AddSightings(motions, &landmark);
    }
  }

  bool Solve(int max_iterations) {
    ceres::Solver::Options options;
    constexpr size_t kMaxDense = 40;  // views; more: sparse Cholesky of the reduced system
    options.linear_solver_type = bundle_.size() <= kMaxDense ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
    options.linear_solver_ordering = ordering_;
    options.max_num_iterations = max_iterations;
    options.num_threads = 1;
    options.function_tolerance = 1e-4;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    if (!summary.IsSolutionUsable()) return false;
    for (size_t i = 0; i < bundle_.size(); ++i) {
      bundle_.poses[i] = {RotationOf(bundle_.poses[i], PoseOf(i)), Eigen::Vector3d(PoseOf(i) + 3)};
    }
    camera_ = {camera_errors_[0], camera_errors_[1], camera_errors_[2]};
    return true;
  }

 private:
  double* PoseOf(size_t view) { return &parameters_[kPoseSize * view]; }

  static ceres::Problem::Options KeepOurs() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;  // thousands, one by one
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;  // of duplicate parameters, per residual
    return options;
  }

  template <class Prior, class... Arguments>
  void AddPrior(const std::vector<double*>& parameters, Arguments&&... arguments) {
    priors_.push_back(std::make_unique<Prior>(std::forward<Arguments>(arguments)...));
    problem_.AddResidualBlock(priors_.back().get(), nullptr, parameters);
  }

  /// Whether a view from `first` on sees it. What only fixed views see has its depth from them already.
  static bool IsSeenFrom(const Landmark& landmark, size_t first) {
    const auto is_late = [first](int view) { return static_cast<size_t>(view) >= first; };
    return is_late(landmark.anchor) || std::any_of(landmark.sightings.begin(), landmark.sightings.end(),
                                                   [&](const Sighting& s) { return is_late(s.view); });
  }

  void AddSightings(const std::vector<CameraMotion>& motions, Landmark* landmark) {
    const auto anchor = static_cast<size_t>(landmark->anchor);
    const PinholeCamera& anchor_camera = bundle_.cameras[anchor];
    const Eigen::Vector3d ray = anchor_camera.Unproject(landmark->pixel);
    const PixelErrors anchor_errors =
        PixelErrorsAt(bundle_, motions, anchor, landmark->pixel, ray, landmark->inverse_depth);
    bool added = false;
    double information = 0, gradient = 0;  // of the inverse depth, from fixed views
    for (const Sighting& sighting : landmark->sightings) {
      const auto view = static_cast<size_t>(sighting.view);
      const Eigen::Vector3d y =
          DirectionInView(ray, landmark->inverse_depth, bundle_.poses[anchor], bundle_.poses[view]);
      if (!(y.z() > 2 * SightingCost::kMinDepthRatio)) continue;
      const PixelErrors errors = PixelErrorsAt(bundle_, motions, view, sighting.pixel, y, landmark->inverse_depth);
      const SightingCost& cost = sighting_costs_.emplace_back(bundle_.poses[anchor], anchor_camera, landmark->pixel,
                                                              anchor_errors, bundle_.poses[view], bundle_.cameras[view],
                                                              sighting.pixel, errors, weights_.pixel_sigma);
      double *const from = PoseOf(anchor), *const to = PoseOf(view);
      if (std::max(anchor, view) < fixed_views_) {
        const double* const parameters[] = {from, to, &landmark->inverse_depth, camera_errors_};
        AddToDepth(cost, parameters, &information, &gradient);
        sighting_costs_.pop_back();
        continue;
      }
      problem_.AddResidualBlock(&sighting_costs_.back(), &loss_, from, to, &landmark->inverse_depth, camera_errors_);
      added = true;
    }
    if (added && information > 0) {  // what fixed views tell of the depth: linear about the depth known so far
      using Scalar = Eigen::Matrix<double, 1, 1>;
      AddPrior<ceres::NormalPrior>({&landmark->inverse_depth}, Scalar(std::sqrt(information)),
                                   Scalar(landmark->inverse_depth - gradient / information));
    }
    if (added) ordering_->AddElementToGroup(&landmark->inverse_depth, 0);
  }

  /// Adds J^T J and J^T r of a sighting with respect to the inverse depth, weighted by the loss.
  void AddToDepth(const SightingCost& cost, const double* const* parameters, double* information,
                  double* gradient) const {
    Eigen::Vector2d residual, derivative;
    double* jacobians[] = {nullptr, nullptr, derivative.data(), nullptr};
    if (!cost.Evaluate(parameters, residual.data(), jacobians)) return;
    double loss[3];
    loss_.Evaluate(residual.squaredNorm(), loss);
    *information += loss[1] * derivative.squaredNorm();
    *gradient += loss[1] * derivative.dot(residual);
  }

  const BundleWeights& weights_;
  const size_t fixed_views_;
  Bundle& bundle_;
  CameraErrors& camera_;
  std::vector<double> parameters_;  ///< poses, then the camera's errors: Ceres orders what is in one group by address
  double* const camera_errors_;
  ceres::CauchyLoss loss_{1.0};
  std::deque<SightingCost> sighting_costs_;  // stay where they are while more come
  std::vector<std::unique_ptr<ceres::CostFunction>> priors_;
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering_ = std::make_shared<ceres::ParameterBlockOrdering>();
  ceres::Problem problem_;
};

}  // namespace

bool AdjustBundle(const BundleWeights& weights, int max_iterations, size_t fixed_views, Bundle* bundle,
                  CameraErrors* camera) {
  return Adjustment(weights, fixed_views, bundle, camera).Solve(max_iterations);
}

}  // namespace acmp
