// Poses that put matches near enough to the right lines, and yet are those of other images.

#include <gmock/gmock.h>

#include <opencv2/core.hpp>

#include "acmp_mapping/image/image_processing.h"
#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "run.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kImages = 12;

const std::vector<SyntheticView>& Room() {
  static const std::vector<SyntheticView> views = MakeSyntheticScene({160, 120, kImages});
  return views;
}

/// What is said of these images of the room with the poses of others, by their places in it.
std::string Doubt(const std::vector<int>& images, const std::vector<int>& poses, std::optional<int> flip = {}) {
  Scene scene;
  ReconstructPlan plan;
  std::vector<FramePtr> frames;
  for (size_t i = 0; i < images.size(); ++i) {
    const Frame& image = Room()[static_cast<size_t>(images[i])].frame;
    Frame frame;
    frame.id = static_cast<int64_t>(i);
    frame.camera = image.camera;
    frame.gray = image.gray.Clone();
    if (flip) cv::flip(AsMat(frame.gray), AsMat(frame.gray), *flip);
    frame.cam_from_world = Room()[static_cast<size_t>(poses[i])].frame.cam_from_world;
    frames.push_back(std::make_shared<const Frame>(std::move(frame)));
    scene.images.emplace_back();
    plan.images.emplace_back();
    plan.images.back().index = static_cast<int>(i);
    plan.images.back().range = {0.5f, 9};
  }
  FrameStore store(std::move(frames));
  return DescribePoseDoubt(scene, plan, &store);
}

std::vector<int> Places(int first, int step, int count = kImages) {
  std::vector<int> places;
  for (int i = 0; i < count; ++i) places.push_back(first + step * i);
  return places;
}

TEST(PoseDoubtTest, GoodPosesAreNotDoubtedInAnyOrderOfTheImages) {
  EXPECT_THAT(Doubt(Places(0, 1), Places(0, 1)), IsEmpty());
  const std::vector<int> shuffled = {7, 2, 9, 0, 5, 11, 3, 8, 1, 10, 4, 6};
  EXPECT_THAT(Doubt(shuffled, shuffled), IsEmpty());
}

TEST(PoseDoubtTest, ImagesThatAreLateAreToldByHowMany) {
  EXPECT_THAT(Doubt(Places(3, 1, 9), Places(0, 1, 9)), HasSubstr("of the image 3 later in the list"));
  EXPECT_THAT(Doubt(Places(0, 1, 11), Places(1, 1, 11)), HasSubstr("of the image 1 before in the list"));
}

TEST(PoseDoubtTest, FlippedImagesAreTold) {
  EXPECT_THAT(Doubt(Places(0, 1), Places(0, 1), 1), HasSubstr("the images are mirrored"));
  EXPECT_THAT(Doubt(Places(0, 1), Places(0, 1), -1), HasSubstr("turned by 180 degrees"));
}

TEST(PoseDoubtTest, AnotherOrderIsTold) {
  EXPECT_THAT(Doubt(Places(0, 1), Places(kImages - 1, -1)), HasSubstr("in reverse order"));
  const std::vector<int> shuffled = {7, 2, 9, 0, 5, 11, 3, 8, 1, 10, 4, 6};
  EXPECT_THAT(Doubt(shuffled, Places(0, 1)), HasSubstr("those of other images"));
}

TEST(PoseDoubtTest, TooFewImagesAreNotDoubted) {
  EXPECT_THAT(Doubt(Places(0, 1, 4), Places(0, 1, 4)), IsEmpty());
  EXPECT_THAT(Doubt(Places(0, 1, 1), Places(0, 1, 1)), IsEmpty());
}

}  // namespace
}  // namespace acmp
