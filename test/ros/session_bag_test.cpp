// Sessions in bags: what comes back, and what is refused.

#include "acmp_mapping/ros/session_bag.h"

#include <map>

#include <acmp_mapping/KeyframePoints.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Float64.h>
#include <std_msgs/UInt32.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/fusion/label_votes.h"
#include "acmp_mapping/ros/keyframe_points.h"
#include "dataset/test_folder.h"
#include "map/room_keyframes.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

constexpr double kVoxel = 0.02;
constexpr size_t kViews = 4;

const std::vector<SyntheticView>& Room() {
  static const std::vector<SyntheticView> views = MakeSyntheticScene({320, 240, kViews});
  return views;
}

int64_t StampOf(size_t i) { return static_cast<int64_t>(i + 1) * 1000000007; }

std::unique_ptr<MapStore> RoomMap() {
  auto store = std::make_unique<MapStore>(MapStoreOptions{100, kVoxel});
  const PlacedKeyframes keyframes = RoomKeyframes(Room(), kVoxel);
  for (size_t i = 0; i < kViews; ++i) {
    const PlacedKeyframe& keyframe = keyframes.keyframes[i];
    PathConvention path = {true, std::nullopt, 2500000};
    if (i > 0) path.child_from_cam = keyframe.world_from_cam;
    EXPECT_TRUE(
        store->Add({"/acmp/dense_mapper", 1700000000123456789, i},
                   {StampOf(i), keyframe.world_from_cam, path, "path", std::nullopt, "camera", Room()[i].frame.camera},
                   keyframe.points_in_camera->Unpack()));
  }
  return store;
}

class SessionBagTest : public TestFolder {
 protected:
  std::filesystem::path Path() const { return folder() / "session.bag"; }
  void Write() const { WriteSession(Path(), {RoomMap()->Session(), "map"}); }
  std::string Refusal(const std::filesystem::path& path) const {
    return MessageOf<InvalidInputError>([&] { ReadSession(path); });
  }
  /// A bag with the messages of the session that `change` leaves.
  void Rewrite(const std::function<bool(const std::string& topic, acmp_mapping::KeyframePoints*)>& change) const {
    const std::filesystem::path whole = folder() / "whole.bag";
    WriteSession(whole, {RoomMap()->Session(), "map"});
    const rosbag::Bag source(whole.string());
    rosbag::Bag target(Path().string(), rosbag::bagmode::Write);
    for (const rosbag::MessageInstance& message : rosbag::View(source)) {
      auto keyframe = message.instantiate<acmp_mapping::KeyframePoints>();
      if (!change(message.getTopic(), keyframe.get())) continue;
      if (keyframe) {
        target.write(message.getTopic(), message.getTime(), *keyframe);
      } else {
        target.write(message.getTopic(), message.getTime(), message);
      }
    }
  }
};

TEST_F(SessionBagTest, AMapComesBackWithItsBytes) {
  const auto before = RoomMap();
  WriteSession(Path(), {before->Session(), "map"});
  Session session = ReadSession(Path());
  EXPECT_EQ(session.world_frame, "map");
  const MapSession expected = before->Session();
  ASSERT_EQ(session.map.keyframes.size(), kViews);
  for (size_t i = 0; i < kViews; ++i) {
    const SessionKeyframe &read = session.map.keyframes[i], &saved = expected.keyframes[i];
    EXPECT_EQ(read.key, saved.key);
    EXPECT_EQ(read.pose.stamp_ns, saved.pose.stamp_ns);
    EXPECT_EQ(read.pose.world_from_capture.matrix(), saved.pose.world_from_capture.matrix());
    EXPECT_EQ(read.pose.path.maps_world_to_child, true);
    EXPECT_EQ(read.pose.path.child_from_cam.has_value(), i > 0);
    EXPECT_EQ(read.pose.path.tolerance_ns, saved.pose.path.tolerance_ns);
    EXPECT_EQ(read.pose.path_frame, "path");
    EXPECT_EQ(read.pose.camera_frame, "camera");
    EXPECT_EQ(read.pose.camera, saved.pose.camera);
  }
  MapStore after({100, 0.0});
  after.Join(std::move(session.map), RigidTransform::Identity());
  ASSERT_GT(after.WorldCloud().points.size(), 1000u);
  // Saved again it is the same file.
  WriteSession(folder() / "again.bag", {after.Session(), "map"});
  EXPECT_EQ(ReadText(folder() / "again.bag"), ReadText(Path()));
}

/// As all sessions were before there were labels.
TEST_F(SessionBagTest, PointsWithoutLabelsHaveNoFieldForThem) {
  Session session = {RoomMap()->Session(), "map"};
  for (SessionKeyframe& keyframe : session.map.keyframes) {
    PointCloud points = keyframe.points_in_camera->Unpack();
    EXPECT_TRUE(HasLabels(points));
    for (SurfacePoint& point : points) point.label = 0;
    keyframe.points_in_camera = std::make_shared<const PackedCloud>(points);
  }
  WriteSession(Path(), session);
  const rosbag::Bag bag(Path().string());
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery("/keyframe_points"))) {
    EXPECT_EQ(message.instantiate<acmp_mapping::KeyframePoints>()->points.point_step, 32u);
  }
  EXPECT_FALSE(HasLabels(ReadSession(Path()).map.keyframes[0].points_in_camera->Unpack()));
}

