#include "acmp_mapping/ros/shard_exchange.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

ShardEstimate MakeEstimate() {
  ShardEstimate estimate;
  estimate.id = 7;
  estimate.stage = EstimateStage::kRefined;
  estimate.state = {PlaneMap(3, 2), CostMap(3, 2)};
  for (size_t i = 0; i < 6; ++i) {
    const float value = 1.0f / static_cast<float>(i + 1);
    estimate.state.planes.data()[i] = {value, -0.0f, std::numeric_limits<float>::denorm_min(), 3 * value};
    estimate.state.cost.data()[i] = value;
  }
  return estimate;
}

template <class T>
bool SameBytes(const Image<T>& a, const Image<T>& b) {
  const auto bytes = [](const Image<T>& image) { return reinterpret_cast<const unsigned char*>(image.data()); };
  return a.size() == b.size() && std::equal(bytes(a), bytes(a) + a.size() * sizeof(T), bytes(b));
}

TEST(EstimateMessage, CarriesEveryBit) {
  const ShardEstimate sent = MakeEstimate();
  const ShardEstimate received = ToShardEstimate(*ToEstimateMessage(sent));
  EXPECT_EQ(received.id, 7);
  EXPECT_EQ(received.stage, EstimateStage::kRefined);
  ASSERT_EQ(received.state.planes.width(), 3);
  ASSERT_EQ(received.state.cost.height(), 2);
  EXPECT_TRUE(SameBytes(received.state.planes, sent.state.planes));
  EXPECT_TRUE(SameBytes(received.state.cost, sent.state.cost));
}

TEST(EstimateMessage, EmptyMeansNone) {
  const ShardEstimate received = ToShardEstimate(*ToEstimateMessage({3, EstimateStage::kFast, {}}));
  EXPECT_EQ(received.id, 3);
  EXPECT_EQ(received.stage, EstimateStage::kFast);
  EXPECT_TRUE(received.state.planes.empty());
}

TEST(EstimateMessage, SizesMustFit) {
  const auto refusal = [](const std::function<void(acmp_mapping::KeyframeEstimate*)>& change) -> std::string {
    auto message = *ToEstimateMessage(MakeEstimate());
    change(&message);
    try {
      ToShardEstimate(message);
    } catch (const InvalidInputError& error) {
      return error.what();
    }
    return "(accepted)";
  };
  EXPECT_THAT(refusal([](auto* m) { m->planes.pop_back(); }), ::testing::HasSubstr("95 and 24 bytes"));
  EXPECT_THAT(refusal([](auto* m) { m->cost.clear(); }), ::testing::HasSubstr("96 and 0 bytes"));
  EXPECT_THAT(refusal([](auto* m) { m->stage = 4; }), ::testing::HasSubstr("stage = 4"));
  EXPECT_THAT(refusal([](auto* m) { m->width = 70000; }), ::testing::HasSubstr("width = 70000"));
}

}  // namespace
}  // namespace acmp
