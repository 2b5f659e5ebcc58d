// Parameters of the nodelets: reading, refusing, dynamic_reconfigure, and the shipped files.

#include "acmp_mapping/ros/runtime_options.h"

#include <cstdlib>
#include <fstream>
#include <limits>
#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/parameters.h"
#include "acmp_mapping/ros/map_server_options.h"
#include "acmp_mapping/ros/node_options.h"
#include "ros/options_support.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using test::Struct;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using XmlRpc::XmlRpcValue;

RuntimeOptions LoadRuntime(const std::map<std::string, XmlRpcValue>& members, const RuntimeOptions& start = {}) {
  ParameterReader reader(Struct(members));
  return LoadRuntimeOptions(&reader, start);
}

std::string RuntimeRefusal(const std::map<std::string, XmlRpcValue>& members) {
  return ErrorOf([&] { LoadRuntime(members); });
}

std::string ReadRefusal(const XmlRpcValue& value, const OptionValue& like) {
  return ErrorOf([&] { ParameterReader(Struct({{"a", value}})).Read(Text("a", ""), like); });
}

TEST(ParameterReader, ReadsEveryKindOfValue) {
  ParameterReader reader(Struct({{"a", 3}, {"b", 2.5}, {"c", true}, {"d", std::string("text")}, {"f", 4}}));
  EXPECT_EQ(*reader.Read(Text("a", ""), 0), OptionValue(3));
  EXPECT_EQ(*reader.Read(Text("b", ""), 0.0), OptionValue(2.5));
  EXPECT_EQ(*reader.Read(Text("c", ""), false), OptionValue(true));
  EXPECT_EQ(*reader.Read(Text("d", ""), std::string()), OptionValue(std::string("text")));
  EXPECT_EQ(*reader.Read(Text("f", ""), 0.0), OptionValue(4.0)) << "an integer for a number";
  EXPECT_FALSE(reader.Read(Text("missing", ""), 0));
  EXPECT_THAT(reader.DescribeUnknown(), IsEmpty());
}

TEST(ParameterReader, RefusesOtherKindsAndWhatIsOutOfBounds) {
  EXPECT_THAT(ReadRefusal(std::string("fast"), 0.0), AllOf(HasSubstr("~a"), HasSubstr("fast"), HasSubstr("number")));
  EXPECT_THAT(ReadRefusal(2.5, 0), AllOf(HasSubstr("~a"), HasSubstr("2.5"), HasSubstr("integer")));
  EXPECT_THAT(ReadRefusal(1, false), HasSubstr("true or false"));
  EXPECT_THAT(ReadRefusal(1, std::string()), HasSubstr("a text"));
  EXPECT_THAT(ReadRefusal(1, std::vector<double>()), HasSubstr("a list of numbers"));
  ParameterReader reader(Struct({{"a", 7}}));
  EXPECT_THAT(ErrorOf([&] { reader.Read(Number("a", 0, 5, "s", ""), 0); }),
              AllOf(HasSubstr("parameter ~a = 7"), HasSubstr("[0, 5] s")));
}

TEST(ParameterReader, NamesTheNearestOfAnUnknownName) {
  ParameterReader reader(Struct({{"max_imagesize", 3}, {"preset", std::string("online")}}));
  LoadNodeOptions(&reader);
  EXPECT_THAT(reader.DescribeUnknown(), ElementsAre(AllOf(HasSubstr("~max_imagesize"), HasSubstr("~max_image_size"))));
  reader.Allow("max_imagesize");
  EXPECT_THAT(reader.DescribeUnknown(), IsEmpty());
  ParameterReader of_another(Struct({{"voxel_size", 0.1}}));
  of_another.SetElsewhere("voxel_size", "map_server");
  LoadNodeOptions(&of_another);
  EXPECT_THAT(of_another.DescribeUnknown(), ElementsAre(AllOf(HasSubstr("~voxel_size"), HasSubstr("map_server"))));
  // Plugins keep parameters in namespaces of their own.
  ParameterReader nested(Struct({{"depth", Struct({{"jpeg_quality", 80}})}}));
  LoadNodeOptions(&nested);
  EXPECT_THAT(nested.DescribeUnknown(), IsEmpty());
  EXPECT_THAT(ParameterReader(XmlRpcValue()).DescribeUnknown(), IsEmpty());
}

