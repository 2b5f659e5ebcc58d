#include "acmp_mapping/engine/host_depth_engine.h"

#include <algorithm>
#include <random>

#include "support/engine_scene.h"
#include "support/error_text.h"
#include "support/pass_result.h"

namespace acmp {
namespace {

constexpr DepthRange kRange = {1, 10};

/// Another plane and cost for every pixel.
PlaneHypothesis PlaneAt(int col, int row) {
  return {0, 0, -1, 2 + 0.01f * static_cast<float>(col) + 0.1f * static_cast<float>(row)};
}
float CostAt(int col, int row) { return 0.001f * static_cast<float>(10 * row + col); }

EstimateState VaryingState(const PinholeCamera& camera) {
  EstimateState state = {PlaneMap(camera.width, camera.height), CostMap(camera.width, camera.height)};
  for (int row = 0; row < camera.height; ++row) {
    for (int col = 0; col < camera.width; ++col) {
      state.planes(col, row) = PlaneAt(col, row);
      state.cost(col, row) = CostAt(col, row);
    }
  }
  return state;
}

FramePtr RandomFrame(int id, int width, int height) {
  std::mt19937 random(static_cast<unsigned>(id));
  std::uniform_real_distribution<float> gray(0, 255);
  Frame frame;
  frame.id = id;
  frame.camera = TestCamera(width, height);
  frame.cam_from_world = LookAhead({0.2 * id, 0, 0}, 0, 0, 0);
  frame.color = ColorImage(width, height, {10, static_cast<unsigned char>(id), 30});
  frame.gray = GrayImage(width, height);
  for (float& pixel : frame.gray) pixel = gray(random);
  return std::make_shared<const Frame>(std::move(frame));
}

/// An engine, a reference of odd size and a source of another size.
class HostDepthEngineTest : public ::testing::Test {
 protected:
  EngineView View(const FramePtr& frame, int levels = 0) { return {frame, engine_.Load(frame, levels), nullptr}; }
  EngineProblem Problem(int levels = 0) { return {View(reference_, levels), {View(source_, levels)}, kRange}; }
  EngineEstimatePtr EstimateOf(const FramePtr& frame, const PlaneHypothesis& plane, float cost) {
    const PinholeCamera& camera = frame->camera;
    return engine_.UploadState(
        {PlaneMap(camera.width, camera.height, plane), CostMap(camera.width, camera.height, cost)}, camera);
  }

  EngineEstimatePtr Varying(int level = 0) {
    const PinholeCamera camera = CameraAtLevel(reference_->camera, level);
    return engine_.UploadState(VaryingState(camera), camera);
  }

