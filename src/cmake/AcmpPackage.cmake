# `cpack` makes a Debian package of what is installed: nodelets, launch files, parameters, messages, tools and the Python
# module, for the release that it runs on. Configure with -DCMAKE_INSTALL_PREFIX=/usr -DCATKIN_BUILD_BINARY_PACKAGE=ON.
set(name acmp-mapping)
if(ACMP_HAVE_CUDA)
  set(name acmp-mapping-cuda)
  set(CPACK_DEBIAN_PACKAGE_CONFLICTS acmp-mapping)
  set(CPACK_DEBIAN_PACKAGE_PROVIDES acmp-mapping)
  set(CPACK_DEBIAN_PACKAGE_REPLACES acmp-mapping)
else()
  set(CPACK_DEBIAN_PACKAGE_CONFLICTS acmp-mapping-cuda)
endif()

# What runs beside the libraries, which dpkg-shlibdeps finds: one list for the package and the README's commands.
file(STRINGS scripts/debian_packages.txt lines)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS scripts/debian_packages.txt)
set(depends python3 python3-numpy)
set(is_wanted FALSE)
foreach(line IN LISTS lines)
  if(line MATCHES "^# ROS: run and look")
    set(is_wanted TRUE)
  elseif(line MATCHES "^[[#]")
    set(is_wanted FALSE)
  elseif(is_wanted)
    string(REGEX MATCHALL "[^ ]+" packages "${line}")
    list(APPEND depends ${packages})
  endif()
endforeach()
list(JOIN depends ", " CPACK_DEBIAN_PACKAGE_DEPENDS)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "python3-pil, rviz")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "colmap, python3-distributed")

# Tools on PATH; rosrun looks in lib/acmp_mapping. The links are made where they lead somewhere: roslib fails at others that
# it finds in a build folder.
install(CODE "file(MAKE_DIRECTORY \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/bin\")
foreach(program ${ACMP_PROGRAMS})
  file(CREATE_LINK ../lib/${PROJECT_NAME}/\${program} \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/bin/\${program}\" SYMBOLIC)
endforeach()")

# Debian's policy: licence and changelog; Python files are compiled where they are installed, and removed with the package.
install(CODE "set(python \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CATKIN_PACKAGE_PYTHON_DESTINATION}\")
file(GLOB_RECURSE folders LIST_DIRECTORIES true \"\${python}/*\")  # folders whatever the pattern
list(FILTER folders INCLUDE REGEX \"/__pycache__$\")
if(folders)
  file(REMOVE_RECURSE \${folders})
endif()")
install(FILES LICENSE DESTINATION share/doc/${name} RENAME copyright)
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/package)
execute_process(COMMAND gzip -9nc ${PROJECT_SOURCE_DIR}/CHANGELOG.rst
                OUTPUT_FILE ${PROJECT_BINARY_DIR}/package/changelog.gz RESULT_VARIABLE gzip_failed)
if(gzip_failed)
  message(FATAL_ERROR "acmp_mapping: gzip of CHANGELOG.rst failed: ${gzip_failed}")
endif()
install(FILES ${PROJECT_BINARY_DIR}/package/changelog.gz DESTINATION share/doc/${name})
file(WRITE ${PROJECT_BINARY_DIR}/package/postinst "#!/bin/sh\nset -e\nif [ \"$1\" = configure ]; then py3compile -p ${name}; fi\n")
file(WRITE ${PROJECT_BINARY_DIR}/package/prerm "#!/bin/sh\nset -e\npy3clean -p ${name}\n")
file(WRITE ${PROJECT_BINARY_DIR}/package/triggers "activate-noawait ldconfig\n")
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${PROJECT_BINARY_DIR}/package/postinst ${PROJECT_BINARY_DIR}/package/prerm
                                       ${PROJECT_BINARY_DIR}/package/triggers)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME ${name})
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_HOMEPAGE "")
set(CPACK_PACKAGE_CONTACT "acmp_mapping maintainers <maintainers@users.noreply.h-seed-21c1a8d1.example>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "online dense mapping for any SLAM frontend (ROS 1)")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION "Planar prior assisted PatchMatch multi-view stereo (ACMP) on CPU or CUDA,
 as nodelets beside a SLAM frontend and as tools for recordings and photographs.")
set(CPACK_STRIP_FILES ON)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
include(CPack)
