#include <cstring>
#include <set>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "dataset/test_folder.h"
#include "gtest/gtest.h"

namespace acmp {
namespace {

class WrittenSceneTest : public TestFolder {
 protected:
  WrittenSceneTest() { WriteSceneFiles(folder(), views_, 0.1f); }

  const std::vector<SyntheticView> views_ = MakeSyntheticScene({97, 64, 5});
};

TEST_F(WrittenSceneTest, IsReadBackWithTheSameCamerasPosesAndLandmarks) {
  const Scene scenes[] = {ReadScene(folder(), SceneFormat::kColmap), ReadScene(folder(), SceneFormat::kMvsnet)};
  for (size_t k = 0; k < 2 * views_.size(); ++k) {
    const Scene& scene = scenes[k % 2];
    const size_t i = k / 2;
    ASSERT_EQ(scene.images.size(), views_.size());
    const Frame& truth = views_[i].frame;
    const SceneImage& image = scene.images[i];
    // Twelve digits in the files, pixels below 1000 and metres below 10.
    EXPECT_EQ(image.camera.width, truth.camera.width);
    EXPECT_LT((image.camera.K() - truth.camera.K()).cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_LT((image.cam_from_world.matrix() - truth.cam_from_world.matrix()).cwiseAbs().maxCoeff(), 1e-10);
    const Frame read = LoadFrame(scene, static_cast<int>(i));
    ASSERT_EQ(read.landmarks_in_world.size(), truth.landmarks_in_world.size());
    // The reader may order an image's landmarks by their number in the scene.
    for (const Eigen::Vector3d& landmark : truth.landmarks_in_world) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const Eigen::Vector3d& other : read.landmarks_in_world) {
        nearest = std::min(nearest, (landmark - other).norm());
      }
      ASSERT_LT(nearest, 1e-9);
    }
    ASSERT_EQ(read.color.size(), truth.color.size());
    EXPECT_EQ(std::memcmp(read.color.data(), truth.color.data(), truth.color.size() * sizeof(Rgb)), 0);
  }
}

TEST_F(WrittenSceneTest, NamesUsefulSourcesAndADepthRangeThatHoldsMostOfTheScene) {
  const Scene scene = ReadScene(folder(), SceneFormat::kMvsnet);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const std::vector<int>& sources = scene.images[i].ranked_sources;
    const std::set<int> distinct(sources.begin(), sources.end());
    EXPECT_EQ(distinct.size(), 4u);  // five views, all overlapping
    EXPECT_EQ(distinct.count(static_cast<int>(i)), 0u);
    ASSERT_TRUE(scene.images[i].depth_range);
    const DepthRange& range = *scene.images[i].depth_range;
    size_t within = 0;
    for (const float depth : views_[i].true_depth) within += depth >= range.min && depth <= range.max;
    EXPECT_GT(within, 0.99 * views_[i].true_depth.size());
  }
}

TEST_F(WrittenSceneTest, HoldsTheGroundTruth) {
  for (size_t i = 0; i < views_.size(); ++i) {
    const SyntheticView& view = views_[i];
    const std::string name = "00000" + std::to_string(i) + ".png";
    const DepthMap depth = ReadDepth(folder() / "depth" / name);
    const ColorImage mask = ReadColorImage(folder() / "low_texture" / name);
    ASSERT_EQ(depth.size(), view.true_depth.size());
    ASSERT_EQ(mask.size(), view.low_texture.size());
    for (size_t p = 0; p < depth.size(); ++p) {
      ASSERT_NEAR(depth.data()[p], view.true_depth.data()[p], 0.000501);  // half a millimetre
      ASSERT_EQ(mask.data()[p].g, view.low_texture.data()[p] ? 255 : 0);
    }
  }
  EXPECT_EQ(ReadPly(folder() / "surface.ply").vertices.size(), SampleSyntheticSurface(views_, 0.1f).size());
  EXPECT_EQ(ReadPly(folder() / "sparse.ply").vertices.size(), ReadScene(folder()).landmarks_in_world.size());
}

}  // namespace
}  // namespace acmp