TEST(MapServerOptions, AreReadAndChecked) {
  ParameterReader reader(Struct({{"max_keyframes", 7},
                                 {"voxel_size", 0.25},
                                 {"map_radius", 20},
                                 {"map_publish_rate", 2},
                                 {"save_folder", std::string("/")},
                                 {"on_time_jump", std::string("reset")}}));
  const MapServerOptions options = LoadMapServerOptions(&reader);
  EXPECT_THAT(reader.DescribeUnknown(), IsEmpty());
  EXPECT_EQ(options.map.max_keyframes, 7);
  EXPECT_EQ(options.map.voxel_size, 0.25);
  EXPECT_EQ(options.map.map_radius, 20);
  EXPECT_EQ(options.map_publish_rate, 2);
  EXPECT_EQ(options.save_folder, "/");
  EXPECT_FALSE(options.map.keep_earlier_runs);
  const auto refusal = [](const std::map<std::string, XmlRpcValue>& members) {
    return ErrorOf([&] {
      ParameterReader bad(Struct(members));
      LoadMapServerOptions(&bad);
    });
  };
  EXPECT_THAT(refusal({{"max_keyframes", 0}}), HasSubstr("max_keyframes = 0"));
  EXPECT_THAT(refusal({{"map_publish_rate", 31}}), HasSubstr("map_publish_rate = 31"));
  EXPECT_THAT(refusal({{"occupancy_min_height", 2}, {"occupancy_max_height", 1.5}}),
              HasSubstr("~occupancy_min_height = 2: must be below ~occupancy_max_height = 1.5"));
  EXPECT_THAT(refusal({{"save_folder", std::string("~/maps")}}),
              HasSubstr("~save_folder = \"~/maps\": must be a folder"));
  const std::string ros_home = testing::TempDir() + "ros_home";
  ::setenv("ROS_HOME", ros_home.c_str(), 1);
  ParameterReader none(Struct({{"max_keyframes", 7}}));
  EXPECT_EQ(LoadMapServerOptions(&none).save_folder, ros_home + "/acmp_mapping") << "not where the node was started";
  ::unsetenv("ROS_HOME");
  EXPECT_THAT(refusal({{"memory_limit", 0.0}}), HasSubstr("memory_limit = 0"));
  EXPECT_THAT(refusal({{"on_time_jump", std::string("stop")}}), AllOf(HasSubstr("stop"), HasSubstr("keep, reset")));
}

TEST(RuntimeOptions, AreReadAndChecked) {
  const RuntimeOptions options = LoadRuntime({{"window_size", 25},
                                              {"min_depth_confidence", 0.5},
                                              {"min_confidence", 0.25},
                                              {"depth_min", 1},
                                              {"depth_max", 9.5}});
  EXPECT_EQ(options.mapper.window_size, 25);
  EXPECT_EQ(options.min_depth_confidence, 0.5);
  EXPECT_EQ(options.mapper.pipeline.fusion.min_confidence, 0.25f);
  EXPECT_EQ(options.mapper.fallback_depth_range.min, 1);
  EXPECT_EQ(options.mapper.fallback_depth_range.max, 9.5f);
  EXPECT_THAT(RuntimeRefusal({{"window_size", 1000}}), AllOf(HasSubstr("~window_size = 1000"), HasSubstr("[2, 64]")));
  EXPECT_THAT(RuntimeRefusal({{"min_confidence", 2.0}}), HasSubstr("min_confidence"));
  EXPECT_THAT(RuntimeRefusal({{"min_depth_confidence", 2.0}}), HasSubstr("min_depth_confidence"));
  EXPECT_THAT(RuntimeRefusal({{"lookahead", 30}}), HasSubstr("lookahead"));
  EXPECT_THAT(RuntimeRefusal({{"depth_min", 5}, {"depth_max", 2}}), HasSubstr("depth_min and depth_max"));
  EXPECT_THAT(RuntimeRefusal({{"depth_max", 2}}), HasSubstr("~depth_min = 0 and ~depth_max = 2: set both or none"));
  EXPECT_THAT(RuntimeRefusal({{"min_confidence", std::numeric_limits<double>::quiet_NaN()}}),
              HasSubstr("min_confidence"));
}

