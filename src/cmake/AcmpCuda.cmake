# Sets ACMP_HAVE_CUDA and enables the CUDA language when asked for and present.

set(ACMP_HAVE_CUDA FALSE)
if(NOT ACMP_CUDA STREQUAL "OFF")
  include(CheckLanguage)
  if(NOT CMAKE_CUDA_COMPILER)
    unset(CMAKE_CUDA_COMPILER CACHE)  # of an earlier look: one may have been installed since
  endif()
  check_language(CUDA)
  if(NOT CMAKE_CUDA_COMPILER)
    # What a compiler that is there says of an empty file: check_language keeps it to itself.
    set(reason "no CUDA compiler was found; set CUDACXX to nvcc's path")
    find_program(ACMP_NVCC NAMES "$ENV{CUDACXX}" nvcc PATHS /usr/local/cuda/bin)
    if(ACMP_NVCC)
      set(host "")
      if(NOT "$ENV{CUDAHOSTCXX}" STREQUAL "")
        set(host -ccbin "$ENV{CUDAHOSTCXX}")
      endif()
      file(WRITE ${CMAKE_BINARY_DIR}/CMakeFiles/empty.cu "")
      execute_process(COMMAND ${ACMP_NVCC} ${host} -c ${CMAKE_BINARY_DIR}/CMakeFiles/empty.cu -o ${CMAKE_BINARY_DIR}/CMakeFiles/empty.o
                      OUTPUT_VARIABLE output ERROR_VARIABLE output RESULT_VARIABLE failed)
      string(REGEX MATCH "[^\n]*(error|unsupported|cannot|not found)[^\n]*" line "${output}")
      string(STRIP "${line}" line)
      set(reason "${ACMP_NVCC} is there, and cannot be used: ${line} (exit code ${failed}); set CUDAHOSTCXX to a C++ compiler that it takes, or CUDACXX to another one")
    endif()
    unset(ACMP_NVCC CACHE)
    acmp_missing(ACMP_CUDA CUDA "${reason}")
  elseif(CMAKE_VERSION VERSION_LESS 3.18)
    acmp_missing(ACMP_CUDA CUDA "CUDA needs CMake 3.18 or later, this is ${CMAKE_VERSION}")
  else()
    execute_process(COMMAND ${CMAKE_CUDA_COMPILER} --list-gpu-code OUTPUT_VARIABLE codes RESULT_VARIABLE failed)
    string(REGEX MATCHALL "[0-9]+" known "${codes}")
    if(failed OR NOT 87 IN_LIST known)
      acmp_missing(ACMP_CUDA CUDA "${CMAKE_CUDA_COMPILER} is older than CUDA 11.4")
    else()
      # Of what the toolkit knows, real code for each generation from Turing on (a missing one would otherwise show up as
      # empty maps at run time), and PTX of the newest for whatever comes later ("90" alone means both).
      set(architectures "")
      foreach(architecture 75 80 86 87 89 90 100 120)  # 87: Jetson Orin, which runs no code of 86
        if(architecture IN_LIST known)
          list(APPEND architectures ${architecture}-real)
        endif()
      endforeach()
      string(REGEX REPLACE "-real$" "" architectures "${architectures}")
      set(ACMP_CUDA_ARCHITECTURES ${architectures}
          CACHE STRING "GPU architectures of the CUDA backend (see CMAKE_CUDA_ARCHITECTURES)")
      set(CMAKE_CUDA_ARCHITECTURES ${ACMP_CUDA_ARCHITECTURES})
      enable_language(CUDA)
      # The C++ compiler links, with its own C++ library. nvcc may need an older one, whose folder CMake would look in
      # first: what only the newer library has would be missing (Debian 13: g++ 14, and g++ 13 for CUDA 12.4).
      list(FILTER CMAKE_CUDA_IMPLICIT_LINK_DIRECTORIES EXCLUDE REGEX "/lib/gcc/")
      set(CMAKE_CUDA_STANDARD 17)
      set(CMAKE_CUDA_STANDARD_REQUIRED ON)
      find_package(CUDAToolkit REQUIRED)
      set(ACMP_HAVE_CUDA TRUE)
      message(STATUS "acmp_mapping: CUDA ${CMAKE_CUDA_COMPILER_VERSION}, code for ${ACMP_CUDA_ARCHITECTURES}")
    endif()
  endif()
endif()
