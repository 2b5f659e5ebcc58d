#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "acmp_mapping/evaluation/synthetic_scene.h"
#include "evaluation/named_scene.h"
#include "support/error_text.h"

namespace acmp {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

const std::vector<SyntheticView>& LargeViews() {
  static const std::vector<SyntheticView> kViews = MakeSyntheticScene(NamedScene("hard", 640, 480, 3));
  return kViews;
}

TEST(HardScene, HasTheExposuresOfAVideoAndBlankSurfacesLikeAnOffice) {
  const std::vector<SyntheticView> views = MakeSyntheticScene(NamedScene("hard", 120, 90, 14));
  double least = 10, most = 0;
  for (const SyntheticView& view : views) {
    least = std::min(least, view.exposure);
    most = std::max(most, view.exposure);
    const auto blank = std::count(view.low_texture.begin(), view.low_texture.end(), 1);
    const double share = static_cast<double>(blank) / view.low_texture.size();
    EXPECT_GT(share, 0.25);
    EXPECT_LT(share, 0.50);
  }
  EXPECT_GT(most, 1.5 * least);  // of 14 draws between 0.67 and 1.5
}

TEST(HardScene, LandmarksLieOnTexture) {
  for (const SyntheticView& view : LargeViews()) {
    int blank = 0;
    for (const Vector3d& landmark : view.frame.landmarks_in_world) {
      const Vector2d pixel = view.frame.camera.Project(view.frame.cam_from_world * landmark);
      blank += view.low_texture(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
    }
    const size_t landmarks = view.frame.landmarks_in_world.size();
    EXPECT_GE(landmarks, 30u);
    // Their error of some millimetres moves some at the edge of a surface past it.
    EXPECT_LT(blank, 0.1 * landmarks);
  }
}

TEST(SelectSyntheticScene, SetsPlaceAndCameraOnly) {
  SyntheticSceneOptions options;
  options.width = 77;
  options.seed = 5;
  SelectSyntheticScene("hard", &options);
  EXPECT_EQ(options.place, SyntheticPlace::kOffice);
  EXPECT_GT(options.imaging.grey_per_electron, 0);
  EXPECT_EQ(options.width, 77);
  EXPECT_EQ(options.seed, 5u);
  SelectSyntheticScene("room", &options);
  EXPECT_EQ(options.place, SyntheticPlace::kRoom);
  EXPECT_EQ(options.imaging.grey_per_electron, 0);
  for (const std::string& name : SyntheticSceneNames()) EXPECT_NO_THROW(SelectSyntheticScene(name, &options));
  EXPECT_EQ(ErrorOf([&] { SelectSyntheticScene("kitchen", &options); }),
            "scene = \"kitchen\": must be one of room, hard, street");
}

}  // namespace
}  // namespace acmp
