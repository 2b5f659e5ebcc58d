// Parameters of the nodelets: reading, refusing, dynamic_reconfigure.

#include "acmp_mapping/ros/options.h"

#include <cstdlib>
#include <functional>
#include <limits>
#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using XmlRpc::XmlRpcValue;
using Members = std::map<std::string, XmlRpcValue>;

/// A parameter namespace.
XmlRpcValue Struct(const Members& members) {
  XmlRpcValue value;
  for (const auto& [name, member] : members) value[name] = member;
  return value;
}

XmlRpcValue Word(const char* text) { return std::string(text); }

NodeOptions LoadNode(const Members& members) {
  ParameterReader reader(Struct(members));
  return LoadNodeOptions(&reader);
}

RuntimeOptions LoadRuntime(const Members& members, const RuntimeOptions& start = {}) {
  ParameterReader reader(Struct(members));
  return LoadRuntimeOptions(&reader, start);
}

MapServerOptions LoadMapServer(const Members& members) {
  ParameterReader reader(Struct(members));
  return LoadMapServerOptions(&reader);
}

std::string NodeRefusal(const Members& members) {
  return ErrorOf([&] { LoadNode(members); });
}
std::string RuntimeRefusal(const Members& members) {
  return ErrorOf([&] { LoadRuntime(members); });
}
std::string MapServerRefusal(const Members& members) {
  return ErrorOf([&] { LoadMapServer(members); });
}

TEST(ParameterReader, TakesIntegersForNumbersAndNothingElseForAnotherKind) {
  EXPECT_EQ(LoadNode({{"sync_tolerance", 4}}).matcher.sync_tolerance_s, 4);
  EXPECT_THAT(NodeRefusal({{"sync_tolerance", Word("fast")}}), HasAll("~sync_tolerance", "fast", "number"));
  EXPECT_THAT(NodeRefusal({{"max_image_size", 2.5}}), HasAll("~max_image_size", "2.5", "integer"));
  EXPECT_THAT(NodeRefusal({{"rectified", 1}}), HasSubstr("true or false"));
  EXPECT_THAT(NodeRefusal({{"world_frame", 1}}), HasSubstr("a text"));
  EXPECT_THAT(NodeRefusal({{"T_body_cam", 1}}), HasSubstr("a list of numbers"));
  EXPECT_THAT(NodeRefusal({{"mask_wait", 11}}), HasAll("~mask_wait = 11", "[0, 10] s"));
}

TEST(ParameterReader, NamesTheNearestOfAnUnknownName) {
  ParameterReader reader(Struct({{"max_imagesize", 3}, {"preset", Word("online")}}));
  LoadNodeOptions(&reader);
  EXPECT_THAT(reader.DescribeUnknown(), ElementsAre(HasAll("~max_imagesize", "~max_image_size")));
  reader.Allow("max_imagesize");
  EXPECT_THAT(reader.DescribeUnknown(), IsEmpty());
  ParameterReader of_another(Struct({{"voxel_size", 0.1}}));
  of_another.SetElsewhere("voxel_size", "map_server");
  LoadNodeOptions(&of_another);
  EXPECT_THAT(of_another.DescribeUnknown(), ElementsAre(HasAll("~voxel_size", "map_server")));
  // Plugins keep parameters in namespaces of their own.
  ParameterReader nested(Struct({{"depth", Struct({{"jpeg_quality", 80}})}}));
  LoadNodeOptions(&nested);
  EXPECT_THAT(nested.DescribeUnknown(), IsEmpty());
  EXPECT_THAT(ParameterReader(XmlRpcValue()).DescribeUnknown(), IsEmpty());
}

