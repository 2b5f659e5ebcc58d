# Installs what a ROS workspace needs at run time.
foreach(tool acmp_reconstruct acmp_evaluate acmp_make_bag acmp_check_bag)
  if(TARGET ${tool})
    install(TARGETS ${tool} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  endif()
endforeach()
install(FILES nodelet_plugins.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
install(DIRECTORY launch config DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
