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
