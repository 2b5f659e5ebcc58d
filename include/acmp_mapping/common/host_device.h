#pragma once

/// The only file that asks which compiler is at work: functions marked so compile for the host and for CUDA devices
/// from one source.
#ifdef __CUDACC__
#define ACMP_HOST_DEVICE __host__ __device__
#define ACMP_UNROLL _Pragma("unroll")
#else
#define ACMP_HOST_DEVICE
#define ACMP_UNROLL
#endif
