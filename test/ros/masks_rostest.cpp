// A mask file and the topic mask: what they ignore gets no depth, and a mask that is late, missing or bad loses no
// image. mask_64x48.png ignores the last kFileRows rows.

#include <cmath>

#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
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

}  // namespace acmp::test::masks_rostest
