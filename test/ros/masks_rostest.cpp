// A mask file and the topics mask and labels: what they ignore gets no depth, and a mask or labels that are late,
// missing or bad lose no image. mask_64x48.png ignores the last kFileRows rows.

#include <cmath>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "ros/mapper_control.h"

namespace acmp::test::masks_rostest {

constexpr size_t kViews = 5;
constexpr int kWidth = 64, kHeight = 48;
constexpr int kFileRows = 8;
constexpr int kTopicCols = 16;  ///< from the left, that masks of the topic ignore

class MasksSession : public MapperControl {
 public:
  MasksSession() : MapperControl({{"mask_wait", 5.0}, {"mask_file", ACMP_SOURCE_DIR "/test/ros/mask_64x48.png"}}) {}
  const std::vector<ViewMessages> scene = MakeSmallScene(kViews);
  const bool ready = WaitUntilReady();
  ros::Publisher masks;  ///< none at first
  size_t sent = 0;       ///< of masks
};

class MasksTest : public RunsTest<MasksSession> {
 protected:
  void SetUp() override {
    RunsTest::SetUp();
    views_ = OfThisRun(mapper().scene);
  }

  sensor_msgs::Image MaskOf(size_t view) const {
    sensor_msgs::Image mask;
    mask.header = views_[view].image.header;
    mask.encoding = "mono8";
    mask.width = mask.step = kWidth;
    mask.height = kHeight;
    mask.data.assign(static_cast<size_t>(kWidth) * kHeight, 255);
    for (size_t i = 0; i < mask.data.size(); ++i) {
      if (static_cast<int>(i) % kWidth < kTopicCols) mask.data[i] = 0;
    }
    return mask;
  }

  /// Publishes masks and waits until the mapper has them.
  void Send(const std::vector<sensor_msgs::Image>& masks) {
    if (!session().masks) session().masks = mapper().nh.advertise<sensor_msgs::Image>("mask", 100);
    ASSERT_TRUE(WaitForSubscriber(session().masks));
    for (const sensor_msgs::Image& mask : masks) session().masks.publish(mask);
    session().sent += masks.size();
    ASSERT_TRUE(mapper().WaitForDiagnostic({Concat("/mask = ", session().sent, " received")}));
  }

  /// Of the image that was published for a view: how many of the pixels that masks ignore have a depth, and how many of
  /// the others have none.
  struct Pixels {
    int ignored_with_depth = 0, used_without_depth = 0;
  };
  Pixels Count(size_t view, bool has_topic_mask) const {
    Pixels pixels;
    for (const auto& depth : mapper().depth.messages()) {
      if (depth->header.stamp != views_[view].image.header.stamp) continue;
      const auto* values = reinterpret_cast<const float*>(depth->data.data());
      for (int i = 0; i < kWidth * kHeight; ++i) {
        const bool ignored = i / kWidth >= kHeight - kFileRows || (has_topic_mask && i % kWidth < kTopicCols);
        const bool has_depth = std::isfinite(values[i]) && values[i] > 0;
        if (ignored && has_depth) ++pixels.ignored_with_depth;
        if (!ignored && !has_depth) ++pixels.used_without_depth;
      }
      return pixels;
    }
    ADD_FAILURE() << "no depth of view " << view;
    return pixels;
  }

  std::vector<ViewMessages> views_;
};

TEST_F(MasksTest, TheFileIsUsedForAllImages) {
  ASSERT_EQ(mapper().Map(views_), kViews);
  for (size_t view = 0; view < kViews; ++view) {
    const Pixels pixels = Count(view, false);
    EXPECT_EQ(pixels.ignored_with_depth, 0);
    EXPECT_EQ(pixels.used_without_depth, 0);
  }
  EXPECT_EQ(mapper().DiagnosticValue("dense_mapper: matching", "dropped: no_mask"), "") << "nobody publishes masks";
}

TEST_F(MasksTest, AMaskIsUsedForTheImageOfItsStampAndAMissingOneIsTold) {
  Send({MaskOf(0), MaskOf(1), MaskOf(3), MaskOf(4)});
  ASSERT_EQ(mapper().Map(views_), kViews);
  for (size_t view = 0; view < kViews; ++view) {
    const Pixels pixels = Count(view, view != 2);
    EXPECT_EQ(pixels.ignored_with_depth, 0) << view;
    EXPECT_EQ(pixels.used_without_depth, 0) << view;
  }
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: no_mask", "1 (", "used as a whole"}));
}

TEST_F(MasksTest, WhatCannotBeUsedIsNamedAndOneThatIgnoresAllEndsItsImage) {
  std::vector<sensor_msgs::Image> masks;
  for (size_t view = 0; view < kViews; ++view) masks.push_back(MaskOf(view));
  masks[1].encoding = "32FC1";
  masks[2].height = kHeight / 2;
  masks[2].data.resize(masks[2].data.size() / 2);
  masks[3].data.assign(masks[3].data.size(), 0);
  Send(masks);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_mask", "32FC1", "mono8"}));
  EXPECT_EQ(mapper().Map(views_, kViews - 1), kViews - 1);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_mask", "64x24", "64x48"}));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: invalid_input", "its mask ignores every pixel"}));
  EXPECT_EQ(Count(0, true).ignored_with_depth, 0);
  for (const size_t view : {1, 2}) EXPECT_EQ(Count(view, false).used_without_depth, 0) << view;
}