TEST(RuntimeOptions, AKeyframeNeedsNoMoreViewsThanItMayHave) {
  EXPECT_EQ(LoadRuntime({{"max_source_views", 1}}).mapper.min_source_views, 1);
  EXPECT_EQ(LoadRuntime({{"window_size", 2}, {"lookahead", 0}}).mapper.min_source_views, 1);
  EXPECT_EQ(LoadRuntime({}).mapper.min_source_views, DenseMapperOptions().min_source_views);
}

std::map<std::string, OptionValue> PipelineValues(const PipelineOptions& options) {
  std::map<std::string, OptionValue> values;
  for (const auto& option : PipelineOptionTable()) values[option.name()] = option.get(options);
  return values;
}

TEST(RuntimeOptions, APresetReachesTheMapperWholeAndSurvivesReconfigure) {
  const std::vector<std::string>& presets = NodeOptionTable().Find("preset").description.choices;
  EXPECT_GE(presets.size(), 3u);
  for (const std::string& name : presets) {
    if (name == kAutoPreset) continue;
    RuntimeOptions start;
    start.mapper.pipeline = MakePreset(name);
    const RuntimeOptions loaded = LoadRuntime({}, start);
    EXPECT_EQ(PipelineValues(loaded.mapper.pipeline), PipelineValues(MakePreset(name))) << name;
    const RuntimeOptions reconfigured = FromConfig(ToConfig(loaded), loaded);
    EXPECT_EQ(PipelineValues(reconfigured.mapper.pipeline), PipelineValues(MakePreset(name))) << name;
  }
}

TEST(RuntimeOptions, AParameterCountsMoreThanThePreset) {
  RuntimeOptions start;
  start.mapper.pipeline = MakePreset("acmh");
  ASSERT_FALSE(start.mapper.pipeline.use_planar_prior);
  const PipelineOptions pipeline = LoadRuntime({{"use_planar_prior", true}}, start).mapper.pipeline;
  EXPECT_TRUE(pipeline.use_planar_prior);
  EXPECT_EQ(pipeline.fill.enabled, MakePreset("acmh").fill.enabled);
}

/// What dynamic_reconfigure knows by name.
std::map<std::string, double> Values(const DenseMapperConfig& config) {
  dynamic_reconfigure::Config message;
  config.__toMessage__(message);
  std::map<std::string, double> values;
  for (const auto& flag : message.bools) values[flag.name] = flag.value;
  for (const auto& integer : message.ints) values[integer.name] = integer.value;
  for (const auto& number : message.doubles) values[number.name] = number.value;
  return values;
}

TEST(Reconfigure, OffersWhatMayChange) {
  std::set<std::string> in_table, in_cfg;
  for (const auto& option : RuntimeOptionTable()) {
    if (option.description.while_running) in_table.insert(option.name());
  }
  for (const auto& value : Values(DenseMapperConfig::__getDefault__())) in_cfg.insert(value.first);
  EXPECT_EQ(in_cfg, in_table);
}

