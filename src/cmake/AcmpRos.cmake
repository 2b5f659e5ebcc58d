# Sets ACMP_HAVE_ROS, finds catkin and generates the messages, services and dynamic_reconfigure headers.
set(ACMP_HAVE_ROS FALSE)
if(NOT ACMP_ROS STREQUAL "OFF")
  if(EXISTS /usr/bin/python3)  # Debian's ROS modules live in the system's python, whatever python3 is first on PATH
    set(PYTHON_EXECUTABLE /usr/bin/python3 CACHE FILEPATH "Python for catkin")
    set(Python3_EXECUTABLE /usr/bin/python3 CACHE FILEPATH "Python for ament, pulled in by pluginlib")
  endif()
  if(NOT DEFINED CATKIN_DEVEL_PREFIX)
    # catkin snapshots the environment at find_package and leaves out folders that do not exist yet.
    file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/devel/lib/python3/dist-packages ${CMAKE_BINARY_DIR}/devel/lib/pkgconfig)
  endif()
  # catkin on Debian 11 would build GoogleTest by the CMake files of another package, and define targets without files.
  set(CMAKE_DISABLE_FIND_PACKAGE_GMock TRUE)
  set(ACMP_CATKIN_COMPONENTS camera_calibration_parsers diagnostic_updater dynamic_reconfigure geometry_msgs image_geometry
      image_transport message_generation nodelet pluginlib rosbag roscpp sensor_msgs std_msgs std_srvs
      nav_msgs tf2_eigen tf2_geometry_msgs tf2_msgs tf2_ros visualization_msgs)
  if(ACMP_ROS STREQUAL "ON")
    find_package(catkin REQUIRED COMPONENTS ${ACMP_CATKIN_COMPONENTS})
  else()
    find_package(catkin QUIET)
    if(catkin_FOUND)
      find_package(catkin QUIET COMPONENTS ${ACMP_CATKIN_COMPONENTS})
    endif()
  endif()
  if(catkin_FOUND)
    set(ACMP_HAVE_ROS TRUE)
  endif()
endif()

if(ACMP_HAVE_ROS)
  add_message_files(DIRECTORY msg FILES DistanceChange.msg Keyframe.msg KeyframeDepth.msg KeyframePoints.msg)
  add_service_files(DIRECTORY srv FILES GetDistances.srv LoadSession.srv SaveMap.srv SaveSession.srv)
  generate_messages(DEPENDENCIES geometry_msgs sensor_msgs std_msgs)
  generate_dynamic_reconfigure_options(config/DenseMapper.cfg)
  # Before any target: it also chooses where libraries and programs go in the devel space.
  catkin_package(LIBRARIES acmp_mapping_nodelets
                 CATKIN_DEPENDS geometry_msgs message_runtime nodelet roscpp sensor_msgs std_msgs)
  find_package(OpenCV 4 REQUIRED COMPONENTS imgcodecs)
  find_package(yaml-cpp REQUIRED)
endif()
