// A map as a mesh and as a COLMAP model, and the images that it keeps for that.

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "acmp_mapping/map/map_writer.h"
#include "acmp_mapping/map/occupancy_map.h"
#include "acmp_mapping/mesh/distance_volume.h"
#include "dataset/test_folder.h"
#include "map/room_keyframes.h"
#include "support/error_text.h"

namespace acmp::test {
namespace {

constexpr double kVoxel = 0.02;
constexpr size_t kEnough = 2000000000;

std::vector<SyntheticView> Room() { return MakeSyntheticScene({160, 120, 6}); }

void AddTo(MapStore* store, const PlacedKeyframes& keyframes) {
  for (size_t i = 0; i < keyframes.keyframes.size(); ++i) {
    const PlacedKeyframe& keyframe = keyframes.keyframes[i];
    EXPECT_TRUE(store->Add({"mapper", 0, i}, {static_cast<int64_t>(i) * 1000000000, keyframe.world_from_cam, {}},
                           keyframe.points_in_camera->Unpack()));
  }
}

TEST(MapMeshTest, IsTheRoomsSurface) {
  const std::vector<SyntheticView> views = Room();
  MapStore store({100, kVoxel});
  AddTo(&store, RoomKeyframes(views, kVoxel));
  const MapMesh map = MakeMapMesh(store, {0, kEnough});
  EXPECT_EQ(map.keyframes, views.size());
  const TriangleMesh& mesh = map.mesh;
  const PointCloud truth = SampleSyntheticSurface(views, 0.02f);
  const auto metrics = EvaluateCloud(SampleMesh(mesh, 0.02), truth, {0.02, 0.05}, 0.02);
  EXPECT_GT(metrics[0].accuracy, 90);
  EXPECT_GT(metrics[1].accuracy, 98);
  EXPECT_GT(metrics[1].completeness, 90);
}

/// Mesh and occupancy in UTM coordinates, where float32 knows half metres only.
TEST(MapMeshTest, FarFromTheOriginItIsTheSame) {
  PlacedKeyframes keyframes = RoomKeyframes(Room(), kVoxel);
  const Eigen::Vector3d offset(500000, 5500000, 200);
  MapStore near({100, kVoxel}), far({100, kVoxel});
  AddTo(&near, keyframes);
  for (PlacedKeyframe& keyframe : keyframes.keyframes) keyframe.world_from_cam.translation() += offset;
  AddTo(&far, keyframes);
  const MapMesh expected = MakeMapMesh(near, {0.04, kEnough}), map = MakeMapMesh(far, {0.04, kEnough});
  EXPECT_NEAR(static_cast<double>(map.mesh.triangles.size()), static_cast<double>(expected.mesh.triangles.size()),
              0.01 * static_cast<double>(expected.mesh.triangles.size()));
  const auto middle = [](const MapMesh& m) {
    Eigen::AlignedBox3d box;
    for (const SurfacePoint& v : m.mesh.vertices) box.extend(InWorld(m.origin, v.position));
    return Eigen::Vector3d(box.center());
  };
  EXPECT_LT((middle(map) - offset - middle(expected)).norm(), 0.04);
  const auto cells = [](const MapStore& store) {
    return static_cast<double>(MakeOccupancyMap(store.Placed(), 0.1)->voxels());
  };
  EXPECT_NEAR(cells(far), cells(near), 0.05 * cells(near)) << "the grid lies in another way";
}

constexpr int kColmapViews = 5;
constexpr double kColmapVoxel = 0.03;
constexpr int64_t kFirstStamp_ns = 1700000000000000007;

const std::vector<SyntheticView>& ColmapRoom() {
  static const std::vector<SyntheticView> views = MakeSyntheticScene({160, 120, kColmapViews});
  return views;
}

class MapColmapTest : public TestFolder {
 protected:
  MapColmapTest() {
    for (size_t i = 0; i < map_.keyframes.size(); ++i) {
      PlacedKeyframe& keyframe = map_.keyframes[i];
      keyframe.camera = ColmapRoom()[i].frame.camera;
      keyframe.stamp_ns = kFirstStamp_ns + static_cast<int64_t>(i) * 100000000;
      keyframe.key.mapper = "/acmp/dense_mapper";
      keyframe.image = Put(ColmapRoom()[i].frame.color);
    }
  }
  StoredImagePtr Put(const ColorImage& image) {
    return images_.Put(EncodeJpeg("image", image), ColmapRoom()[0].frame.camera);
  }
  std::filesystem::path Path() const { return folder() / "room.colmap"; }
  std::string Refusal() const {
    return MessageOf<InvalidInputError>([&] { WriteColmapFolder(Path(), map_); });
  }