TEST(NodeOptions, ADeviceHasANumber) {
  NodeOptions options = LoadNode({{"device", Word("cuda:1")}});
  EXPECT_EQ(options.device, Device::kCuda);
  EXPECT_EQ(options.cuda_device, 1);
  EXPECT_EQ(OptionsOf(&options).Find("device").get(), OptionValue(std::string("cuda:1")));
  for (const char* bad : {"gpu", "cuda:", "cuda:-1", "cuda:01", "cuda:64", "cuda:1 ", "CPU", ""}) {
    EXPECT_THAT(NodeRefusal({{"device", Word(bad)}}), HasSubstr("must be auto, cuda")) << bad;
  }
  EXPECT_THAT(NodeRefusal({{"preset", Word("acmm")}}), HasAll("acmm", "online")) << "it needs all images";
}

TEST(NodeOptions, AnEmptyPresetIsBalancedOrAutoWhereACpuMustKeepUp) {
  const auto used = [](const Members& members, bool on_cpu) { return UsedPreset(LoadNode(members), on_cpu); };
  EXPECT_EQ(used({}, false), "balanced");
  EXPECT_EQ(used({}, true), "auto");
  EXPECT_EQ(used({{"overload", Word("block")}}, true), "balanced") << "nothing is lost";
  EXPECT_EQ(used({{"preset", Word("balanced")}}, true), "balanced") << "as it is set";
  EXPECT_EQ(used({{"preset", Word("auto")}}, false), "auto");
}

XmlRpcValue Matrix(const std::vector<double>& numbers, bool nested = false) {
  XmlRpcValue value;
  for (int i = 0; i < static_cast<int>(numbers.size()); ++i) {
    (nested ? value[i / 4][i % 4] : value[i]) = numbers[static_cast<size_t>(i)];
  }
  return value;
}

TEST(NodeOptions, TheExtrinsicIsAMatrixOfTheBody) {
  for (const bool nested : {false, true}) {
    const XmlRpcValue matrix = Matrix({0, 0, 1, 0.1, -1, 0, 0, 0.2, 0, -1, 0, 0.3, 0, 0, 0, 1}, nested);
    const NodeOptions options = LoadNode({{"pose_child", Word("body")}, {"T_body_cam", matrix}});
    EXPECT_EQ(options.pose.body_from_cam->translation(), Eigen::Vector3d(0.1, 0.2, 0.3));
    EXPECT_EQ(options.pose.body_from_cam->linear()(0, 2), 1);
    EXPECT_FALSE(NeedsExtrinsic(options));
  }
  EXPECT_TRUE(NeedsExtrinsic(LoadNode({{"pose_child", Word("body")}}))) << "it may come later";
  const auto refusal = [](const std::vector<double>& numbers) {
    return NodeRefusal({{"pose_child", Word("body")}, {"T_body_cam", Matrix(numbers)}});
  };
  EXPECT_THAT(refusal({1, 0, 0}), HasSubstr("3 numbers"));
  EXPECT_THAT(refusal({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.1, 0.2, 0.3, 1}), HasSubstr("last row")) << "transposed";
  EXPECT_THAT(refusal({2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}), HasSubstr("T_body_cam"));
  EXPECT_THAT(NodeRefusal({{"T_body_cam", Matrix({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1})}}),
              HasSubstr("pose_child"));
}

