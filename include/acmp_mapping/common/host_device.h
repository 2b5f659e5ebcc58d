#pragma once

/// The only file that asks which compiler is at work: functions marked so compile for the host and for CUDA devices
/// from one source.
#ifdef __CUDACC__
#define ACMP_HOST_DEVICE __host__ __device__
#else
#define ACMP_HOST_DEVICE
#endif

/// Before a loop whose body indexes registers on the device: unrolled there, left to the compiler on the host.
#ifdef __CUDA_ARCH__
#define ACMP_UNROLL _Pragma("unroll")
#else
#define ACMP_UNROLL
#endif

namespace acmp {

/// 1 / x to within two units in the last place: one instruction on the device instead of a division's ten.
ACMP_HOST_DEVICE inline float Reciprocal(float x) {
#ifdef __CUDA_ARCH__
  return __fdividef(1.0f, x);
#else
  return 1.0f / x;
#endif
}

}  // namespace acmp