  PlacedKeyframes map_ = RoomKeyframes(ColmapRoom(), kColmapVoxel);
  ImageStore images_{folder()};
};

TEST_F(MapColmapTest, TheModelHasImagesPosesAndPointsWithTracks) {
  std::reverse(map_.keyframes.begin(), map_.keyframes.end());
  const ColmapFolder written = WriteColmapFolder(Path(), map_);
  EXPECT_EQ(written.images, static_cast<size_t>(kColmapViews));
  EXPECT_EQ(written.without_image + written.without_points, 0u);
  const Scene scene = ReadScene(Path(), SceneFormat::kColmap);
  ASSERT_EQ(scene.images.size(), static_cast<size_t>(kColmapViews));
  EXPECT_EQ(scene.images[0].name, "1700000000_000000007_acmp_dense_mapper.jpg");
  EXPECT_EQ(scene.images[3].name, "1700000000_300000007_acmp_dense_mapper.jpg");
  EXPECT_EQ(scene.landmarks_in_world.size(), written.points);
  EXPECT_GT(written.points, 0.95 * static_cast<double>(CloudOf(map_).points.size())) << "each of its own keyframe";
  std::vector<int> views(written.points);
  size_t seen = 0, right = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const SyntheticView& view = ColmapRoom()[i];
    const SceneImage& image = scene.images[i];
    EXPECT_TRUE(image.cam_from_world.isApprox(view.frame.cam_from_world, 1e-9));
    EXPECT_TRUE(image.camera == view.frame.camera);
    EXPECT_EQ(ReadText(image.path), map_.keyframes[kColmapViews - 1 - i].image->Read());
    for (int landmark : image.landmark_indices) {
      const Eigen::Vector3d p = image.cam_from_world * scene.landmarks_in_world[landmark];
      const Eigen::Vector2d pixel = image.camera.Project(p);
      const float truth =
          view.true_depth(static_cast<int>(std::floor(pixel.x() + 0.5)), static_cast<int>(std::floor(pixel.y() + 0.5)));
      ++views[landmark], ++seen;
      right += std::abs(truth - p.z()) <= 0.05 * truth ? 1 : 0;
    }
  }
  EXPECT_GT(right, 0.97 * static_cast<double>(seen)) << "not what is hidden; the rest lies at outlines";
  EXPECT_GT(std::count_if(views.begin(), views.end(), [](int count) { return count > 1; }), 0.5 * written.points);
}

TEST_F(MapColmapTest, ScalesCountAndImagesMayBeLarger) {
  WriteColmapFolder(folder() / "as_it_is.colmap", map_);
  for (PlacedKeyframe& keyframe : map_.keyframes) {
    keyframe.points_in_camera = std::make_shared<const PackedCloud>(Scaled(keyframe.points_in_camera->Unpack(), 0.5));
    keyframe.scale = 2;
  }
  ColorImage large(320, 240);
  map_.keyframes[1].image = Put(large);
  WriteColmapFolder(Path(), map_);
  const Scene before = ReadScene(folder() / "as_it_is.colmap"), scene = ReadScene(Path());
  EXPECT_EQ(before.landmarks_in_world.size(), scene.landmarks_in_world.size());
  EXPECT_TRUE(scene.images[1].camera == ColmapRoom()[1].frame.camera.Resized(320, 240));
  EXPECT_GT(scene.images[1].landmark_indices.size(), 1000u);
}

TEST_F(MapColmapTest, WhatHasNoImageOrPointsIsLeftOutAndCounted) {
  map_.keyframes[0].image.reset();
  map_.keyframes[2].points_in_camera = std::make_shared<const PackedCloud>();
  map_.keyframes[1].key.mapper += std::string(230, 'r');
  map_.keyframes[4].stamp_ns = map_.keyframes[3].stamp_ns;  // of another run
  const ColmapFolder written = WriteColmapFolder(Path(), map_);
  EXPECT_THAT(std::vector<size_t>({written.images, written.without_image, written.without_points}),
              ElementsAre(3, 1, 1));
  const Scene scene = ReadScene(Path());
  EXPECT_EQ(scene.images[0].name, "1700000000_100000007_acmp_dense_mapper" + std::string(83, 'r') + ".jpg");
  EXPECT_EQ(scene.images[2].name, "1700000000_300000007_acmp_dense_mapper_2.jpg");
}

TEST_F(MapColmapTest, ItIsWrittenWholeOrNotAtAll) {
  WriteText("room.colmap/notes.txt", "mine");
  EXPECT_THAT(Refusal(), HasSubstr("notes.txt was not written by this program"));
  EXPECT_EQ(ReadText(Path() / "notes.txt"), "mine");
  std::filesystem::remove_all(Path());
  int calls = 0;
  const auto stop_at_third = [&] {
    if (++calls == 3) throw ProcessingError("stopped");
  };
  EXPECT_EQ(MessageOf<ProcessingError>([&] { WriteColmapFolder(Path(), map_, stop_at_third); }), "stopped");
  EXPECT_TRUE(std::filesystem::is_empty(folder()));
  WriteColmapFolder(Path(), map_);
  {
    const FileSizeLimit limit(1000);
    EXPECT_THAT(MessageOf<ProcessingError>([&] { WriteColmapFolder(Path(), map_); }), HasSubstr("cannot write"));
  }
  EXPECT_EQ(ReadScene(Path()).images.size(), static_cast<size_t>(kColmapViews));
  map_.keyframes.resize(3);
  WriteText("room.colmap/scene.mvs", "of another program");
  EXPECT_THAT(Refusal(), HasSubstr("scene.mvs was not written by this program"));
  std::filesystem::remove(Path() / "scene.mvs");
  WriteColmapFolder(Path(), map_);
  EXPECT_EQ(ReadScene(Path()).images.size(), 3u);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder()), {}), 1);
  for (PlacedKeyframe& keyframe : map_.keyframes) keyframe.image.reset();
  EXPECT_THAT(Refusal(), HasAll("3 keyframes and no image of them", "~keep_images"));
  map_.keyframes.clear();
  EXPECT_THAT(Refusal(), HasSubstr("the map is empty"));
  EXPECT_EQ(ReadScene(Path()).images.size(), 3u);
}

