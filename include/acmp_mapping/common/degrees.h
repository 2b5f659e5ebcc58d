#pragma once

namespace acmp {

template <class Scalar>
constexpr Scalar kRadPerDeg = static_cast<Scalar>(0.017453292519943295769);

}  // namespace acmp
