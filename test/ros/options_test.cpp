// Parameters: reading, refusing, and the agreement of C++ defaults, .cfg and yaml.

#include <fstream>
#include <map>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/parameters.h"
#include "acmp_mapping/ros/map_server_options.h"
#include "acmp_mapping/ros/node_options.h"
#include "acmp_mapping/ros/runtime_options.h"
#include "ros/options_support.h"

namespace acmp {
namespace {

using test::Refusal;
using test::Struct;
using ::testing::AllOf;
using ::testing::HasSubstr;
using XmlRpc::XmlRpcValue;

std::string RuntimeRefusal(const std::map<std::string, XmlRpcValue>& members) {
  return Refusal([&] {
    ParameterReader reader(Struct(members));
    LoadRuntimeOptions(&reader, RuntimeOptions());
  });
}

TEST(ParameterReader, KeepsDefaultsAndReadsValues) {
  ParameterReader reader(Struct({{"a", 3}, {"b", 2.5}, {"c", true}, {"d", std::string("text")}}));
  double a = 0, b = 0, missing = 7;
  bool c = false;
  std::string d;
  EXPECT_TRUE(reader.Read("a", &a));
  EXPECT_TRUE(reader.Read("b", &b));
  EXPECT_TRUE(reader.Read("c", &c));
  EXPECT_TRUE(reader.Read("d", &d));
  EXPECT_FALSE(reader.Read("missing", &missing));
  EXPECT_EQ(a, 3);
  EXPECT_EQ(b, 2.5);
  EXPECT_TRUE(c);
  EXPECT_EQ(d, "text");
  EXPECT_EQ(missing, 7);
  EXPECT_NO_THROW(reader.CheckUnknown());
}

TEST(ParameterReader, RefusesOtherTypes) {
  ParameterReader reader(Struct({{"a", std::string("fast")}, {"b", 2.5}}));
  double number = 0;
  int integer = 0;
  bool flag = false;
  EXPECT_THAT(Refusal([&] { reader.Read("a", &number); }),
              AllOf(HasSubstr("~a"), HasSubstr("fast"), HasSubstr("number")));
  EXPECT_THAT(Refusal([&] { reader.Read("b", &integer); }),
              AllOf(HasSubstr("~b"), HasSubstr("2.5"), HasSubstr("integer")));
  EXPECT_THAT(Refusal([&] { reader.Read("b", &flag); }), HasSubstr("true or false"));
}

TEST(ParameterReader, NamesTheNearestKnownKey) {
  ParameterReader reader(Struct({{"max_imagesize", 3}}));
  LoadNodeOptions(&reader);
  EXPECT_THAT(Refusal([&] { reader.CheckUnknown(); }),
              AllOf(HasSubstr("~max_imagesize"), HasSubstr("~max_image_size")));
  // Plugins keep parameters in namespaces of their own.
  ParameterReader nested(Struct({{"depth", Struct({{"jpeg_quality", 80}})}}));
  LoadNodeOptions(&nested);
  EXPECT_NO_THROW(nested.CheckUnknown());
  EXPECT_NO_THROW(ParameterReader(XmlRpcValue()).CheckUnknown());
}

TEST(MapServerOptions, AreReadAndChecked) {
  ParameterReader reader(Struct({{"max_keyframes", 7},
                                 {"map_radius", 12.5},
                                 {"voxel_size", 0.25},
                                 {"map_publish_rate", 2},
                                 {"on_time_jump", std::string("reset")}}));
  const MapServerOptions options = LoadMapServerOptions(&reader);
  EXPECT_NO_THROW(reader.CheckUnknown());
  EXPECT_EQ(options.map.max_keyframes, 7);
  EXPECT_EQ(options.map.map_radius, 12.5);
  EXPECT_EQ(options.map.voxel_size, 0.25);
  EXPECT_EQ(options.map_publish_rate, 2);
  EXPECT_FALSE(options.map.keep_earlier_runs);
  const auto refusal = [](const std::map<std::string, XmlRpcValue>& members) {
    return Refusal([&] {
      ParameterReader bad(Struct(members));
      LoadMapServerOptions(&bad);
    });
  };
  EXPECT_THAT(refusal({{"max_keyframes", 0}}), HasSubstr("max_keyframes = 0"));
  EXPECT_THAT(refusal({{"voxel_size", std::numeric_limits<double>::quiet_NaN()}}), HasSubstr("voxel_size"));
  EXPECT_THAT(refusal({{"map_publish_rate", 31}}), HasSubstr("map_publish_rate = 31"));
  EXPECT_THAT(refusal({{"on_time_jump", std::string("clear")}}), AllOf(HasSubstr("clear"), HasSubstr("keep, reset")));
}

/// Values by name, for comparisons.
std::map<std::string, double> Values(const DenseMapperConfig& config) {
  std::map<std::string, double> values;
  const RuntimeOptions unused;
  VisitRuntimeParameters(unused, config, [&](const char* name, const auto&, const auto& field) {
    EXPECT_TRUE(values.emplace(name, static_cast<double>(field)).second) << name << " twice";
  });
  return values;
}

TEST(RuntimeOptions, DefaultsOfTheCfgAreThoseOfTheStructs) {
  EXPECT_EQ(Values(DenseMapperConfig::__getDefault__()), Values(ToConfig(RuntimeOptions())));
}

TEST(RuntimeOptions, EveryParameterOfTheCfgIsInTheList) {
  const auto values = Values(DenseMapperConfig::__getDefault__());
  for (const auto& description : DenseMapperConfig::__getParamDescriptions__()) {
    EXPECT_EQ(values.count(description->name), 1u) << description->name;
    EXPECT_FALSE(description->description.empty()) << description->name;
  }
  EXPECT_EQ(values.size(), DenseMapperConfig::__getParamDescriptions__().size());
}

TEST(RuntimeOptions, ThePipelinesAreNamedAsOffline) {
  RuntimeOptions options;
  std::map<std::string, const void*> here;
  VisitRuntimeParameters(options, DenseMapperConfig::__getDefault__(),
                         [&](const char* name, const auto& option, const auto&) { here[name] = &option; });
  VisitPipelineParameters(options.mapper.pipeline, [&](const char* name, const auto& option) {
    EXPECT_EQ(here[name], &option) << name;
    here.erase(name);
  });
  const void* pipeline = &options.mapper.pipeline;
  const void* end = &options.mapper.pipeline + 1;
  for (const auto& [name, option] : here) EXPECT_FALSE(option >= pipeline && option < end) << name;
}

TEST(RuntimeOptions, SurviveTheWayThroughAConfig) {
  // A value of its own for every field, then there and back again.
  RuntimeOptions options;
  DenseMapperConfig unused;
  int n = 0;
  VisitRuntimeParameters(options, unused, [&](const char*, auto& option, const auto&) {
    using Option = std::decay_t<decltype(option)>;
    if constexpr (std::is_same_v<Option, bool>) {
      option = !option;
    } else if constexpr (std::is_enum_v<Option>) {
      option = static_cast<Option>(1);
    } else {
      option = static_cast<Option>(++n);
    }
  });
  const DenseMapperConfig config = ToConfig(options);
  EXPECT_EQ(Values(ToConfig(FromConfig(config))), Values(config));
  n = 0;
  const RuntimeOptions back = FromConfig(config);
  VisitRuntimeParameters(back, config, [&](const char* name, const auto& option, const auto&) {
    using Option = std::decay_t<decltype(option)>;
    if constexpr (!std::is_same_v<Option, bool> && !std::is_enum_v<Option>) {
      EXPECT_EQ(static_cast<int>(option), ++n) << name;
    }
  });
}

TEST(RuntimeOptions, BoundsOfTheCfgAreLegal) {
  // Each bound alone; parameters that limit each other are made valid as the server would.
  const DenseMapperConfig defaults = DenseMapperConfig::__getDefault__();
  for (const DenseMapperConfig& bounds : {DenseMapperConfig::__getMin__(), DenseMapperConfig::__getMax__()}) {
    for (const auto& description : DenseMapperConfig::__getParamDescriptions__()) {
      const std::string name = description->name;
      if (name == "depth_min" || name == "depth_max") continue;  // valid as a pair only
      DenseMapperConfig config = defaults;
      RuntimeOptions unused;
      std::map<std::string, double> bound = Values(bounds);
      VisitRuntimeParameters(unused, config, [&](const char* parameter, const auto&, auto& field) {
        if (name == parameter) field = static_cast<std::decay_t<decltype(field)>>(bound[name]);
      });
      for (const std::string& change : MakeValid(defaults, &config)) {
        EXPECT_THAT(change, ::testing::Not(HasSubstr("refused"))) << name;
      }
      EXPECT_NO_THROW(Validate(FromConfig(config))) << name;
    }
  }
}

TEST(RuntimeOptions, AreReadAndCheckedAgainstTheCfg) {
  ParameterReader reader(Struct({{"window_size", 25}, {"min_confidence", 0.5}, {"depth_min", 1}, {"depth_max", 9.5}}));
  const RuntimeOptions options = LoadRuntimeOptions(&reader, RuntimeOptions());
  EXPECT_EQ(options.mapper.window_size, 25);
  EXPECT_EQ(options.output.min_confidence, 0.5);
  EXPECT_EQ(options.mapper.fallback_depth_range.min, 1);
  EXPECT_EQ(options.mapper.fallback_depth_range.max, 9.5f);
  EXPECT_THAT(RuntimeRefusal({{"window_size", 1000}}), AllOf(HasSubstr("~window_size = 1000"), HasSubstr("64")));
  EXPECT_THAT(RuntimeRefusal({{"min_confidence", 2.0}}), HasSubstr("min_confidence"));
  EXPECT_THAT(RuntimeRefusal({{"lookahead", 30}}), HasSubstr("lookahead"));
  EXPECT_THAT(RuntimeRefusal({{"depth_min", 5}, {"depth_max", 2}}), HasSubstr("depth_range"));
}

TEST(RuntimeOptions, PresetGivesStartValues) {
  RuntimeOptions start;
  start.mapper.pipeline = MakePreset("acmh");
  ParameterReader nothing{XmlRpcValue()};
  EXPECT_FALSE(LoadRuntimeOptions(&nothing, start).mapper.pipeline.use_planar_prior);
  ParameterReader reader(Struct({{"use_planar_prior", true}}));
  EXPECT_TRUE(LoadRuntimeOptions(&reader, start).mapper.pipeline.use_planar_prior);
}

std::map<std::string, double> PipelineValues(PipelineOptions options) {
  std::map<std::string, double> values;
  VisitPipelineParameters(options,
                          [&](const char* name, const auto& option) { values[name] = static_cast<double>(option); });
  return values;
}

TEST(RuntimeOptions, EveryPresetReachesTheMapperWhole) {
  for (const std::string& name : PresetNames()) {
    RuntimeOptions start;
    start.mapper.pipeline = MakePreset(name);
    ParameterReader nothing{XmlRpcValue()};
    const RuntimeOptions loaded = LoadRuntimeOptions(&nothing, start);
    EXPECT_EQ(PipelineValues(loaded.mapper.pipeline), PipelineValues(MakePreset(name))) << name;
    EXPECT_EQ(Values(ToConfig(loaded)), Values(ToConfig(start))) << name;
    // The reconfigure server starts from that and changes nothing.
    DenseMapperConfig config = ToConfig(loaded);
    EXPECT_TRUE(MakeValid(config, &config).empty()) << name;
    EXPECT_EQ(PipelineValues(FromConfig(config).mapper.pipeline), PipelineValues(MakePreset(name))) << name;
  }
}

TEST(RuntimeOptions, ParametersCountMoreThanThePreset) {
  RuntimeOptions start;
  start.mapper.pipeline = MakePreset("online");
  ParameterReader reader(Struct({{"start_level", 2}, {"full_size_iterations", 0}, {"candidate_view_votes", 5}}));
  const PipelineOptions pipeline = LoadRuntimeOptions(&reader, start).mapper.pipeline;
  EXPECT_EQ(pipeline.start_level, 2);
  EXPECT_EQ(pipeline.full_size_iterations, 0);
  EXPECT_EQ(pipeline.patch_match.candidate_view_votes, 5);
  EXPECT_EQ(pipeline.planar_prior.cell_size_px, MakePreset("online").planar_prior.cell_size_px);
}

TEST(RuntimeOptions, BoundsOfTheCfgAreThoseOfTheStart) {
  for (const auto& [name, low, high] : {std::tuple("start_level", 0, 2),
                                        {"full_size_iterations", 0, 20},
                                        {"candidate_view_votes", 0, 5},
                                        {"settled_views", 0, 32}}) {
    for (const int good : {low, high}) EXPECT_EQ(RuntimeRefusal({{name, good}}), "(accepted)") << name;
    for (const int bad : {low - 1, high + 1}) {
      EXPECT_THAT(RuntimeRefusal({{name, bad}}), HasSubstr(Concat("~", name, " = ", bad)));
    }
  }
}

TEST(MakeValid, LimitsParametersByEachOther) {
  const DenseMapperConfig previous = DenseMapperConfig::__getDefault__();
  DenseMapperConfig config = previous;
  EXPECT_TRUE(MakeValid(previous, &config).empty());
  config.window_size = 2;
  const auto changes = MakeValid(previous, &config);
  EXPECT_EQ(config.lookahead, 1);
  EXPECT_EQ(config.min_source_views, 1);
  EXPECT_EQ(changes.size(), 2u);
  EXPECT_THAT(changes[0], HasSubstr("lookahead = 2 was changed to 1"));
}

TEST(MakeValid, TakesThePreviousBackWhenNothingElseHelps) {
  const DenseMapperConfig previous = DenseMapperConfig::__getDefault__();
  DenseMapperConfig config = previous;
  config.depth_min = 5;
  config.depth_max = 2;
  config.seed = 99;
  EXPECT_THAT(MakeValid(previous, &config).at(0), AllOf(HasSubstr("refused"), HasSubstr("depth_range")));
  EXPECT_EQ(Values(config), Values(previous));
  config.sigma_color = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(MakeValid(previous, &config).empty());
  EXPECT_EQ(Values(config), Values(previous));
}

/// The few kinds of line that the shipped yaml has: "key: value  # comment", and "#key: value  # comment" for what is
/// left to the preset.
struct ShippedLines {
  std::map<std::string, std::string> set, left_to_preset;
};

ShippedLines ReadYaml(const std::string& path) {
  std::ifstream file(path);
  EXPECT_TRUE(file) << path;
  ShippedLines lines;
  std::string line;
  while (std::getline(file, line)) {
    const bool left_out = line.size() > 1 && line[0] == '#' && line[1] != ' ';
    if (left_out) line.erase(0, 1);
    line = line.substr(0, line.find('#'));
    const size_t colon = line.find(": ");
    if (colon == std::string::npos) continue;
    const size_t end = line.find_last_not_of(' ');
    const std::string name = line.substr(0, colon), value = line.substr(colon + 2, end - colon - 1);
    EXPECT_EQ(lines.set.count(name) + lines.left_to_preset.count(name), 0u) << line;
    (left_out ? lines.left_to_preset : lines.set)[name] = value;
  }
  return lines;
}

XmlRpcValue ToXmlRpc(const std::string& text) {
  if (text == "true" || text == "false") return XmlRpcValue(text == "true");
  if (text == "[]") {
    XmlRpcValue empty;
    empty.setSize(0);
    return empty;
  }
  char* end = nullptr;
  const long integer = std::strtol(text.c_str(), &end, 10);
  if (*end == 0 && !text.empty()) return XmlRpcValue(static_cast<int>(integer));
  const double number = std::strtod(text.c_str(), &end);
  if (*end == 0 && !text.empty()) return XmlRpcValue(number);
  return XmlRpcValue(text == "\"\"" ? std::string() : text);
}

const std::string kShippedYaml = std::string(ACMP_SOURCE_DIR) + "/config/acmp_mapping.yaml";
const std::string kShippedMapYaml = std::string(ACMP_SOURCE_DIR) + "/config/map_server.yaml";

// The launch files load the whole file: a value in it would make the preset of no effect.
TEST(ShippedYaml, LeavesToThePresetWhatItSets) {
  const ShippedLines lines = ReadYaml(kShippedYaml);

  std::map<std::string, XmlRpcValue> members;
  for (const auto& [name, text] : lines.set) members[name] = ToXmlRpc(text);
  for (const std::string& name : PresetNames()) {
    RuntimeOptions start;
    start.mapper.pipeline = MakePreset(name);
    ParameterReader reader(Struct(members));
    EXPECT_EQ(PipelineValues(LoadRuntimeOptions(&reader, start).mapper.pipeline), PipelineValues(MakePreset(name)))
        << name;
  }
}

TEST(ShippedYaml, HoldsAllParametersWithTheirDefaults) {
  const ShippedLines lines = ReadYaml(kShippedYaml);
  std::map<std::string, XmlRpcValue> members;
  for (const auto& [name, text] : lines.set) members[name] = ToXmlRpc(text);
  for (const auto& [name, text] : lines.left_to_preset) members[name] = ToXmlRpc(text);
  ParameterReader reader(Struct(members));
  const NodeOptions node = LoadNodeOptions(&reader);
  const RuntimeOptions runtime = LoadRuntimeOptions(&reader, RuntimeOptions());
  EXPECT_NO_THROW(reader.CheckUnknown());
  EXPECT_EQ(Values(ToConfig(runtime)), Values(ToConfig(RuntimeOptions())));

  const NodeOptions defaults;
  EXPECT_EQ(node.device, defaults.device);
  EXPECT_EQ(node.cuda_device, defaults.cuda_device);
  EXPECT_EQ(node.preset, defaults.preset);
  EXPECT_EQ(node.image_transport, defaults.image_transport);
  EXPECT_EQ(node.rectified, defaults.rectified);
  EXPECT_EQ(node.max_image_size, defaults.max_image_size);
  EXPECT_EQ(node.pose.direction, defaults.pose.direction);
  EXPECT_EQ(node.pose.child, defaults.pose.child);
  EXPECT_EQ(node.pose.body_from_cam.has_value(), defaults.pose.body_from_cam.has_value());
  EXPECT_EQ(node.path_child, defaults.path_child);
  EXPECT_EQ(node.extrinsic_inverted, defaults.extrinsic_inverted);
  EXPECT_EQ(node.pose_source, defaults.pose_source);
  EXPECT_EQ(node.calibration_file, defaults.calibration_file);
  EXPECT_EQ(node.world_frame, defaults.world_frame);
  EXPECT_EQ(node.camera_frame, defaults.camera_frame);
  EXPECT_EQ(node.body_frame, defaults.body_frame);
  EXPECT_EQ(node.sparse_frame, defaults.sparse_frame);
  EXPECT_EQ(node.matcher.sync_tolerance_s, defaults.matcher.sync_tolerance_s);
  EXPECT_EQ(node.matcher.sparse_tolerance_s, defaults.matcher.sparse_tolerance_s);
  EXPECT_EQ(node.matcher.sparse_wait_s, defaults.matcher.sparse_wait_s);
  EXPECT_EQ(node.keyframe_mode, defaults.keyframe_mode);
  EXPECT_EQ(node.overload, defaults.overload);

  // Nothing is missing: every name that is read is there.
  ParameterReader nothing{XmlRpcValue()};
  LoadNodeOptions(&nothing);
  LoadRuntimeOptions(&nothing, RuntimeOptions());
  for (const std::string& name : nothing.known()) EXPECT_EQ(members.count(name), 1u) << name;
}

TEST(ShippedYaml, HoldsAllParametersOfTheMapServerWithTheirDefaults) {
  std::map<std::string, XmlRpcValue> members;
  for (const auto& [name, text] : ReadYaml(kShippedMapYaml).set) members[name] = ToXmlRpc(text);
  ParameterReader reader(Struct(members));
  const MapServerOptions options = LoadMapServerOptions(&reader), defaults;
  EXPECT_NO_THROW(reader.CheckUnknown());
  EXPECT_EQ(options.map.max_keyframes, defaults.map.max_keyframes);
  EXPECT_EQ(options.map.map_radius, defaults.map.map_radius);
  EXPECT_EQ(options.map.voxel_size, defaults.map.voxel_size);
  EXPECT_EQ(options.map.keep_earlier_runs, defaults.map.keep_earlier_runs);
  EXPECT_EQ(options.map_publish_rate, defaults.map_publish_rate);
  EXPECT_EQ(members.size(), reader.known().size()) << "nothing is missing";
}

}  // namespace
}  // namespace acmp
