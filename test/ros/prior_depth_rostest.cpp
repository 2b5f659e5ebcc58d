// The topic prior_depth: maps that are bad, missing or of no use are named, and no image is lost.

#include <cmath>
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/ros.h>

#include "acmp_mapping/common/error.h"
#include "ros/mapper_control.h"
#include "ros/scene_player.h"

namespace acmp::test::prior_depth_rostest {

constexpr size_t kViews = 5;

/// One depth everywhere, at half of the images' size.
sensor_msgs::Image DepthOf(const ViewMessages& view, float depth) {
  constexpr int kWidth = 32, kHeight = 24;
  sensor_msgs::Image message;
  message.header = view.image.header;
  message.encoding = "32FC1";
  message.width = kWidth;
  message.height = kHeight;
  message.step = kWidth * sizeof(float);
  const std::vector<float> values(static_cast<size_t>(kWidth) * kHeight, depth);
  message.data.resize(values.size() * sizeof(float));
  std::memcpy(message.data.data(), values.data(), message.data.size());
  return message;
}

TEST(PriorDepthTest, WhatIsOfNoUseIsNamedAndItsImagesAreMapped) {
  MapperControl mapper(Parameters{});
  ASSERT_TRUE(mapper.WaitUntilReady());
  const std::vector<ViewMessages> views = MakeSmallScene(kViews);
  std::vector<sensor_msgs::Image> depths;
  for (const ViewMessages& view : views) depths.push_back(DepthOf(view, 2));
  depths[1].encoding = "mono8";
  depths[2] = DepthOf(views[2], NAN);
  depths[3].header.stamp += ros::Duration(0.01);

  ros::Publisher publisher = mapper.nh.advertise<sensor_msgs::Image>("prior_depth", 100);
  ASSERT_TRUE(WaitForSubscriber(publisher));
  for (const sensor_msgs::Image& depth : depths) publisher.publish(depth);
  ASSERT_TRUE(mapper.WaitForDiagnostic({"/prior_depth", Concat(kViews, " received")}));

  EXPECT_EQ(mapper.Map(views), kViews);
  EXPECT_TRUE(mapper.WaitForDiagnostic({"dropped: bad_prior_depth", "2 ("})) << "of views 1 and 2";
  EXPECT_TRUE(mapper.WaitForDiagnostic({"dropped: no_prior_depth", "goes without"})) << "of view 3, or 1";
  EXPECT_TRUE(mapper.WaitForDiagnostic({"dropped: unused_prior_depth", "it explains"}));
}

}  // namespace acmp::test::prior_depth_rostest
