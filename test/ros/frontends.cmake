# One test per preset, each with a master of its own since frontends share names of topics; then the table of all.
set(ACMP_FRONTENDS vins_mono vins_fusion orb_slam3_ros orb_slam3_ros_wrapper orb_slam_2_ros stella_vslam_ros ov2slam
                   kimera_vio okvis openvins rtabmap)

# acmp_play_frontend(preset [played_as]): played_as is another way to wire it, which frontends_rostest.test knows.
function(acmp_play_frontend preset)
  set(arguments frontend:=${preset} ${ARGN})
  add_rostest(frontends_rostest.test ARGS ${arguments} DEPENDENCIES acmp_rostests)
  string(REPLACE ":=" "_" name "${arguments}")
  string(REPLACE ";" "__" name "${name}")
  set_property(TEST frontends_table APPEND PROPERTY
               DEPENDS _ctest_${PROJECT_NAME}_rostest_frontends_rostest__${name}.test)
endfunction()

add_test(NAME frontends_table
         COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/frontends_table.sh ${CMAKE_BINARY_DIR}/frontend_results
                 ${ACMP_FRONTENDS} vins_fusion_camera_pose ov2slam_cloud_stamped_now)
foreach(frontend ${ACMP_FRONTENDS})
  acmp_play_frontend(${frontend})
endforeach()
acmp_play_frontend(vins_fusion played_as:=vins_fusion_camera_pose)
acmp_play_frontend(ov2slam played_as:=ov2slam_cloud_stamped_now)
