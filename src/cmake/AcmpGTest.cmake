# GTest::gtest, GTest::gtest_main and GTest::gmock: from GoogleTest's own CMake files; else those that catkin builds; else
# (Ubuntu 20.04) of its libraries.
if(NOT TARGET GTest::gtest)  # catkin may have defined it, and that alone
  find_package(GTest CONFIG QUIET)
endif()
find_package(Threads REQUIRED)
foreach(library gtest gtest_main gmock)
  if(NOT TARGET GTest::${library})
    set(imported TRUE)  # those of catkin may have lists of names as their file
    if(TARGET ${library})
      get_target_property(imported ${library} IMPORTED)
    endif()
    if(imported)
      find_library(ACMP_LIBRARY_${library} ${library})
    else()
      set(ACMP_LIBRARY_${library} ${library})
    endif()
    if(NOT ACMP_LIBRARY_${library})
      message(FATAL_ERROR "the tests need GoogleTest: no library ${library} (libgtest-dev, libgmock-dev); "
                          "-DACMP_BUILD_TESTS=OFF builds without them")
    endif()
    add_library(GTest::${library} INTERFACE IMPORTED)
    set_property(TARGET GTest::${library} PROPERTY INTERFACE_LINK_LIBRARIES ${ACMP_LIBRARY_${library}} Threads::Threads)
    if(NOT library STREQUAL "gtest")
      set_property(TARGET GTest::${library} APPEND PROPERTY INTERFACE_LINK_LIBRARIES GTest::gtest)
    endif()
  endif()
endforeach()
