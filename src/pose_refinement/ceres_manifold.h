#pragma once

#include <ceres/ceres.h>

namespace acmp {

#if CERES_VERSION_MAJOR > 2 || (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 1)

using Manifold = ceres::Manifold;

/// The problem then does not delete the manifolds that it is given.
inline void KeepManifolds(ceres::Problem::Options* options) {
  options->manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}

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

inline void KeepManifolds(ceres::Problem::Options* options) {
  options->local_parameterization_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}

#endif

}  // namespace acmp