TEST_F(SessionBagTest, KeptImagesAndEarlierRunsComeBack) {
  ImageStore images(folder());
  Session session = {RoomMap()->Session(), "map"};
  SessionKeyframe& keyframe = session.map.keyframes[2];
  session.map.earlier = 3;
  keyframe.image = images.Put(EncodeJpeg("image", Room()[2].frame.color), keyframe.pose.camera);
  WriteSession(Path(), session);
  const Session read = ReadSession(Path(), kMemoryLimitBytes, [&](const acmp_mapping::KeyframePoints& message) {
    return StoreImage(message, &images);
  });
  EXPECT_EQ(read.map.earlier, 3u);
  for (size_t i = 0; i < kViews; ++i) EXPECT_EQ(read.map.keyframes[i].image != nullptr, i == 2) << i;
  EXPECT_TRUE(read.map.keyframes[2].image->Read() == keyframe.image->Read());
  EXPECT_FALSE(ReadSession(Path()).map.keyframes[2].image) << "without a place to keep them";
}

TEST_F(SessionBagTest, ImagesAreWhatTheCameraSawOfThePoints) {
  Write();
  const rosbag::Bag bag(Path().string());
  std::map<std::string, size_t> counts;
  size_t known = 0, near = 0, pixels = 0;
  for (const rosbag::MessageInstance& message : rosbag::View(bag)) {
    const std::string& topic = message.getTopic();
    const size_t index = counts[topic]++;
    const auto info = message.instantiate<sensor_msgs::CameraInfo>();
    if (info) {
      EXPECT_EQ(info->K[0], Room()[0].frame.camera.fx);
    }
    const auto image = message.instantiate<sensor_msgs::Image>();
    if (!image) continue;
    EXPECT_EQ(image->encoding, topic == "/rgb/image_rect_color" ? "rgb8" : "32FC1");
    EXPECT_EQ(image->header.frame_id, "camera");
    EXPECT_EQ(image->header.stamp.toNSec(), static_cast<uint64_t>(StampOf(index)));
    const DepthMap& truth = Room()[index].true_depth;
    ASSERT_EQ(image->width * image->height, truth.size());
    const auto* values = reinterpret_cast<const float*>(image->data.data());
    if (topic == "/confidence/image") {
      EXPECT_GE(values[truth.size() / 2], 0.9f - 1e-6f) << "later keyframes confirm it";
    }
    for (size_t i = 0; i < truth.size() && topic == "/depth/image_rect"; ++i, ++pixels) {
      known += std::isnan(values[i]) ? 0 : 1;
      near += std::abs(values[i] - truth.data()[i]) <= 0.01f * truth.data()[i] ? 1 : 0;
    }
  }
  for (const char* topic :
       {"/depth/image_rect", "/depth/camera_info", "/confidence/image", "/rgb/image_rect_color", "/keyframe_points"}) {
    EXPECT_EQ(counts[topic], kViews) << topic;
  }
  EXPECT_GT(static_cast<double>(known), 0.98 * static_cast<double>(pixels));
  EXPECT_GT(static_cast<double>(near), 0.95 * static_cast<double>(known));
}

TEST_F(SessionBagTest, AFileThatIsCutOffAnywhereIsRefused) {
  Write();
  const std::string content = ReadText(Path());
  std::vector<size_t> lengths = {0, 1, 12, 13, 14, 100, 4096, 4200, content.size() - 1, content.size() - 100};
  for (size_t i = 1; i < 40; ++i) lengths.push_back(i * content.size() / 40);
  for (const size_t length : lengths) {
    const auto cut = WriteText("cut.bag", content.substr(0, length));
    EXPECT_THAT(Refusal(cut), HasAll("cut.bag", "truncated, corrupt or not a bag")) << length;
  }
  // As an aborted writer leaves it: no index. `rosbag reindex` makes a bag of it that lacks keyframes.
  Rewrite([](const std::string&, const auto* keyframe) { return !keyframe || keyframe->count <= 2; });
  EXPECT_THAT(Refusal(Path()),
              HasAll("session.bag", "has 2 of 4 keyframes", "save the session again, or take an earlier file"));
}

