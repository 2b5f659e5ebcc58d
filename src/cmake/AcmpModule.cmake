# acmp_missing(option what why): an error if the option is ON, else a word that this is built without what it is for.
function(acmp_missing option what why)
  if(${option} STREQUAL "ON")
    message(FATAL_ERROR "${option}=ON, but ${why}")
  endif()
  message(STATUS "acmp_mapping: without ${what}: ${why}")
endfunction()

# acmp_target_warnings(target): the warnings that every target of ours has.
function(acmp_target_warnings target)
  target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:-Wall;-Wextra>)
  if(ACMP_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE $<$<COMPILE_LANGUAGE:CXX>:-Werror>)
  endif()
endfunction()

# acmp_target_defaults(target): warnings, and the headers of all modules: for programs and tests, which no module uses.
function(acmp_target_defaults target)
  acmp_target_warnings(${target})
  target_include_directories(${target} PUBLIC ${PROJECT_SOURCE_DIR}/include)
endfunction()

# acmp_little_optimised(target): where what takes time is in the libraries that it calls: to optimise the templates of ROS,
# CLI11 and nlohmann_json takes as long as all else that is compiled for it.
function(acmp_little_optimised target)
  target_compile_options(${target} PRIVATE $<$<AND:$<CONFIG:Release>,$<COMPILE_LANGUAGE:CXX>>:-O1>)
endfunction()

# acmp_add_module(name SOURCES files... [DEPENDS modules...] [PUBLIC libraries...] [PRIVATE libraries...]): the static
# library acmp_NAME of the sources in src/NAME and the headers in include/acmp_mapping/NAME. It finds its own headers and
# those of the modules it depends on, directly or through others, and no more: an #include that this table of
# dependencies does not allow does not compile. For that each module's headers are linked into a folder of their own.
function(acmp_add_module name)
  cmake_parse_arguments(MODULE "" "" "SOURCES;DEPENDS;PUBLIC;PRIVATE" ${ARGN})
  set(folder ${PROJECT_BINARY_DIR}/modules/${name}/include)
  file(MAKE_DIRECTORY ${folder}/acmp_mapping)
  file(CREATE_LINK ${PROJECT_SOURCE_DIR}/include/acmp_mapping/${name} ${folder}/acmp_mapping/${name} SYMBOLIC)
  list(TRANSFORM MODULE_SOURCES PREPEND ${PROJECT_SOURCE_DIR}/src/${name}/)
  add_library(acmp_${name} STATIC ${MODULE_SOURCES})
  set_property(GLOBAL APPEND PROPERTY ACMP_MODULES acmp_${name})
  acmp_target_warnings(acmp_${name})
  target_include_directories(acmp_${name} PUBLIC ${folder})
  list(TRANSFORM MODULE_DEPENDS PREPEND acmp_)
  target_link_libraries(acmp_${name} PUBLIC ${MODULE_DEPENDS} ${MODULE_PUBLIC} PRIVATE ${MODULE_PRIVATE})
endfunction()
