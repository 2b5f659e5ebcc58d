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

#if CERES_VERSION_MAJOR > 2 || (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 1)

using Manifold = ceres::Manifold;

/// The problem then does not delete the manifolds that it is given.
void KeepManifolds(ceres::Problem::Options* options) { options->manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP; }

#else

/// Gives a LocalParameterization, which Ceres had before 2.1, the interface of ceres::Manifold. These versions know no
/// Minus and do not ask for it.
class Manifold : public ceres::LocalParameterization {
 public:
  virtual int AmbientSize() const = 0;
  virtual int TangentSize() const = 0;
  virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;
  virtual bool Minus(const double* y, const double* x, double* result) const = 0;
  virtual bool MinusJacobian(const double* x, double* jacobian) const = 0;

  int GlobalSize() const final { return AmbientSize(); }
  int LocalSize() const final { return TangentSize(); }
  bool ComputeJacobian(const double* x, double* jacobian) const final { return PlusJacobian(x, jacobian); }
};

void KeepManifolds(ceres::Problem::Options* options) {
  options->local_parameterization_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}

#endif

using PixelErrors = Eigen::Matrix<double, 2, 3>;
constexpr int kPoseSize = 7;  // quaternion x y z w, centre
using PoseMap = Eigen::Map<const Eigen::Quaterniond>;

/// Rotations are turned on the left. Costs give their derivatives with respect to the six local coordinates in the
/// first six columns of seven, so that this is all there is to it.
class PoseManifold : public Manifold {
 public:
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* result) const override {
    Eigen::Map<Eigen::Quaterniond> rotation(result);
    rotation = (RotationAbout(Eigen::Map<const Eigen::Vector3d>(delta)) * PoseMap(x)).normalized();
    for (int i = 0; i < 3; ++i) result[4 + i] = x[4 + i] + delta[3 + i];
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, kPoseSize, 6, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.topRows<6>().setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* result) const override {
    Eigen::Map<Eigen::Vector3d> turned(result);
    turned = RotationVector(PoseMap(y) * PoseMap(x).conjugate());
    for (int i = 0; i < 3; ++i) result[3 + i] = y[4 + i] - x[4 + i];
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, kPoseSize, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.leftCols<6>().setIdentity();
    return true;
  }
};