/// rosbag follows the index without looking: each of these would end the program, or take gigabytes.
TEST_F(SessionBagTest, AnIndexThatLiesIsRefused) {
  Write();
  const std::string content = ReadText(Path());
  const auto refusal = [&](const std::string& field, size_t from, std::vector<unsigned char> bytes) {
    std::string lying = content;
    const size_t at = lying.rfind(field);
    EXPECT_NE(at, std::string::npos);
    std::copy(bytes.begin(), bytes.end(), lying.begin() + static_cast<std::ptrdiff_t>(at + from));
    return Refusal(WriteText("lying.bag", lying));
  };
  const auto is = [](const char* reason) { return HasAll("lying.bag", "truncated, corrupt or not a bag", reason); };
  // The last record of the index of a chunk: op=, ver=, the length of its data, time and offset of its first message.
  const std::string index("ver=\1\0\0\0", 8);
  const size_t chunk_infos = content.find("chunk_pos=");
  const size_t entry = content.rfind(index, chunk_infos) + index.size() + 4;
  for (const unsigned char byte : {0x01, 0x7f}) {
    std::string lying = content;
    for (size_t i = 0; i < 4; ++i) lying[entry + 8 + i] = static_cast<char>(byte);
    EXPECT_THAT(Refusal(WriteText("lying.bag", lying)), is("of a chunk, where none begins")) << int{byte};
  }
  EXPECT_THAT(refusal("chunk_pos=", 10, {13}), is("where none begins"));
  EXPECT_THAT(refusal("chunk_pos=", 10, {0, 0, 0, 0, 0, 0, 0, 128}), is("where none begins"));
  EXPECT_THAT(refusal("index_pos=", 10, {14, 0, 0, 0, 0, 0, 0, 0}), is("where no record begins"));
  EXPECT_THAT(refusal("size=", 5, {255, 255, 255, 255}), is("would take 12.8849 GB of memory: must be at most 1"));
  EXPECT_THAT(refusal("count=", 6, {255, 255, 255, 255}), is("for 4294967295 entries"));
}

TEST_F(SessionBagTest, ForeignFilesAreRefused) {
  EXPECT_THAT(Refusal(folder() / "none.bag"), HasAll("none.bag", "no such file"));
  EXPECT_THAT(Refusal(folder()), HasSubstr("is a folder"));
  EXPECT_THAT(Refusal(WriteText("map.ply", std::string(5000, 'x'))), HasSubstr("not a bag"));
  const auto refusal = [&](const char* topic, const auto& message) {
    rosbag::Bag(Path().string(), rosbag::bagmode::Write).write(topic, ros::Time(1), message);
    return Refusal(Path());
  };
  EXPECT_THAT(refusal("/depth/image_rect", sensor_msgs::Image()),
              HasAll("/session_version", "not written by save_session"));
  std_msgs::UInt32 later;
  later.data = 7;
  EXPECT_THAT(refusal("/session_version", later),
              HasAll("session.bag", "version 7", "reads version 3", "that saved it"));
  EXPECT_THAT(refusal("/session_version", std_msgs::Float64()),
              HasAll("/session_version is a std_msgs/Float64", "std_msgs/UInt32"));
}

TEST_F(SessionBagTest, KeyframesThatCannotBeUsedAreNamed) {
  const auto refusal = [&](const std::function<void(acmp_mapping::KeyframePoints*)>& change) {
    Rewrite([&](const std::string&, auto* keyframe) {
      if (keyframe && keyframe->id == 2) change(keyframe);
      return true;
    });
    return Refusal(Path());
  };
  const auto is_named = HasAll("session.bag", "keyframe 2 of \"/acmp/dense_mapper\"");
  EXPECT_THAT(refusal([](auto* k) { k->T_world_capture.fill(0); }), AllOf(is_named, HasSubstr("T_world_capture")));
  EXPECT_THAT(refusal([](auto* k) { k->camera_info.width = 0; }), AllOf(is_named, HasSubstr("camera_info")));
  EXPECT_THAT(refusal([](auto* k) { k->camera_info.width = k->camera_info.height = 8000; }),
              AllOf(is_named, HasSubstr("8000x8000 pixels would take 3.2 GB of memory: must be at most 1")));
  EXPECT_THAT(refusal([](auto* k) { k->points.data.pop_back(); }), AllOf(is_named, HasSubstr("cloud")));
  EXPECT_THAT(refusal([](auto* k) { k->points.fields[3].name = "intensity"; }), AllOf(is_named, HasSubstr("cloud")));
  EXPECT_THAT(refusal([](auto* k) { k->count = 5; }), AllOf(is_named, HasSubstr("count = 5")));
  EXPECT_THAT(refusal([](auto* k) { k->count = 4; }), HasAll("count = 4", "comes twice"));
  Rewrite([](const std::string& topic, const auto*) { return topic != "/session_voxel_size"; });
  EXPECT_THAT(Refusal(Path()), HasSubstr("0 messages on /session_voxel_size"));
}

TEST_F(SessionBagTest, AFullDiskLeavesTheOldFileAndTakesNoSpace) {
  Write();
  const std::string content = ReadText(Path());
  const Session session = {RoomMap()->Session(), "map"};
  const auto descriptors = std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  const std::string message = [&] {
    const FileSizeLimit limit(content.size() / 2);
    return MessageOf<ProcessingError>([&] { WriteSession(Path(), session); });
  }();
  EXPECT_THAT(message, HasSubstr("File too large"));
  EXPECT_EQ(ReadText(Path()), content);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder()), {}), 1) << "no temporary file is left";
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {}), descriptors)
      << "none is left open";
}

}  // namespace
}  // namespace acmp::test
