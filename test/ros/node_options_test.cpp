#include "acmp_mapping/ros/node_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros/options_support.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using test::Struct;
using ::testing::AllOf;
using ::testing::HasSubstr;
using XmlRpc::XmlRpcValue;

NodeOptions Load(const std::map<std::string, XmlRpcValue>& members) {
  ParameterReader reader(Struct(members));
  return LoadNodeOptions(&reader);
}

std::string NodeRefusal(const std::map<std::string, XmlRpcValue>& members) {
  return ErrorOf([&] { Load(members); });
}

TEST(NodeOptions, ReadsEnumerations) {
  ParameterReader reader(Struct({{"device", std::string("cpu")},
                                 {"overload", std::string("block")},
                                 {"pose_is", std::string("T_cam_world")},
                                 {"sparse_frame", std::string("camera")},
                                 {"keyframe_mode", std::string("gate")}}));
  const NodeOptions options = LoadNodeOptions(&reader);
  EXPECT_EQ(options.device, Device::kCpu);
  EXPECT_EQ(options.overload, OverloadPolicy::kBlock);
  EXPECT_EQ(options.pose.direction, PoseSemantics::Direction::kCamFromWorld);
  EXPECT_EQ(options.sparse_frame, SparseFrame::kCamera);
  EXPECT_EQ(options.keyframe_mode, KeyframeMode::kGate);
}

TEST(NodeOptions, RefusesBadValuesAndNamesThem) {
  EXPECT_THAT(NodeRefusal({{"device", std::string("gpu")}}), AllOf(HasSubstr("gpu"), HasSubstr("cuda")));
  EXPECT_THAT(NodeRefusal({{"overload", std::string("never")}}),
              AllOf(HasSubstr("never"), HasSubstr("drop, skip_if_busy")));
  EXPECT_THAT(NodeRefusal({{"pose_is", std::string("Twc")}}), HasSubstr("Twc"));
  EXPECT_THAT(NodeRefusal({{"max_image_size", -1}}), HasSubstr("-1"));
  EXPECT_THAT(NodeRefusal({{"sync_tolerance", -0.5}}), HasSubstr("-0.5"));
}

XmlRpcValue Matrix(const std::vector<double>& numbers, bool nested) {
  XmlRpcValue value;
  for (int i = 0; i < static_cast<int>(numbers.size()); ++i) {
    if (nested) {
      value[i / 4][i % 4] = numbers[static_cast<size_t>(i)];
    } else {
      value[i] = numbers[static_cast<size_t>(i)];
    }
  }
  return value;
}

TEST(NodeOptions, ReadsTheExtrinsicBothWays) {
  const std::vector<double> numbers = {0, 0, 1, 0.1, -1, 0, 0, 0.2, 0, -1, 0, 0.3, 0, 0, 0, 1};
  for (const bool nested : {false, true}) {
    ParameterReader reader(Struct({{"pose_child", std::string("body")}, {"T_body_cam", Matrix(numbers, nested)}}));
    const NodeOptions options = LoadNodeOptions(&reader);
    EXPECT_EQ(options.pose.body_from_cam->translation(), Eigen::Vector3d(0.1, 0.2, 0.3));
    EXPECT_EQ(options.pose.body_from_cam->linear()(0, 2), 1);
  }
}

TEST(NodeOptions, RefusesABadExtrinsic) {
  const auto refusal = [](std::vector<double> numbers) {
    return NodeRefusal({{"pose_child", std::string("body")}, {"T_body_cam", Matrix(numbers, false)}});
  };
  EXPECT_THAT(refusal({1, 0, 0}), HasSubstr("3 numbers"));
  EXPECT_THAT(refusal({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.1, 0.2, 0.3, 1}), HasSubstr("last row")) << "transposed";
  EXPECT_THAT(refusal({2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}), HasSubstr("T_body_cam"));
  EXPECT_THAT(NodeRefusal({{"T_body_cam", Matrix({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, false)}}),
              HasSubstr("pose_child"));
}

TEST(NodeOptions, APresetThatNeedsAllImagesIsRefused) {
  EXPECT_THAT(NodeRefusal({{"preset", std::string("acmm")}}), AllOf(HasSubstr("acmm"), HasSubstr("online")));
}

TEST(NodeOptions, TheDeviceMayBeOneOfSeveral) {
  EXPECT_EQ(Load({{"device", std::string("cuda")}}).cuda_device, 0);
  const NodeOptions second = Load({{"device", std::string("cuda:1")}});
  EXPECT_EQ(second.device, Device::kCuda);
  EXPECT_EQ(second.cuda_device, 1);
  const Option<NodeOptions>& option = NodeOptionTable().Find("device");
  EXPECT_EQ(option.get(second), OptionValue(std::string("cuda:1")));
  for (const char* bad : {"cuda:", "cuda:-1", "cuda:01", "cuda:64", "cuda:1 ", "CPU", ""}) {
    EXPECT_THAT(NodeRefusal({{"device", std::string(bad)}}), HasSubstr("must be auto, cuda")) << bad;
  }
}

TEST(NodeOptions, ThePathMayBeOfAnotherChild) {
  EXPECT_EQ(PathSemantics(Load({{"pose_child", std::string("camera_flu")}})).child, PoseSemantics::Child::kCameraFlu);
  EXPECT_EQ(PathSemantics(Load({{"path_child", std::string("body")}})).child, PoseSemantics::Child::kBody);
  EXPECT_EQ(Load({{"path_child", std::string()}}).path_child, std::nullopt);
}

TEST(NodeOptions, ReadsPoseSources) {
  const std::pair<const char*, PoseSource> sources[] = {{"pose", PoseSource::kPose},
                                                        {"pose_cov", PoseSource::kPoseWithCovariance},
                                                        {"odom", PoseSource::kOdometry},
                                                        {"transform", PoseSource::kTransform}};
  for (const auto& [name, source] : sources) {
    EXPECT_EQ(Load({{"pose_source", std::string(name)}}).pose_source, source) << name;
  }
  EXPECT_THAT(NodeRefusal({{"pose_source", std::string("gps")}}), AllOf(HasSubstr("gps"), HasSubstr("odom")));
}

TEST(NodeOptions, TfNeedsTheFramesThatNoMessageNames) {
  const XmlRpcValue tf = std::string("tf"), body = std::string("body"), frame = std::string("/map");
  EXPECT_THAT(NodeRefusal({{"pose_source", tf}}), HasSubstr("~world_frame"));
  EXPECT_EQ(Load({{"pose_source", tf}, {"world_frame", frame}}).world_frame, "map") << "without the slash";
  EXPECT_THAT(NodeRefusal({{"pose_source", tf}, {"world_frame", frame}, {"pose_child", body}}),
              HasSubstr("~body_frame"));
  EXPECT_THAT(NodeRefusal({{"pose_source", tf}, {"world_frame", frame}, {"keyframe_mode", std::string("external")}}),
              HasSubstr("external"));
}

TEST(NodeOptions, TheExtrinsicMayComeLater) {
  const NodeOptions options = Load({{"pose_child", std::string("body")}, {"extrinsic_inverted", true}});
  EXPECT_FALSE(options.pose.body_from_cam);
  EXPECT_TRUE(options.extrinsic_inverted);
}

}  // namespace
}  // namespace acmp
