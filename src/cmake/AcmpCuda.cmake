# Sets ACMP_HAVE_CUDA and enables the CUDA language when asked for and present.
set(ACMP_HAVE_CUDA FALSE)
if(NOT ACMP_CUDA STREQUAL "OFF")
  include(CheckLanguage)
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    # Real code for each generation from Turing on, and PTX of the last one ("90" alone means both) for whatever comes
    # later: a missing architecture would otherwise show up as empty maps at run time.
    set(ACMP_CUDA_ARCHITECTURES "75-real;80-real;86-real;89-real;90"
        CACHE STRING "GPU architectures of the CUDA backend (see CMAKE_CUDA_ARCHITECTURES)")
    set(CMAKE_CUDA_ARCHITECTURES ${ACMP_CUDA_ARCHITECTURES})
    enable_language(CUDA)
    set(CMAKE_CUDA_STANDARD 17)
    set(CMAKE_CUDA_STANDARD_REQUIRED ON)
    find_package(CUDAToolkit REQUIRED)
    set(ACMP_HAVE_CUDA TRUE)
  elseif(ACMP_CUDA STREQUAL "ON")
    message(FATAL_ERROR "ACMP_CUDA=ON but no CUDA compiler was found; set CUDACXX to nvcc's path")
  endif()
endif()
