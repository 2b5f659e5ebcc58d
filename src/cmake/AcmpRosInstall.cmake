# Installs what a ROS workspace needs at run time.
install(TARGETS acmp_mapping_nodelets LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION})
install(TARGETS dense_mapper_node map_server_node RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
foreach(tool acmp_reconstruct acmp_evaluate acmp_make_bag acmp_check_bag acmp_make_scene
             acmp_benchmark acmp_map_benchmark)
  if(TARGET ${tool})
    install(TARGETS ${tool} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  endif()
endforeach()
install(PROGRAMS scripts/acmp_cluster.py scripts/acmp_cluster.sbatch scripts/convert_calibration.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(FILES nodelet_plugins.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
install(DIRECTORY launch config DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
