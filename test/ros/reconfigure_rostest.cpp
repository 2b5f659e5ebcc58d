// Every runtime parameter is changed and changed back while images come, as a user with rqt_reconfigure does.

#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>

#include "acmp_mapping/ros/runtime_options.h"
#include "ros/mapper_control.h"

namespace acmp::test {
namespace {

DenseMapperConfig Reconfigure(const DenseMapperConfig& wanted) {
  dynamic_reconfigure::Reconfigure call;
  wanted.__toMessage__(call.request.config);
  EXPECT_TRUE(ros::service::call("/dense_mapper/set_parameters", call));
  DenseMapperConfig config;
  config.__fromMessage__(call.response.config);
  return config;
}

/// A value a little off, within the bounds.
bool Change(bool value, bool, bool) { return !value; }
int Change(int value, int, int high) { return value < high ? value + 1 : value - 1; }
double Change(double value, double low, double high) { return value < high ? value + 1e-3 * (high - value) : low; }

/// One changed configuration for each parameter. Some parameters belong together.
std::vector<std::pair<std::string, DenseMapperConfig>> Changes(const DenseMapperConfig& start) {
  const RuntimeOptions unused;
  std::map<std::string, double> low, high;
  VisitRuntimeParameters(unused, DenseMapperConfig::__getMin__(),
                         [&](const char* name, const auto&, const auto& field) { low[name] = field; });
  VisitRuntimeParameters(unused, DenseMapperConfig::__getMax__(),
                         [&](const char* name, const auto&, const auto& field) { high[name] = field; });
  std::vector<std::pair<std::string, DenseMapperConfig>> changes;
  for (const auto& bound : low) {
    const std::string& wanted = bound.first;
    DenseMapperConfig changed = start;
    VisitRuntimeParameters(unused, changed, [&](const char* name, const auto&, auto& field) {
      using Value = std::decay_t<decltype(field)>;
      if (name == wanted) field = Change(field, static_cast<Value>(low.at(name)), static_cast<Value>(high.at(name)));
    });
    if (wanted == "depth_min") changed.depth_max = 2 * changed.depth_min;
    if (wanted == "depth_max") changed.depth_min = 0.5 * changed.depth_max;
    if (wanted == "full_size_iterations") changed.start_level = 1;
    changes.emplace_back(wanted, changed);
  }
  return changes;
}

/// Text of a configuration, for comparisons that show what differs.
std::string ToText(const DenseMapperConfig& config) {
  std::string text;
  const RuntimeOptions unused;
  VisitRuntimeParameters(unused, config, [&](const char* name, const auto&, const auto& field) {
    text += std::string(name) + " " + std::to_string(static_cast<double>(field)) + "\n";
  });
  return text;
}

TEST(ReconfigureWhileImagesCome, EveryParameterTakesEffectAndNoImageIsLost) {
  MapperControl mapper;
  ASSERT_TRUE(mapper.WaitUntilReady(kTimeoutS));
  const DenseMapperConfig start = Reconfigure(DenseMapperConfig::__getDefault__());
  DenseMapperConfig quick = start;  // the test is about changes, not about maps
  quick.photometric_iterations = quick.planar_prior_iterations = quick.geometric_iterations = 1;
  quick.geometric_passes = 1;
  const auto changes = Changes(quick);
  EXPECT_FALSE(changes.empty());
  const std::vector<ViewMessages> scene = MakeSmallScene(12);
  size_t sent = 0;
  const auto send = [&] { mapper.player.Publish(scene[sent++ % scene.size()]); };  // over and over, as a looping bag
  // The mapper works at its own pace while the changes come at theirs.
  for (const auto& [name, wanted] : changes) {
    send();
    EXPECT_EQ(ToText(Reconfigure(wanted)), ToText(wanted)) << "change of " << name;
    send();
    EXPECT_EQ(ToText(Reconfigure(quick)), ToText(quick)) << "back from " << name;
  }
  // What was sent is on its way or in the mapper: all of it must end somewhere, and a flush ends what has arrived.
  const std::string all_ended = std::to_string(sent) + " received";
  const ros::WallTime give_up = ros::WallTime::now() + ros::WallDuration(kTimeoutS);
  bool ended = false;
  while (!ended && ros::WallTime::now() < give_up) {
    ASSERT_TRUE(mapper.Call("flush"));
    mapper.diagnostics.Clear();
    ASSERT_TRUE(mapper.WaitForDiagnostic({"images = "}, kTimeoutS));
    const std::string images = mapper.DiagnosticValue("images");
    ended = images.rfind(all_ended, 0) == 0 && images.find(" 0 under way") != std::string::npos;
  }
  EXPECT_TRUE(ended) << mapper.DiagnosticValue("images") << " of " << sent;
  EXPECT_EQ(mapper.Map(MakeSmallScene(5, 5000000)), 5u) << "and it still maps";
}

}  // namespace
}  // namespace acmp::test

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "reconfigure_rostest");
  return RUN_ALL_TESTS();
}
