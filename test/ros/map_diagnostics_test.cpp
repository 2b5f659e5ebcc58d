#include "acmp_mapping/ros/map_diagnostics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/diagnostics_support.h"

namespace acmp {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;
using ::testing::AllOf;
using ::testing::HasSubstr;

using MapDescriber = void (*)(const MapSnapshot&, DiagnosticStatusWrapper*);

/// A map at work.
MapSnapshot HealthyMap() {
  MapSnapshot snapshot;
  snapshot.now_s = 100;
  snapshot.keyframe_topic = "/acmp/keyframe_points";
  snapshot.keyframe_publishers = 2;
  snapshot.optimized_path_topic = "/slam/path";
  snapshot.optimized_path_publishers = 1;
  snapshot.mappers["/acmp/dense_mapper"] = {40, 0, 99};
  return snapshot;
}

TEST(MapDiagnostics, AllIsWell) {
  for (const MapDescriber describe : {&DescribeMap, &DescribeMappers}) {
    const auto status = Describe(describe, HealthyMap());
    EXPECT_EQ(status.level, DiagnosticStatus::OK) << status.message;
    EXPECT_FALSE(status.message.empty());
  }
}

TEST(MapDiagnostics, SayWhatIsNotInTheMapYet) {
  MapSnapshot snapshot = HealthyMap();
  EXPECT_EQ(DescribeMissing(snapshot.mappers), "");
  snapshot.mappers["/acmp/dense_mapper"].lost = 234;
  EXPECT_THAT(DescribeMissing(snapshot.mappers), HasSubstr("234 messages with points of /acmp/dense_mapper were lost"));
  snapshot.mappers["/acmp_2/dense_mapper"].images_under_way = 7;
  EXPECT_THAT(DescribeMissing(snapshot.mappers), AllOf(HasSubstr("7 images"), HasSubstr("/acmp_2/dense_mapper"),
                                                       HasSubstr("flush finishes them, if it has not since")));
  EXPECT_THAT(ValueOf(Describe(&DescribeMappers, snapshot), "/acmp_2/dense_mapper"), HasSubstr("under way then: 7"));
}

TEST(MapDiagnostics, TellOfLoopCorrections) {
  MapSnapshot snapshot = HealthyMap();
  snapshot.map.paths = 7;
  snapshot.map.corrections = 3;
  snapshot.map.reposed = 40;
  snapshot.map.path_poses = 30;
  snapshot.map.path_unmatched = 12;
  snapshot.map.evicted_by_radius = 5;
  snapshot.map.smallest_scale = 0.75;
  const auto status = Describe(&DescribeMap, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK);
  EXPECT_THAT(ValueOf(status, "optimized paths"), AllOf(HasSubstr("7 received on /slam/path"), HasSubstr("1 publ")));
  EXPECT_EQ(ValueOf(status, "scales of keyframes by optimized paths"), "0.75 to 1");
  EXPECT_EQ(ValueOf(status, "loop corrections (paths that moved keyframes)"), "3");
  EXPECT_EQ(ValueOf(status, "keyframes re-posed, all corrections together"), "40");
  EXPECT_EQ(ValueOf(status, "poses of the last optimized path without a keyframe"), "12 of 30");
  EXPECT_EQ(ValueOf(status, "keyframes evicted (~map_radius)"), "5");
}

TEST(MapDiagnostics, WarnOfRecentIncidents) {
  MapSnapshot snapshot = HealthyMap();
  snapshot.incidents["optimized_path_frame"] = {2, "in another frame", 99, 99};
  const auto status = Describe(&DescribeMap, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("in another frame"));
  EXPECT_THAT(ValueOf(status, "incident: optimized_path_frame"), HasSubstr("2 ("));
  snapshot.now_s = 200;
  EXPECT_EQ(Describe(&DescribeMap, snapshot).level, DiagnosticStatus::OK) << "long ago";
}

TEST(MapDiagnostics, TellWhatComesFromEachMapper) {
  MapSnapshot snapshot = HealthyMap();
  snapshot.mappers["/right/dense_mapper"] = {30, 2, 60};
  auto status = Describe(&DescribeMappers, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::OK) << "a camera that stands still has no keyframes";
  EXPECT_THAT(ValueOf(status, "/right/dense_mapper"),
              AllOf(HasSubstr("30 messages"), HasSubstr("40 s ago"), HasSubstr("2 lost")));
  snapshot.keyframe_publishers = 0;
  status = Describe(&DescribeMappers, snapshot);
  EXPECT_EQ(status.level, DiagnosticStatus::WARN);
  EXPECT_THAT(status.message, HasSubstr("nobody publishes /acmp/keyframe_points"));
}

}  // namespace
}  // namespace acmp