  HostDepthEngine engine_;
  const FramePtr reference_ = RandomFrame(0, 15, 11), source_ = RandomFrame(1, 12, 9);
};

/// Of means of 2 x 2 pixels.
FramePtr HalvedFrame(const Frame& frame) {
  Frame halved;
  halved.id = frame.id;
  halved.camera = frame.camera.Halved();
  halved.cam_from_world = frame.cam_from_world;
  halved.gray = GrayImage(halved.camera.width, halved.camera.height);
  for (int row = 0; row < halved.camera.height; ++row) {
    for (int col = 0; col < halved.camera.width; ++col) {
      const auto at = [&](int x, int y) { return frame.gray(2 * col + x, 2 * row + y); };
      halved.gray(col, row) = (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4;
    }
  }
  return std::make_shared<const Frame>(std::move(halved));
}

TEST_F(HostDepthEngineTest, LevelsAreMeansOfTwoByTwoPixels) {
  const EngineProblem problem = Problem(2);
  FramePtr reference = reference_, source = source_;
  for (int level = 0; level <= 2; ++level) {
    const EngineProblem halved = {View(reference), {View(source)}, kRange};
    EXPECT_TRUE(SameBits(engine_.DownloadState(engine_.RunPhotometric(problem, {}, level)),
                         engine_.DownloadState(engine_.RunPhotometric(halved, {}, 0))))
        << level;
    reference = HalvedFrame(*reference);
    source = HalvedFrame(*source);
  }
}

TEST_F(HostDepthEngineTest, UpsampledPixelsAreThoseThatCoverThem) {
  for (const int level : {0, 1, 2}) {
    const EngineEstimatePtr halved = Varying(level);
    const EngineEstimatePtr full = engine_.Upsample(halved, reference_, level);
    const EstimateState state = engine_.DownloadState(full);
    const EstimateMaps maps = engine_.Download(full);
    ASSERT_EQ(state.planes.width(), 15);
    ASSERT_EQ(state.planes.height(), 11);
    // 15 x 11, 7 x 5, 3 x 2: the odd last column and row belong to the one before.
    const int last_col = std::vector<int>{14, 6, 2}[static_cast<size_t>(level)];
    const int last_row = std::vector<int>{10, 4, 1}[static_cast<size_t>(level)];
    for (int row = 0; row < 11; ++row) {
      for (int col = 0; col < 15; ++col) {
        const int from_col = std::min(col / (1 << level), last_col), from_row = std::min(row / (1 << level), last_row);
        const float d = PlaneAt(from_col, from_row).d;
        ASSERT_EQ(state.planes(col, row).d, d) << level << ": " << col << ", " << row;
        ASSERT_EQ(state.cost(col, row), CostAt(from_col, from_row));
        ASSERT_FLOAT_EQ(maps.depth(col, row), d);  // the planes face the camera
      }
    }
  }
}

struct ForeignImage final : EngineImage {};
struct ForeignEstimate final : EngineEstimate {};

TEST_F(HostDepthEngineTest, NullAndForeignImagesAndEstimatesAreRefused) {
  EXPECT_THROW(engine_.Load(nullptr, 0), InvalidInputError);
  const EngineEstimatePtr start = EstimateOf(reference_, {0, 0, -1, 3}, 0);
  const auto expect_refused = [&](const EngineProblem& bad, const char* message) {
    EXPECT_REFUSED(engine_.RunPhotometric(bad, {}, 0), message);
    EXPECT_REFUSED(engine_.RunPlanarPrior(bad, {}, start, {}), message);
    EXPECT_REFUSED(engine_.RunGeometric(bad, {}, start, 0), message);
  };
  for (const EngineImagePtr& bad : {EngineImagePtr(), EngineImagePtr(std::make_shared<ForeignImage>())}) {
    EngineProblem bad_reference = Problem(), bad_source = Problem();
    bad_reference.reference.image = bad;
    bad_source.sources[0].image = bad;
    expect_refused(bad_reference, "null");
    expect_refused(bad_source, "null");
  }
  EngineProblem no_frame = Problem(), foreign = Problem();
  no_frame.sources[0].frame = nullptr;
  expect_refused(no_frame, "source view");
  for (const EngineEstimatePtr& bad : {EngineEstimatePtr(), EngineEstimatePtr(std::make_shared<ForeignEstimate>())}) {
    EXPECT_THROW(engine_.Upsample(bad, reference_, 0), InvalidInputError);
    EXPECT_THROW(engine_.FindSupportPoints(bad, kRange, {}), InvalidInputError);
    EXPECT_THROW(engine_.RunPlanarPrior(Problem(), {}, bad, {}), InvalidInputError);
    EXPECT_THROW(engine_.RunGeometric(Problem(), {}, bad, 0), InvalidInputError);
    EXPECT_THROW(engine_.Download(bad), InvalidInputError);
    EXPECT_THROW(engine_.DownloadState(bad), InvalidInputError);
    EXPECT_THROW(engine_.FilterByConsistency({reference_, nullptr, bad}, {}, {}), InvalidInputError);
  }
  foreign.sources[0].estimate = std::make_shared<ForeignEstimate>();
  EXPECT_THROW(engine_.RunGeometric(foreign, {}, start, 0), InvalidInputError);
  EXPECT_THROW(engine_.FilterByConsistency({reference_, nullptr, start}, foreign.sources, {}), InvalidInputError);
  EXPECT_THROW(engine_.FilterByConsistency({nullptr, nullptr, start}, {}, {}), InvalidInputError);
  EXPECT_NO_THROW(engine_.RunGeometric(Problem(), {}, start, 0)) << "the engine can be used again";
}

}  // namespace
}  // namespace acmp
