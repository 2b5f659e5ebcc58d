#include "acmp_mapping/common/timer.h"

#include "gtest/gtest.h"

namespace acmp {
namespace {

TEST(TimerTest, LapsAddUpToTheWholeTime) {
  // The whole contains the laps whatever the machine's load, as they are read in this order from one steady clock.
  Timer whole, laps;
  double sum = 0;
  for (int i = 0; i < 1000; ++i) {
    const double lap = laps.Lap();
    ASSERT_GE(lap, 0);
    sum += lap;
  }
  const double total = whole.Lap();
  EXPECT_LE(sum, total + 1e-6 * 1000);  // each lap rounds to a double
}

}  // namespace
}  // namespace acmp