/// Parameters: the anchor's pose, the view's, the inverse depth, the camera's errors (k1, k2, readout).
class SightingCost : public ceres::SizedCostFunction<2, kPoseSize, kPoseSize, 1, 3> {
 public:
  SightingCost(const PinholeCamera& anchor_camera, const Eigen::Vector2d& anchor_pixel,
               const PixelErrors& anchor_errors, const PinholeCamera& camera, const Eigen::Vector2d& pixel,
               const PixelErrors& errors, double sigma)
      : ray_(anchor_camera.Unproject(anchor_pixel)),
        camera_(camera),
        pixel_(pixel),
        errors_(errors),
        weight_(1 / sigma) {
    ray_errors_.row(0) = anchor_errors.row(0) / anchor_camera.fx;
    ray_errors_.row(1) = anchor_errors.row(1) / anchor_camera.fy;
    ray_errors_.row(2).setZero();
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Matrix3d anchor = PoseMap(parameters[0]).toRotationMatrix();
    const Eigen::Matrix3d view = PoseMap(parameters[1]).toRotationMatrix();
    const Eigen::Map<const Eigen::Vector3d> anchor_centre(parameters[0] + 4), centre(parameters[1] + 4);
    const double inverse_depth = parameters[2][0];
    const Eigen::Map<const Eigen::Vector3d> camera_errors(parameters[3]);
    const Eigen::Vector3d ray = ray_ - ray_errors_ * camera_errors;
    const Eigen::Matrix3d turn = view * anchor.transpose();
    const Eigen::Vector3d moved = view * (anchor_centre - centre);
    const Eigen::Vector3d y = turn * ray + inverse_depth * moved;
    if (!(y.z() > kMinDepthRatio)) return false;
    const double inverse_z = 1 / y.z();
    const Eigen::Vector2d predicted(camera_.fx * y.x() * inverse_z + camera_.cx,
                                    camera_.fy * y.y() * inverse_z + camera_.cy);
    Eigen::Map<Eigen::Vector2d> r(residuals);
    r = weight_ * (predicted + errors_ * camera_errors - pixel_);
    if (!jacobians) return true;
    Eigen::Matrix<double, 2, 3> j;
    j << camera_.fx * inverse_z, 0, -camera_.fx * y.x() * inverse_z * inverse_z, 0, camera_.fy * inverse_z,
        -camera_.fy * y.y() * inverse_z * inverse_z;
    j *= weight_;
    using PoseJacobian = Eigen::Map<Eigen::Matrix<double, 2, kPoseSize, Eigen::RowMajor>>;
    if (jacobians[0]) {
      PoseJacobian a(jacobians[0]);
      a.leftCols<3>() = j * turn * CrossMatrix(ray);
      a.middleCols<3>(3) = inverse_depth * j * view;
      a.col(6).setZero();
    }
    if (jacobians[1]) {
      PoseJacobian v(jacobians[1]);
      v.leftCols<3>() = -j * CrossMatrix(y);
      v.middleCols<3>(3) = -inverse_depth * j * view;
      v.col(6).setZero();
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
  const Eigen::Vector3d ray_;
  Eigen::Matrix3d ray_errors_;
  const PinholeCamera camera_;
  const Eigen::Vector2d pixel_;
  const PixelErrors errors_;
  const double weight_;
};

/// An expected pose. The rotation's derivative is that at zero: corrections are small.
class PosePrior : public ceres::SizedCostFunction<6, kPoseSize> {
 public:
  PosePrior(const ViewPose& pose, double rotation_sigma, double position_sigma)
      : pose_(pose), rotation_weight_(1 / rotation_sigma), position_weight_(1 / position_sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 1>> r(residuals);
    r.head<3>() = rotation_weight_ * RotationVector(PoseMap(parameters[0]) * pose_.rotation.conjugate());
    r.tail<3>() = position_weight_ * (Eigen::Map<const Eigen::Vector3d>(parameters[0] + 4) - pose_.centre);
    if (jacobians && jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 6, kPoseSize, Eigen::RowMajor>> j(jacobians[0]);
      j.setZero();
      for (int i = 0; i < 3; ++i) j(i, i) = rotation_weight_, j(3 + i, 3 + i) = position_weight_;
    }
    return true;
  }

 private:
  const ViewPose pose_;
  const double rotation_weight_, position_weight_;
};

/// An expected motion between two views, in the frame of the first. The rotation's derivative is that at zero.
class MotionPrior : public ceres::SizedCostFunction<6, kPoseSize, kPoseSize> {
 public:
  MotionPrior(const ViewPose& a, const ViewPose& b, double turn_sigma, double move_sigma)
      : turn_(b.rotation * a.rotation.conjugate()),
        move_(a.rotation * (b.centre - a.centre)),
        turn_weight_(1 / turn_sigma),
        move_weight_(1 / move_sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Quaterniond a{PoseMap{parameters[0]}}, b{PoseMap{parameters[1]}};
    const Eigen::Vector3d move = a * (Eigen::Map<const Eigen::Vector3d>(parameters[1] + 4) -
                                      Eigen::Map<const Eigen::Vector3d>(parameters[0] + 4));
    const Eigen::Quaterniond turn = b * a.conjugate();
    Eigen::Map<Eigen::Matrix<double, 6, 1>> r(residuals);
    r.head<3>() = turn_weight_ * RotationVector(turn * turn_.conjugate());
    r.tail<3>() = move_weight_ * (move - move_);
    if (!jacobians) return true;
    using Jacobian = Eigen::Map<Eigen::Matrix<double, 6, kPoseSize, Eigen::RowMajor>>;
    if (jacobians[0]) {
      Jacobian j(jacobians[0]);
      j.setZero();
      j.block<3, 3>(0, 0) = -turn_weight_ * turn.toRotationMatrix();
      j.block<3, 3>(3, 0) = -move_weight_ * CrossMatrix(move);
      j.block<3, 3>(3, 3) = -move_weight_ * a.toRotationMatrix();
    }
    if (jacobians[1]) {
      Jacobian j(jacobians[1]);
      j.setZero();
      j.block<3, 3>(0, 0) = turn_weight_ * Eigen::Matrix3d::Identity();
      j.block<3, 3>(3, 3) = move_weight_ * a.toRotationMatrix();
    }
    return true;
  }

 private:
  const Eigen::Quaterniond turn_;
  const Eigen::Vector3d move_;
  const double turn_weight_, move_weight_;
};

void ToParameters(const ViewPose& pose, double* p) {
  std::copy_n(pose.rotation.coeffs().data(), 4, p);
  std::copy_n(pose.centre.data(), 3, p + 4);
}

ViewPose FromParameters(const double* p) { return {Eigen::Quaterniond(p[3], p[0], p[1], p[2]), {p[4], p[5], p[6]}}; }

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
      ToParameters(bundle_.poses[i], PoseOf(i));
      problem_.AddParameterBlock(PoseOf(i), kPoseSize, &manifold_);
      ordering_->AddElementToGroup(PoseOf(i), 1);
      if (i < fixed_views) {
        problem_.SetParameterBlockConstant(PoseOf(i));
        continue;
      }
      AddPrior<PosePrior>({PoseOf(i)}, bundle_.expected[i], weights.rotation_sigma, weights.position_sigma);
    }
    for (size_t i = fixed_views > 0 ? fixed_views - 1 : 0; i + 1 < bundle_.size(); ++i) {
      AddPrior<MotionPrior>({PoseOf(i), PoseOf(i + 1)}, bundle_.expected[i], bundle_.expected[i + 1],
                            weights.turn_sigma, weights.move_sigma);
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
    for (size_t i = 0; i < bundle_.size(); ++i) bundle_.poses[i] = FromParameters(PoseOf(i));
    camera_ = {camera_errors_[0], camera_errors_[1], camera_errors_[2]};
    return true;
  }

 private:
  double* PoseOf(size_t view) { return &parameters_[kPoseSize * view]; }

  static ceres::Problem::Options KeepOurs() {
    ceres::Problem::Options options;
    KeepManifolds(&options);
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
      const SightingCost& cost =
          sighting_costs_.emplace_back(anchor_camera, landmark->pixel, anchor_errors, bundle_.cameras[view],
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
  PoseManifold manifold_;
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