TEST(NodeOptions, EachSourceCameraHasAPlaceOrNone) {
  const std::vector<double> place = {1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  std::vector<double> places = place;
  places.insert(places.end(), place.begin(), place.end());
  const NodeOptions options = LoadNode({{"source_cameras", 2}, {"T_cam_source", Matrix(places)}});
  ASSERT_EQ(options.cam_from_sources.size(), 2u);
  EXPECT_EQ(options.cam_from_sources[1].translation().x(), 0.1);
  EXPECT_THAT(NodeRefusal({{"source_cameras", 2}, {"T_cam_source", Matrix(place)}}),
              HasSubstr("~T_cam_source has 1 matrices: must have one for each of ~source_cameras = 2"));
  EXPECT_THAT(NodeRefusal({{"source_cameras", 1}, {"T_cam_source", Matrix({1, 2})}}), HasSubstr("has 2 numbers"));
  EXPECT_THAT(NodeRefusal({{"source_cameras", 5}}), HasSubstr("source_cameras"));
}

TEST(NodeOptions, ThePathMayBeOfAnotherChild) {
  EXPECT_EQ(PathChild(LoadNode({{"pose_child", Word("camera_flu")}})), PoseSemantics::Child::kCameraFlu);
  EXPECT_EQ(PathChild(LoadNode({{"path_child", Word("body")}})), PoseSemantics::Child::kBody);
  EXPECT_EQ(LoadNode({{"path_child", Word("")}}).path_child, std::nullopt);
}

TEST(NodeOptions, TfNeedsTheFramesThatNoMessageNames) {
  const XmlRpcValue tf = Word("tf"), frame = Word("/map");
  EXPECT_THAT(NodeRefusal({{"pose_source", tf}}), HasSubstr("~world_frame"));
  EXPECT_EQ(LoadNode({{"pose_source", tf}, {"world_frame", frame}}).world_frame, "map") << "without the slash";
  EXPECT_THAT(NodeRefusal({{"pose_source", tf}, {"world_frame", frame}, {"pose_child", Word("body")}}),
              HasSubstr("~body_frame"));
  EXPECT_THAT(NodeRefusal({{"pose_source", tf}, {"world_frame", frame}, {"keyframe_mode", Word("external")}}),
              HasSubstr("external"));
}

TEST(MapServerOptions, AreReadAndChecked) {
  const MapServerOptions options = LoadMapServer({{"save_folder", Word("/")}, {"on_time_jump", Word("reset")}});
  EXPECT_EQ(options.save_folder, "/");
  EXPECT_TRUE(options.map.forget_earlier_runs);
  EXPECT_THAT(MapServerRefusal({{"occupancy_min_height", 2}, {"occupancy_max_height", 1.5}}),
              HasSubstr("~occupancy_min_height = 2: must be below ~occupancy_max_height = 1.5"));
  EXPECT_THAT(MapServerRefusal({{"save_folder", Word("~/maps")}}), HasSubstr("~save_folder = \"~/maps\""));
  const std::string ros_home = testing::TempDir() + "ros_home";
  ::setenv("ROS_HOME", ros_home.c_str(), 1);
  EXPECT_EQ(LoadMapServer({}).save_folder, ros_home + "/acmp_mapping") << "not where the node was started";
  ::unsetenv("ROS_HOME");
}

TEST(RuntimeOptions, OnesThatBelongTogetherAreChecked) {
  EXPECT_EQ(LoadRuntime({{"depth_min", 1}, {"depth_max", 9.5}}).mapper.fallback_depth_range.max, 9.5f);
  EXPECT_THAT(RuntimeRefusal({{"lookahead", 30}}), HasSubstr("lookahead"));
  EXPECT_THAT(RuntimeRefusal({{"depth_min", 5}, {"depth_max", 2}}), HasSubstr("depth_min and depth_max"));
  EXPECT_THAT(RuntimeRefusal({{"depth_max", 2}}), HasSubstr("~depth_min = 0 and ~depth_max = 2: set both or none"));
}

TEST(RuntimeOptions, AKeyframeNeedsNoMoreViewsThanItMayHave) {
  EXPECT_EQ(LoadRuntime({{"max_source_views", 1}}).mapper.min_source_views, 1);
  EXPECT_EQ(LoadRuntime({{"window_size", 2}, {"lookahead", 0}}).mapper.min_source_views, 1);
  EXPECT_EQ(LoadRuntime({}).mapper.min_source_views, DenseMapperOptions().min_source_views);
}

std::map<std::string, OptionValue> PipelineValues(PipelineOptions options) {
  std::map<std::string, OptionValue> values;
  for (const Option& option : OptionsOf(&options)) values[option.name] = option.get();
  return values;
}

TEST(RuntimeOptions, APresetReachesTheMapperWholeAndAParameterCountsMore) {
  RuntimeOptions start;
  for (const std::string name : {"acmh", "acmp", "balanced", "online"}) {
    start.mapper.pipeline = MakePreset(name);
    const RuntimeOptions loaded = LoadRuntime({}, start);
    EXPECT_EQ(PipelineValues(loaded.mapper.pipeline), PipelineValues(MakePreset(name))) << name;
    const RuntimeOptions reconfigured = FromConfig(ToConfig(loaded), loaded);
    EXPECT_EQ(PipelineValues(reconfigured.mapper.pipeline), PipelineValues(MakePreset(name))) << name;
  }
  start.mapper.pipeline = MakePreset("acmh");
  auto expected = PipelineValues(start.mapper.pipeline);
  expected["use_planar_prior"] = true;
  EXPECT_EQ(PipelineValues(LoadRuntime({{"use_planar_prior", true}}, start).mapper.pipeline), expected);
}

/// Another value, within the bounds.
OptionValue Changed(const Option& option) {
  OptionValue value = option.get();
  if (auto* flag = std::get_if<bool>(&value)) *flag = !*flag;
  if (auto* integer = std::get_if<int>(&value)) *integer += *integer < option.max ? 1 : -1;
  if (auto* number = std::get_if<double>(&value)) {
    *number = *number < option.max ? *number + 1e-3 * (option.max - *number) : option.min;
  }
  return value;
}

TEST(Reconfigure, EveryOptionThatMayChangeDoesAloneAndWithinItsBounds) {
  const RuntimeOptions start = LoadRuntime({});
  const auto values = [](RuntimeOptions options) {
    std::map<std::string, OptionValue> all;
    for (const Option& option : OptionsOf(&options)) all[option.name] = option.get();
    return all;
  };
  RuntimeOptions changed;
  for (const Option& option : OptionsOf(&changed)) {
    if (!option.while_running) continue;
    changed = start;
    option.set(Changed(option));
    DepthRange& range = changed.mapper.fallback_depth_range;  // both or none
    if (option.name == "depth_min") range.max = 2 * range.min;
    if (option.name == "depth_max") range.min = 0.5f * range.max;
    EXPECT_NE(values(changed), values(start)) << option.name;
    EXPECT_EQ(values(FromConfig(ToConfig(changed), start)), values(changed)) << option.name;
    if (!std::holds_alternative<int>(option.get())) continue;
    option.set(OptionValue(static_cast<int>(option.max) + 1));
    EXPECT_REFUSED(FromConfig(ToConfig(changed), start), option.name);
  }
}

TEST(Reconfigure, LeavesAloneWhatIsReadOnce) {
  const RuntimeOptions current = LoadRuntime({{"window_size", 5}, {"refine_again", false}});
  const RuntimeOptions after = FromConfig(DenseMapperConfig::__getDefault__(), current);
  EXPECT_EQ(after.mapper.window_size, 5);
  EXPECT_FALSE(after.mapper.refine_again);
}

TEST(Parameters, AreFewAndExplained) {
  NodeOptions node;
  RuntimeOptions runtime;
  MapServerOptions map_server;
  OptionList all = OptionsOf(&node);
  all.Append(OptionsOf(&runtime));
  all.Append(OptionsOf(&map_server));
  std::set<std::string> names;
  for (const Option& option : all) {
    EXPECT_TRUE(names.insert(option.name).second || option.name == "memory_limit" || option.name == "label_file")
        << option.name << " twice";
    EXPECT_GE(option.sentence.size(), 20u) << option.name;
    EXPECT_EQ(option.sentence.find('"'), std::string::npos) << option.name << ": it is quoted in the .cfg file";
    EXPECT_FALSE(option.group.empty()) << option.name;
  }
  EXPECT_NO_THROW(all.Check());
  // What nobody could judge is a constant: whoever adds one says here who needs it. The mesh has four, as its rate and
  // what it may take depend on the machine; z_up what nobody can see in images alone,
  // label_file what the numbers of somebody's network mean.
  EXPECT_LE(names.size(), 59u);
}

}  // namespace
}  // namespace acmp