TEST_F(MapColmapTest, StoredImagesUseTheDiskThatOthersLeft) {
  const auto bytes_of = [](unsigned char shade) {
    return EncodeJpeg("image", ColorImage(160, 120, Rgb{shade, shade, shade}));
  };
  const PinholeCamera& camera = ColmapRoom()[0].frame.camera;
  ImageStore store(folder());
  std::vector<StoredImagePtr> kept;
  for (unsigned char i = 0; i < 4; ++i) kept.push_back(store.Put(bytes_of(i), camera));
  kept[1].reset();
  kept.push_back(store.Put(bytes_of(9), camera));
  kept.push_back(store.Put(bytes_of(7), camera));
  for (const auto& [place, shade] : {std::pair<int, int>{0, 0}, {2, 2}, {3, 3}, {4, 9}, {5, 7}}) {
    EXPECT_TRUE(kept[place]->Read() == bytes_of(static_cast<unsigned char>(shade))) << place;
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder())) << "nothing is left by a process that is killed";
  EXPECT_REFUSED(store.Put("\x89PNG", camera), "is no JPEG file");
  EXPECT_REFUSED(store.Put("\xff\xd8", camera), "image");
  EXPECT_REFUSED(store.Put(EncodeJpeg("", ColorImage(120, 160)), camera),
                 "120 x 160 px: must have the shape of its maps, 160 x 120");
  EXPECT_THAT(MessageOf<ProcessingError>([&] { ImageStore(folder() / "none").Put(bytes_of(1), camera); }),
              HasAll("cannot keep images of keyframes in", "No such file"));
  {
    const FileSizeLimit limit(100);
    EXPECT_THAT(MessageOf<ProcessingError>([&] { store.Put(bytes_of(2), camera); }), HasSubstr("File too large"));
  }
  EXPECT_TRUE(store.Put(bytes_of(2), camera)->Read() == bytes_of(2)) << "and goes on";
}