TEST(Reconfigure, EveryValueTakesItsWay) {
  // One changed option after the other: it arrives, and nothing else changes.
  const RuntimeOptions current = LoadRuntime({});
  const auto [least, largest] = ConfigBounds();
  for (const auto& changed : RuntimeOptionTable()) {
    if (!changed.description.while_running) continue;
    RuntimeOptions wanted = current;
    OptionValue value = changed.get(current);
    if (auto* flag = std::get_if<bool>(&value)) *flag = !*flag;
    if (auto* integer = std::get_if<int>(&value)) ++*integer;
    if (auto* number = std::get_if<double>(&value)) *number += 0.25;
    changed.set(value, &wanted);
    if (changed.name() == "depth_min") wanted.mapper.fallback_depth_range.max = 9;
    if (changed.name() == "depth_max") wanted.mapper.fallback_depth_range.min = 0.125f;
    const DenseMapperConfig config = ToConfig(wanted);
    const RuntimeOptions arrived = FromConfig(config, current);
    for (const auto& option : RuntimeOptionTable()) {
      EXPECT_EQ(option.get(arrived), option.get(wanted)) << changed.name() << ", " << option.name();
    }
    EXPECT_LT(Values(least).at(changed.name()), Values(largest).at(changed.name()));
    EXPECT_LE(Values(least).at(changed.name()), Values(config).at(changed.name())) << changed.name();
    EXPECT_GE(Values(largest).at(changed.name()), Values(config).at(changed.name())) << changed.name();
  }
}

TEST(Reconfigure, LeavesAloneWhatIsReadOnce) {
  const RuntimeOptions current = LoadRuntime({{"window_size", 5}, {"refine_again", false}});
  const RuntimeOptions after = FromConfig(DenseMapperConfig::__getDefault__(), current);
  EXPECT_EQ(after.mapper.window_size, 5);
  EXPECT_FALSE(after.mapper.refine_again);
}

TEST(Reconfigure, RefusesWhatIsOutOfBoundsOrDoesNotFit) {
  const RuntimeOptions current = LoadRuntime({{"window_size", 4}});
  const auto refusal = [&](const std::function<void(DenseMapperConfig*)>& change) {
    DenseMapperConfig config = ToConfig(current);
    change(&config);
    return ErrorOf([&] { FromConfig(config, current); });
  };
  EXPECT_THAT(refusal([](auto* c) { c->max_source_views = 2000; }),
              AllOf(HasSubstr("max_source_views = 2000"), HasSubstr("[1, 32]")));
  EXPECT_THAT(refusal([](auto* c) { c->lookahead = 4; }), AllOf(HasSubstr("lookahead = 4"), HasSubstr("[0, 3]")));
  EXPECT_THAT(refusal([](auto* c) { c->depth_min = 5, c->depth_max = 2; }), HasSubstr("depth_min and depth_max"));
  EXPECT_THAT(refusal([](auto* c) { c->min_confidence = std::numeric_limits<double>::quiet_NaN(); }),
              HasSubstr("min_confidence"));
}

template <class Options>
void CheckDescriptions(const OptionTable<Options>& table, std::set<std::string>* names) {
  for (const auto& option : table) {
    const OptionDescription& description = option.description;
    const bool is_of_both_nodes = option.name() == std::string("memory_limit");
    EXPECT_TRUE(names->insert(option.name()).second || is_of_both_nodes) << option.name() << " twice";
    EXPECT_GE(description.sentence.size(), 20u) << option.name();
    EXPECT_EQ(description.sentence.find('"'), std::string::npos) << option.name() << ": it is quoted in the .cfg file";
    EXPECT_FALSE(description.group.empty()) << option.name();
    EXPECT_NO_THROW(CheckOption(description, option.default_value())) << option.name();
  }
}

TEST(Parameters, AreFewAndExplained) {
  std::set<std::string> names;
  CheckDescriptions(NodeOptionTable(), &names);
  CheckDescriptions(RuntimeOptionTable(), &names);
  CheckDescriptions(MapServerOptionTable(), &names);
  EXPECT_LE(names.size(), 46u);
  EXPECT_LE(PipelineOptionTable().size(), 25u);
  EXPECT_LE(Values(DenseMapperConfig::__getDefault__()).size(), 15u);
}

}  // namespace
}  // namespace acmp
