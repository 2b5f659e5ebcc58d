# Sets ACMP_HAVE_PYTHON: whether the Python module is built, and ACMP_PYTHON_FOLDER, which PYTHONPATH must name.
set(ACMP_HAVE_PYTHON FALSE)
if(ACMP_HAVE_ROS)
  set(ACMP_PYTHON_FOLDER ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION})
else()
  set(ACMP_PYTHON_FOLDER ${CMAKE_BINARY_DIR}/python)
endif()
if(NOT ACMP_PYTHON STREQUAL "OFF" AND ACMP_HAVE_TOOLS)
  if(EXISTS /usr/bin/python3)  # Debian's, which has numpy, whatever python3 is first on PATH
    set(Python_EXECUTABLE /usr/bin/python3 CACHE FILEPATH "Python of the module")
  endif()
  find_package(Python QUIET COMPONENTS Interpreter Development)  # first: pybind11 takes what is found already
  find_package(pybind11 2.6 QUIET)
  if(pybind11_FOUND AND Python_Development_FOUND)
    set(ACMP_HAVE_PYTHON TRUE)
  elseif(ACMP_PYTHON STREQUAL "ON")
    message(FATAL_ERROR "ACMP_PYTHON=ON, but not found: pybind11 2.6 or later (pybind11-dev, python3-dev)")
  else()
    message(STATUS "acmp_mapping: no pybind11 2.6 or later (pybind11-dev, python3-dev): without the Python module "
                   "acmp_mapping.offline")
  endif()
endif()
