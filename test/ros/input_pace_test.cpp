#include <gtest/gtest.h>

#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {
namespace {

TEST(InputPace, WhatFitsBeforeTheNextInputIsDoneAtOnce) {
  InputPace pace;
  EXPECT_EQ(pace.WaitFor(5, 1), 0) << "nothing has come";
  for (int i = 0; i < 5; ++i) pace.Add(10 + 0.1 * i);  // the next one is due at 10.5
  EXPECT_EQ(pace.WaitFor(10.42, 0.05), 0);
  EXPECT_NEAR(pace.WaitFor(10.42, 0.09), 0.13, 1e-9) << "until it is late by half an interval";
  EXPECT_NEAR(pace.WaitFor(10.5, 0.05), 0.05, 1e-9);
  EXPECT_EQ(pace.WaitFor(10.56, 0.05), 0) << "it has not come";
}

}  // namespace
}  // namespace acmp
