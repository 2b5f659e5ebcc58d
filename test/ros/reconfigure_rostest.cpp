// Every runtime parameter is changed and changed back while images come, as a user with rqt_reconfigure does.

#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>

#include "acmp_mapping/ros/options.h"
#include "ros/mapper_control.h"

namespace acmp::test::reconfigure_rostest {

/// @param set_parameters stays connected, as rqt_reconfigure does
DenseMapperConfig Reconfigure(ros::ServiceClient* set_parameters, const DenseMapperConfig& wanted) {
  dynamic_reconfigure::Reconfigure call;
  wanted.__toMessage__(call.request.config);
  EXPECT_TRUE(set_parameters->call(call));
  DenseMapperConfig config;
  config.__fromMessage__(call.response.config);
  return config;
}

/// Another value, within the bounds.
OptionValue Change(const Option& option) {
  OptionValue value = option.get();
  if (auto* flag = std::get_if<bool>(&value)) *flag = !*flag;
  if (auto* integer = std::get_if<int>(&value)) *integer += *integer < option.max ? 1 : -1;
  if (auto* number = std::get_if<double>(&value)) {
    *number = *number < option.max ? *number + 1e-3 * (option.max - *number) : option.min;
  }
  return value;
}

/// One changed configuration for each parameter. Some parameters belong together.
std::vector<std::pair<std::string, DenseMapperConfig>> Changes(const RuntimeOptions& start) {
  std::vector<std::pair<std::string, DenseMapperConfig>> changes;
  RuntimeOptions changed;
  for (const Option& option : OptionsOf(&changed)) {
    if (!option.while_running) continue;
    changed = start;
    option.set(Change(option));
    DepthRange& range = changed.mapper.fallback_depth_range;
    if (option.name == "depth_min") range.max = 2 * range.min;
    if (option.name == "depth_max") range.min = 0.5f * range.max;
    changes.emplace_back(option.name, ToConfig(changed));
  }
  return changes;
}

/// Text of a configuration, for comparisons that show what differs.
std::string ToText(const DenseMapperConfig& config) {
  std::ostringstream text;
  dynamic_reconfigure::Config message;
  config.__toMessage__(message);
  text << message;
  return text.str();
}

TEST(ReconfigureWhileImagesCome, EveryParameterTakesEffectAndNoImageIsLost) {
  MapperControl mapper(Parameters{});
  ASSERT_TRUE(mapper.WaitUntilReady(kTimeoutS));
  RuntimeOptions options;
  options.mapper.pipeline = MakePreset("online");  // the test is about changes, not about maps
  ros::ServiceClient set_parameters =
      ros::NodeHandle().serviceClient<dynamic_reconfigure::Reconfigure>("/dense_mapper/set_parameters", true);
  const DenseMapperConfig quick = Reconfigure(&set_parameters, ToConfig(options));
  const auto changes = Changes(options);
  ASSERT_FALSE(changes.empty());
  const std::vector<ViewMessages> scene = MakeSmallScene(12);
  size_t sent = 0;
  const auto send = [&] { mapper.player.Publish(scene[sent++ % scene.size()]); };  // over and over, as a looping bag
  // The mapper works at its own pace while the changes come at theirs.
  for (const auto& [name, wanted] : changes) {
    send();
    EXPECT_EQ(ToText(Reconfigure(&set_parameters, wanted)), ToText(wanted)) << "change of " << name;
    send();
    EXPECT_EQ(ToText(Reconfigure(&set_parameters, quick)), ToText(quick)) << "back from " << name;
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

}  // namespace acmp::test::reconfigure_rostest
