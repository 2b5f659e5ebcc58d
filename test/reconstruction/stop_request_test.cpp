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

TEST(StopRequestTest, AfterARequestLoopsEndAndWhatTheyLeftIsNoError) {
  StopRequest watcher;
  watcher.RunCancellable([&] {
    watcher.Request();
    std::atomic<int> turns = {0};
    tbb::parallel_for(0, 1000, [&](int) { ++turns; });
    if (turns == 0) throw std::runtime_error("no depth at any pixel");
  });
  EXPECT_THROW(watcher.Check(), Interrupted);
}

TEST(StopRequestTest, ARequestEndsALoopUnderWay) {
  StopRequest watcher;
  std::atomic<int> turns = {0};
  watcher.RunCancellable([&] {
    tbb::parallel_for(0, 1000, [&](int) {
      if (++turns == 1) watcher.Request();
    });
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
