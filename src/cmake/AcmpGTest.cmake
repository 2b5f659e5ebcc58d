# GTest::gtest, GTest::gtest_main and GTest::gmock: from GoogleTest's own CMake files, else (Ubuntu 20.04) from its
# libraries and headers.
find_package(GTest CONFIG QUIET)
find_package(Threads REQUIRED)
foreach(library gtest gtest_main gmock)
  if(NOT TARGET GTest::${library})
    find_library(ACMP_LIBRARY_${library} ${library})
    if(NOT ACMP_LIBRARY_${library})
      message(FATAL_ERROR "the tests need GoogleTest: no library ${library} (libgtest-dev, libgmock-dev); "
                          "-DACMP_BUILD_TESTS=OFF builds without them")
    endif()
    add_library(GTest::${library} UNKNOWN IMPORTED)
    set_target_properties(GTest::${library} PROPERTIES IMPORTED_LOCATION ${ACMP_LIBRARY_${library}}
                                                       INTERFACE_LINK_LIBRARIES Threads::Threads)
    if(NOT library STREQUAL "gtest")
      set_property(TARGET GTest::${library} APPEND PROPERTY INTERFACE_LINK_LIBRARIES GTest::gtest)
    endif()
  endif()
endforeach()