/// Labels go from their topic to the clouds.
class LabelsSession : public MapperControl {
 public:
  LabelsSession()
      : MapperControl({{"mask_wait", 5.0}, {"label_file", ACMP_SOURCE_DIR "/config/labels.yaml"}},
                      Parameters{{"map_publish_rate", 0.0}, {"label_file", ACMP_SOURCE_DIR "/config/labels.yaml"}}) {}
  const std::vector<ViewMessages> scene = MakeSmallScene(kViews);
  const bool ready = WaitUntilReady() && WaitForMapServer();
  ros::Publisher labels = nh.advertise<sensor_msgs::Image>("labels", 100);
  Recorder<sensor_msgs::PointCloud2> points{nh, "points"}, map_points{nh, "map_points"}, map_labels{nh, "map_labels"};
  size_t sent = 0;
};

class LabelsTest : public RunsTest<LabelsSession> {
 protected:
  static constexpr Label kWallLabel = 3, kSkyLabel = 4, kNoClass = 77;
  static constexpr Rgb kWallColor = {110, 150, 190};  ///< in config/labels.yaml

  void SetUp() override {
    RunsTest::SetUp();
    ASSERT_TRUE(mapper().CallMap("reset"));
    views_ = OfThisRun(mapper().scene);
  }

  /// Sky on the left, where nothing is mapped, else wall.
  sensor_msgs::Image LabelsOf(size_t view) const {
    sensor_msgs::Image labels;
    labels.header = views_[view].image.header;
    labels.encoding = "8UC1";
    labels.width = labels.step = kWidth;
    labels.height = kHeight;
    labels.data.assign(static_cast<size_t>(kWidth) * kHeight, kWallLabel);
    for (size_t i = 0; i < labels.data.size(); ++i) {
      if (static_cast<int>(i) % kWidth < kTopicCols) labels.data[i] = kSkyLabel;
    }
    return labels;
  }

  void Send(const std::vector<sensor_msgs::Image>& all) {
    ASSERT_TRUE(WaitForSubscriber(session().labels));
    for (const sensor_msgs::Image& labels : all) session().labels.publish(labels);
    session().sent += all.size();
    ASSERT_TRUE(mapper().WaitForDiagnostic({Concat("/labels = ", session().sent, " received")}));
  }

  std::vector<ViewMessages> views_;
};

TEST_F(LabelsTest, PointsAndTheMapHaveTheClassesOfTheirPixels) {
  std::vector<sensor_msgs::Image> all;
  for (size_t view = 0; view < kViews; ++view) all.push_back(LabelsOf(view));
  all.push_back(LabelsOf(0));
  all.back().header.stamp += ros::Duration(0.05);  // of no image
  Send(all);
  ASSERT_EQ(mapper().Map(views_), kViews);
  ASSERT_TRUE(session().points.WaitForNewest([](const auto& cloud) { return cloud.width > 0; }));
  for (const SurfacePoint& point : ToPointCloud(*session().points.messages().back())) {
    ASSERT_EQ(point.label, kWallLabel);
  }
  for (const auto& depth : mapper().depth.messages()) {
    if (depth->header.stamp != views_[2].image.header.stamp) continue;
    const auto* values = reinterpret_cast<const float*>(depth->data.data());
    for (int i = 0; i < kWidth * kHeight; ++i) ASSERT_EQ(std::isnan(values[i]), i % kWidth < kTopicCols) << i;
  }
  ASSERT_TRUE(mapper().CallMap("publish_map"));
  ASSERT_TRUE(session().map_points.WaitForNewest([](const auto& cloud) { return cloud.width > 0; }));
  ASSERT_TRUE(session().map_labels.WaitForNewest([](const auto& cloud) { return cloud.width > 0; }));
  const PointCloud map = ToPointCloud(*session().map_points.messages().back());
  const PointCloud colored = ToPointCloud(*session().map_labels.messages().back());
  ASSERT_EQ(map.size(), colored.size());
  for (size_t i = 0; i < map.size(); ++i) {
    ASSERT_EQ(map[i].label, kWallLabel);
    const Rgb& color = colored[i].color;
    ASSERT_TRUE(color.r == kWallColor.r && color.g == kWallColor.g && color.b == kWallColor.b) << i;
  }
}

TEST_F(LabelsTest, WhatIsMissingLateOrBadIsToldAndItsImageIsMapped) {
  std::vector<sensor_msgs::Image> all;
  for (size_t view = 0; view < kViews - 1; ++view) all.push_back(LabelsOf(view));  // the last image has none
  all[0].encoding = "32FC1";
  all[0].step = 4 * kWidth;
  all[0].data.resize(4 * all[0].data.size());
  all[1].height = kHeight / 2;
  all[1].data.resize(all[1].data.size() / 2);
  all[2].encoding = "16UC1";
  all[2].step = 2 * kWidth;
  all[2].data.assign(2 * all[2].data.size(), 1);  // 257
  all[3].data.assign(all[3].data.size(), kNoClass);
  Send(all);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_labels", "32FC1", "16UC1"}));
  EXPECT_EQ(mapper().Map(views_), kViews);
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: bad_labels", "3 (", "257", "255"}));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: unknown_label", "77", "from 1 to 10"}));
  EXPECT_TRUE(mapper().WaitForDiagnostic({"dropped: no_labels", "2 (", "no labels with its stamp"}));
  Send({LabelsOf(kViews - 1)});  // too late: for nothing, and nothing is lost
  EXPECT_TRUE(mapper().CallMap("publish_map"));
}

}  // namespace acmp::test::masks_rostest
