#include "acmp_mapping/reconstruction/stop_request.h"

#include <atomic>
#include <stdexcept>

#include "gtest/gtest.h"

namespace acmp {
namespace {

TEST(StopRequestTest, ErrorsOfTheWorkAreThrown) {
  StopRequest watcher;
  EXPECT_THROW(watcher.RunCancellable([] { throw std::runtime_error("bad image"); }), std::runtime_error);
  watcher.Check();
  bool ran = false;
  watcher.RunCancellable([&] { ran = true; });
  EXPECT_TRUE(ran) << "an error of the work before stops nothing";
}

TEST(StopRequestTest, ARequestEndsALoopUnderWay) {
  StopRequest watcher;
  std::atomic<int> turns = {0};
  watcher.RunCancellable([&] {
    tbb::parallel_for(0, 1000, [&](int) {
      if (++turns == 1) watcher.Request();
    });
    throw std::runtime_error("what the loop left is no error");
  });
  EXPECT_LT(turns, 1000);
}

TEST(StopRequestTest, AfterARequestNothingBegins) {
  StopRequest watcher;
  watcher.Request();
  watcher.RunCancellable([] { FAIL(); });
  EXPECT_THROW(watcher.Check(), Interrupted);
}

}  // namespace
}  // namespace acmp
