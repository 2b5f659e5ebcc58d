# Installs what a ROS workspace needs at run time.
install(TARGETS acmp_mapping_nodelets LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION})
install(TARGETS dense_mapper_node map_server_node RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
set(ACMP_PROGRAMS acmp_cluster.py)  # for PATH
foreach(tool acmp_reconstruct acmp_evaluate acmp_make_bag acmp_check_bag acmp_make_scene acmp_benchmark)
  if(TARGET ${tool})
    list(APPEND ACMP_PROGRAMS ${tool})
    install(TARGETS ${tool} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  endif()
endforeach()
if(ACMP_HAVE_PYTHON)
  install(TARGETS acmp_python LIBRARY DESTINATION ${CATKIN_PACKAGE_PYTHON_DESTINATION})
  install(FILES src/python/offline.py DESTINATION ${CATKIN_PACKAGE_PYTHON_DESTINATION})
endif()
install(PROGRAMS scripts/acmp_cluster.py scripts/acmp_cluster.sbatch scripts/convert_calibration.py
                 scripts/map_viewer.py scripts/network_node.py scripts/rerun_bridge.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES scripts/untrusted.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES nodelet_plugins.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
install(DIRECTORY launch config DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