/// A map with room for four images and a half.
class MapImagesTest : public MapColmapTest {
 protected:
  MapImagesTest() {
    MapStoreOptions options = {100, kColmapVoxel};
    options.max_image_bytes = 4 * bytes_ + bytes_ / 2;
    store_ = std::make_unique<MapStore>(options);
  }
  void Add(const std::string& mapper, uint64_t id, int64_t stamp_ns, uint64_t view = 0) {
    const PlacedKeyframe& keyframe = map_.keyframes[0];
    KeyframePose pose;
    pose.stamp_ns = stamp_ns;
    pose.world_from_capture = keyframe.world_from_cam;
    pose.camera = keyframe.camera;
    pose.view = view;
    ASSERT_TRUE(store_->Add({mapper, 1, id}, pose, keyframe.points_in_camera->Unpack(), keyframe.image));
    ASSERT_LE(store_->statistics().image_bytes, 4 * bytes_ + bytes_ / 2);
  }
  std::vector<uint64_t> Kept() const {
    std::vector<uint64_t> ids;
    for (const SessionKeyframe& keyframe : store_->Session().keyframes) {
      if (keyframe.image) ids.push_back(keyframe.key.id);
    }
    return ids;
  }

  const uint64_t bytes_ = map_.keyframes[0].image->bytes();
  std::unique_ptr<MapStore> store_;
};

TEST_F(MapImagesTest, OfTooManyEverySecondGoes) {
  std::vector<std::vector<uint64_t>> after;
  for (uint64_t id = 0; id < 12; ++id) {
    Add("mapper", id, static_cast<int64_t>(id));
    after.push_back(Kept());
  }
  EXPECT_THAT(after[3], ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(after[4], ElementsAre(0, 2, 4));
  EXPECT_THAT(Kept(), ElementsAre(0, 4, 8));
  EXPECT_EQ(store_->statistics().images, 3u);
  EXPECT_EQ(store_->statistics().image_bytes, 3 * bytes_);
  EXPECT_EQ(store_->statistics().image_stride, 4u);
  store_->Clear();
  EXPECT_EQ(store_->statistics().image_stride, 1u);
}

TEST_F(MapImagesTest, IdsOfOneParityAreThinnedLikeOthers) {
  for (uint64_t i = 0; i < 12; ++i) Add("mapper", 2 * i + 1, static_cast<int64_t>(i));
  EXPECT_THAT(Kept(), ElementsAre(1, 9, 17));
}

TEST_F(MapImagesTest, ViewsOfOneCaptureStayTogetherAndMappersEach) {
  for (uint64_t i = 0; i < 4; ++i) Add("pair", i, static_cast<int64_t>(i / 2), i % 2);
  Add("alone", 100, 0);  // one too many
  EXPECT_THAT(Kept(), ::testing::UnorderedElementsAre(100, 0, 1));
}

TEST_F(MapImagesTest, NeverTakeMoreThanTheyMay) {
  for (uint64_t i = 0; i < 12; ++i) Add(Concat("mapper_", i), 0, 0);
  EXPECT_EQ(Kept().size(), 4u);
  for (uint64_t i = 0; i < 12; ++i) Add("mapper_0", 1 + i, 0, 1 + i);  // all of one capture
  EXPECT_EQ(Kept().size(), 4u);
}

TEST_F(MapImagesTest, ASessionIsJoinedWithAllOfThemOrNotAtAll) {
  for (uint64_t id = 0; id < 3; ++id) Add("mapper", id, static_cast<int64_t>(id));
  MapSession session = store_->Session();
  for (SessionKeyframe& keyframe : session.keyframes) keyframe.key.id += 10;
  EXPECT_REFUSED(store_->Join(session, RigidTransform::Identity()), "images");
  EXPECT_EQ(store_->statistics().keyframes, 3u);
  session.keyframes.resize(1);
  store_->Join(session, RigidTransform::Identity());
  EXPECT_THAT(Kept(), ElementsAre(0, 1, 2, 10));
}

}  // namespace
}  // namespace acmp::test
