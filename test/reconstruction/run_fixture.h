#pragma once

#include <sstream>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/reconstruction/reconstruct.h"
#include "acmp_mapping/reconstruction/stop_request.h"
#include "reconstruction/fake_matcher.h"
#include "reconstruction/scene_fixture.h"

namespace acmp {

/// Runs of the tool on four images of 20 x 15 px with a stand-in for the matcher.
class ReconstructRunFixture : public ReconstructFixture {
 protected:
  static constexpr int kImages = 4;
  static constexpr int kWidth = 20;
  static constexpr int kHeight = 15;

  ReconstructRunFixture() {
    WriteScene(kImages, kWidth, kHeight);
    options_.scene = scene();
    options_.output = output();
    options_.device = "cpu";
  }

  void Run(FakeMatcher* matcher) { Run(matcher, &watcher_); }
  void Run(FakeMatcher* matcher, StopRequest* watcher) {
    log_.str("");
    out_.str("");
    Reconstruct(
        options_, [&] { return DevicesOf(matcher); }, watcher, &out_, &log_, false);
  }
  static std::vector<ReconstructDevice> DevicesOf(FakeMatcher* matcher) {
    std::vector<ReconstructDevice> devices(1);
    devices[0].engines.push_back(std::make_unique<FakeMatcherEngine>(matcher));
    devices[0].on_host = true;
    return devices;
  }
  std::string ErrorOf(FakeMatcher* matcher) {
    return MessageOf<InvalidInputError>([&] { Run(matcher); });
  }
  bool Has(const std::string& name) const { return std::filesystem::exists(options_.output / name); }

  ReconstructOptions options_;
  StopRequest watcher_;
  std::ostringstream out_;
  std::ostringstream log_;
  FakeMatcher fake_;
};

}  // namespace acmp
