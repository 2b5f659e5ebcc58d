// The tests of *_rostest.cpp in one program, of which each .test file runs one suite: --gtest_filter=SUITE.*

#include <gtest/gtest.h>
#include <ros/ros.h>

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "acmp_rostests");
  const int code = RUN_ALL_TESTS();
  const bool has_run = testing::UnitTest::GetInstance()->test_to_run_count() > 0;
  if (!has_run) ROS_FATAL("no test has a name like %s", testing::GTEST_FLAG(filter).c_str());
  return has_run ? code : 1;
}
