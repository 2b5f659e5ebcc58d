#pragma once

#include <math.h>  // as the device's: sinf and cosf outside std

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

/// 1 / x to within two units in the last place, where neither is below 1e-38: one instruction on the device instead of
/// a division's ten.
ACMP_HOST_DEVICE inline float Reciprocal(float x) {
#ifdef __CUDA_ARCH__
  float reciprocal;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(reciprocal) : "f"(x));
  return reciprocal;
#else
  return 1.0f / x;
#endif
}

/// 1 / sqrt(x), as accurate as Reciprocal.
ACMP_HOST_DEVICE inline float ReciprocalSqrt(float x) {
#ifdef __CUDA_ARCH__
  return rsqrtf(x);
#else
  return 1.0f / sqrtf(x);
#endif
}

/// Sine and cosine of |angle| <= 2 pi; on the device to within 1e-6, in two instructions instead of some eighty.
ACMP_HOST_DEVICE inline void SinCos(float angle, float* sine, float* cosine) {
#ifdef __CUDA_ARCH__
  __sincosf(angle, sine, cosine);
#else
  *sine = sinf(angle);
  *cosine = cosf(angle);
#endif
}

/// The smaller and the larger of two numbers; neither is NaN. One instruction each on both (the host's fminf is a
/// call).
ACMP_HOST_DEVICE inline float Smaller(float a, float b) {
#ifdef __CUDA_ARCH__
  return fminf(a, b);
#else
  return b < a ? b : a;
#endif
}
ACMP_HOST_DEVICE inline float Larger(float a, float b) {
#ifdef __CUDA_ARCH__
  return fmaxf(a, b);
#else
  return b < a ? a : b;
#endif
}

/// Loads and stores of words that several threads access at once, where any order of the accesses will do.
template <class T>
ACMP_HOST_DEVICE inline T RelaxedLoad(const T* word) {
#ifdef __CUDA_ARCH__
  return *static_cast<const volatile T*>(word);
#else
  return __atomic_load_n(word, __ATOMIC_RELAXED);
#endif
}
template <class T>
ACMP_HOST_DEVICE inline void RelaxedStore(T* word, T value) {
#ifdef __CUDA_ARCH__
  *static_cast<volatile T*>(word) = value;
#else
  __atomic_store_n(word, value, __ATOMIC_RELAXED);
#endif
}

/// Number of bits that are set.
ACMP_HOST_DEVICE inline int CountBits(unsigned word) {
#ifdef __CUDA_ARCH__
  return __popc(word);
#else
  return __builtin_popcount(word);
#endif
}

}  // namespace acmp
