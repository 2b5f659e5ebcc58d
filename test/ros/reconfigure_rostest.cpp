// Every runtime parameter is changed and changed back while a bag plays, as a user with rqt_reconfigure does.

#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>

#include "acmp_mapping/ros/runtime_options.h"
#include "ros/endless_player.h"

namespace acmp::test {
namespace {

constexpr double kTimeoutS = 60;

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

TEST(ReconfigureWhileABagPlays, EveryParameterTakesEffectAndNoImageIsLost) {
  MapperControl mapper;
  ASSERT_TRUE(mapper.WaitUntilReady(kTimeoutS));
  const DenseMapperConfig start = Reconfigure(DenseMapperConfig::__getDefault__());
  DenseMapperConfig quick = start;  // the test is about changes, not about maps
  quick.photometric_iterations = quick.planar_prior_iterations = quick.geometric_iterations = 1;
  quick.geometric_passes = 1;
  const auto changes = Changes(quick);
  EXPECT_GT(changes.size(), 50u);
  {
    const EndlessPlayer player(mapper.player);
    for (const auto& [name, wanted] : changes) {
      EXPECT_EQ(ToText(Reconfigure(wanted)), ToText(wanted)) << "change of " << name;
      EXPECT_EQ(ToText(Reconfigure(quick)), ToText(quick)) << "back from " << name;
    }
  }
  // The player has stopped; what it sent is on its way or in the mapper. All of it must end somewhere.
  mapper.diagnostics.Clear();
  const auto all_ended = [&mapper] {
    mapper.Call("flush");
    return mapper.WaitForDiagnostic({"images", " 0 under way"}, 3);
  };
  bool ended = false;
  for (int i = 0; i < 20 && !ended; ++i) ended = all_ended();
  EXPECT_TRUE(ended) << mapper.DiagnosticValue("images");
  mapper.depth.Clear();
  EXPECT_EQ(mapper.Map(MakeSmallScene(5, 5000000)), 5u) << "and it still maps";
}

}  // namespace
}  // namespace acmp::test

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "reconfigure_rostest");
  return RUN_ALL_TESTS();
}
