#include "acmp_mapping/engine/host_depth_engine.h"

#include <algorithm>
#include <random>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/cells.h"
#include "acmp_mapping/patch_match/kernel/upsample.h"
#include "acmp_mapping/patch_match/match_setup.h"
#include "support/pass_result.h"
#include "support/planar_scene.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;

constexpr DepthRange kRange = {1, 10};

/// Keeps what it was asked, and answers with another plane and cost for every pixel.
class SpyPatchMatch final : public PatchMatch {
 public:
  PatchMatchResult RunPhotometric(const PatchMatchProblem& problem, const PatchMatchOptions&) override {
    return Answer(problem);
  }
  PatchMatchResult RunPlanarPrior(const PatchMatchProblem& problem, const PatchMatchOptions&,
                                  const PatchMatchResult& start, ImageView<const PlaneHypothesis> prior) override {
    last_start = start.Clone();
    last_prior_d = prior(1, 1).d;
    return Answer(problem);
  }
  PatchMatchResult RunGeometric(const PatchMatchProblem& problem, const PatchMatchOptions&,
                                const PatchMatchResult& start, int pass) override {
    last_start = start.Clone();
    last_pass = pass;
    return Answer(problem);
  }
  Image<float> MeasureEvidence(const PatchMatchProblem&, const PlaneMap& planes, int cell_size) override {
    return Image<float>(CellsOf(planes.width(), cell_size), CellsOf(planes.height(), cell_size));
  }
  PatchMatchTiming last_timing() const override { return {100, 7, 100}; }
  std::string device_name() const override { return "spy"; }

  static PlaneHypothesis PlaneAt(int col, int row) {
    return {0, 0, -1, 2 + 0.01f * static_cast<float>(col) + 0.1f * static_cast<float>(row)};
  }
  static float CostAt(int col, int row) { return 0.001f * static_cast<float>(10 * row + col); }

  PatchMatchProblem last_problem;  ///< its pixels belong to the caller
  PatchMatchResult last_start;
  float last_prior_d = 0;
  int last_pass = -1;

 private:
  PatchMatchResult Answer(const PatchMatchProblem& problem) {
    Check(problem);
    last_problem = problem;
    const int width = problem.reference.camera.width, height = problem.reference.camera.height;
    PatchMatchResult result = {PlaneMap(width, height), CostMap(width, height), Image<uint32_t>(width, height)};
    for (int row = 0; row < height; ++row) {
      for (int col = 0; col < width; ++col) {
        result.planes(col, row) = PlaneAt(col, row);
        result.cost(col, row) = CostAt(col, row);
      }
    }
    return result;
  }
};

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

template <class Work>
std::string ErrorOf(const Work& work) {
  try {
    work();
  } catch (const InvalidInputError& error) {
    return error.what();
  }
  return "no error";
}

/// An engine over the spy, a reference of odd size and a source of another size.
class HostDepthEngineTest : public ::testing::Test {
 protected:
  EngineView View(const FramePtr& frame, int levels = 0) { return {frame, engine_.Load(frame, levels), nullptr}; }
  EngineProblem Problem(int levels = 0) { return {View(reference_, levels), {View(source_, levels)}, kRange}; }
  EngineEstimatePtr EstimateOf(const FramePtr& frame, const PlaneHypothesis& plane, float cost) {
    const PinholeCamera& camera = frame->camera;
    return engine_.UploadState(
        {PlaneMap(camera.width, camera.height, plane), CostMap(camera.width, camera.height, cost)}, camera);
  }

  SpyPatchMatch spy_;
  HostDepthEngine engine_{&spy_};
  const FramePtr reference_ = RandomFrame(0, 15, 11), source_ = RandomFrame(1, 12, 9);
};

/// The level below a halved image, pixel by pixel.
void ExpectHalved(const ImageView<const float>& halved, const ImageView<const float>& image) {
  ASSERT_EQ(halved.width, image.width / 2);
  ASSERT_EQ(halved.height, image.height / 2);
  for (int row = 0; row < halved.height; ++row) {
    for (int col = 0; col < halved.width; ++col) {
      double sum = 0;
      for (const int from_row : {2 * row, 2 * row + 1}) {
        for (const int from_col : {2 * col, 2 * col + 1}) sum += image(from_col, from_row);
      }
      ASSERT_FLOAT_EQ(halved(col, row), static_cast<float>(sum / 4)) << col << ", " << row;
    }
  }
}

TEST_F(HostDepthEngineTest, LevelsAreMeansOfTwoByTwoPixels) {
  const EngineProblem problem = Problem(2);
  engine_.RunPhotometric(problem, {}, 0);
  EXPECT_EQ(spy_.last_problem.reference.gray.data, reference_->gray.data());
  engine_.RunPhotometric(problem, {}, 1);
  const PatchMatchProblem once = spy_.last_problem;
  ExpectHalved(once.reference.gray, reference_->gray.View());
  ExpectHalved(once.sources[0].gray, source_->gray.View());
  EXPECT_TRUE(once.reference.camera == reference_->camera.Halved());
  EXPECT_TRUE(once.sources[0].camera == source_->camera.Halved());
  engine_.RunPhotometric(problem, {}, 2);
  ExpectHalved(spy_.last_problem.reference.gray, once.reference.gray);
  ExpectHalved(spy_.last_problem.sources[0].gray, once.sources[0].gray);
  EXPECT_TRUE(spy_.last_problem.reference.camera == reference_->camera.Halved().Halved());
}

TEST_F(HostDepthEngineTest, LevelsThatAreNotThereAreRefused) {
  for (const int bad : {-1, kMaxLevels + 1}) {
    const std::string level = Concat(" = ", bad);
    EXPECT_THAT(ErrorOf([&] { engine_.Load(reference_, bad); }), HasSubstr("levels" + level));
    EXPECT_THAT(ErrorOf([&] { engine_.RunPhotometric(Problem(2), {}, bad); }), HasSubstr("level" + level));
    EXPECT_THAT(ErrorOf([&] { engine_.Upsample(EstimateOf(reference_, {}, 0), reference_, bad); }),
                HasSubstr("level" + level));
  }
  EXPECT_THAT(ErrorOf([&] { engine_.RunPhotometric(Problem(1), {}, 2); }), HasSubstr("loaded with 1"));
  EngineProblem shallow_source = Problem(2);
  shallow_source.sources[0].image = engine_.Load(source_, 0);
  EXPECT_THAT(ErrorOf([&] { engine_.RunPhotometric(shallow_source, {}, 1); }), HasSubstr("loaded with 0"));
}

TEST_F(HostDepthEngineTest, ImagesThatAreTooSmallToBeHalvedAreRefused) {
  const FramePtr flat = RandomFrame(2, 12, 3);  // 12 x 3, 6 x 1, 3 x 0
  const EngineProblem problem = {View(flat, 1), {View(source_, 1)}, kRange};
  EXPECT_NO_THROW(engine_.RunPhotometric(problem, {}, 1));
  EXPECT_THAT(ErrorOf([&] { engine_.Load(flat, 2); }), HasSubstr("3 x 0"));
}

TEST_F(HostDepthEngineTest, UpsampledPixelsAreThoseThatCoverThem) {
  for (const int level : {0, 1, 2}) {
    const EngineEstimatePtr halved = engine_.RunPhotometric(Problem(2), {}, level);
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
        const float d = SpyPatchMatch::PlaneAt(from_col, from_row).d;
        ASSERT_EQ(state.planes(col, row).d, d) << level << ": " << col << ", " << row;
        ASSERT_EQ(state.cost(col, row), SpyPatchMatch::CostAt(from_col, from_row));
        ASSERT_FLOAT_EQ(maps.depth(col, row), d);  // the planes face the camera
      }
    }
  }
}

TEST_F(HostDepthEngineTest, UpsampledPlanesStayInFrontOfTheCamera) {
  // A plane through depth 3 on the covering pixel's ray that the ray of the pixel itself does not meet in front.
  const RayGrid rays = MakeRayGrid(reference_->camera);
  const RayGrid halved_rays = MakeRayGrid(reference_->camera.Halved());
  const Vec3f covering_ray = halved_rays.Ray(1, 1), ray = rays.Ray(3, 2);
  const Vec3f beside = Cross(covering_ray, Vec3f{0, 1, 0});
  // Almost along the covering ray, turned by a hundredth of the way to the pixel's.
  Vec3f normal = Normalized(beside);
  if (Dot(normal, ray) < 0) normal = -1.0f * normal;
  normal = Normalized(normal - 0.25f * Dot(normal, ray) / Dot(covering_ray, covering_ray) * covering_ray);
  const PlaneHypothesis edge_on = PlaneThrough(normal, covering_ray, 3);
  ASSERT_GT(edge_on.d, 0);
  ASSERT_LT(PlaneDepth(edge_on, ray), 0);
  const PlaneHypothesis upsampled = UpsamplePlane(edge_on, covering_ray, ray);
  EXPECT_GT(upsampled.d, 0);
  EXPECT_FLOAT_EQ(PlaneDepth(upsampled, ray), 3);
  // One that keeps its depth within a factor of two is taken as it is.
  const PlaneHypothesis slanted = PlaneThrough(Normalized(Vec3f{0.6f, 0, -0.8f}), covering_ray, 3);
  EXPECT_EQ(UpsamplePlane(slanted, covering_ray, ray).nx, slanted.nx);
}

TEST_F(HostDepthEngineTest, UpsamplingAnotherSizeIsRefused) {
  const EngineEstimatePtr halved = engine_.RunPhotometric(Problem(1), {}, 1);
  EXPECT_THAT(ErrorOf([&] { engine_.Upsample(halved, reference_, 2); }), HasSubstr("7 x 5"));
  EXPECT_THAT(ErrorOf([&] { engine_.Upsample(halved, source_, 1); }), HasSubstr("7 x 5"));
  EXPECT_THROW(engine_.Upsample(halved, nullptr, 1), InvalidInputError);
}

TEST_F(HostDepthEngineTest, StateGoesThereAndBack) {
  const EngineEstimatePtr estimate = engine_.RunPhotometric(Problem(), {}, 0);
  const EngineEstimatePtr again = engine_.UploadState(engine_.DownloadState(estimate), reference_->camera);
  EXPECT_TRUE(SameBits(engine_.DownloadState(estimate), engine_.DownloadState(again)));
  const EstimateMaps before = engine_.Download(estimate), after = engine_.Download(again);
  EXPECT_TRUE(SamePixels(before.depth, after.depth));
  EXPECT_TRUE(SamePixels(before.normal, after.normal));
  EXPECT_TRUE(SamePixels(before.cost, after.cost));
  EXPECT_FLOAT_EQ(before.depth(3, 4), SpyPatchMatch::PlaneAt(3, 4).d);
  EXPECT_EQ(before.normal(3, 4).z, -1);
  EXPECT_EQ(before.cost(3, 4), SpyPatchMatch::CostAt(3, 4));
}

TEST_F(HostDepthEngineTest, StateOfAnotherSizeIsRefused) {
  const PinholeCamera& camera = reference_->camera;
  EXPECT_THAT(ErrorOf([&] {
                engine_.UploadState({PlaneMap(15, 10), CostMap(15, 11)}, camera);
              }),
              HasSubstr("plane map: 15 x 10"));
  EXPECT_THAT(ErrorOf([&] {
                engine_.UploadState({PlaneMap(15, 11), CostMap(14, 11)}, camera);
              }),
              HasSubstr("cost map: 14 x 11"));
}

TEST_F(HostDepthEngineTest, PassesStartFromTheEstimateGiven) {
  EngineProblem problem = Problem();
  problem.sources[0].estimate = EstimateOf(source_, {0, 0, -1, 6}, 0);
  const EngineEstimatePtr start = EstimateOf(reference_, {0, 0, -1, 3}, 0.25f);
  // One triangle over the whole image, of the plane z = 5.
  const PriorMesh prior = MakePriorMesh(reference_->camera, {{-9, -9, 5}, {60, -9, 5}, {-9, 60, 5}}, {});
  engine_.RunPlanarPrior(problem, {}, start, prior);
  EXPECT_FLOAT_EQ(spy_.last_prior_d, 5);
  EXPECT_EQ(spy_.last_start.planes(14, 10).d, 3);
  EXPECT_EQ(spy_.last_start.cost(14, 10), 0.25f);
  EXPECT_TRUE(spy_.last_problem.sources[0].depth.empty()) << "depths are for the geometric pass";

  spy_.last_start = {};
  engine_.RunGeometric(problem, {}, start, 3);
  EXPECT_EQ(spy_.last_pass, 3);
  EXPECT_EQ(spy_.last_start.planes(14, 10).d, 3);
  EXPECT_EQ(spy_.last_problem.sources[0].depth(11, 8), 6);
  // The start is not written to: a later pass makes a new estimate.
  EXPECT_EQ(engine_.DownloadState(start).planes(14, 10).d, 3);
}

TEST_F(HostDepthEngineTest, SupportPointsAreThoseOfTheMaps) {
  const EngineEstimatePtr estimate = engine_.RunPhotometric(Problem(), {}, 0);
  PlanarPriorOptions options;
  options.cell_size_px = 4;
  const EstimateMaps maps = engine_.Download(estimate);
  const DepthRange near = {1, 2.65f};  // some cells have no depth in it
  const std::vector<SupportPoint> points = engine_.FindSupportPoints(estimate, near, options);
  const std::vector<SupportPoint> expected = FindSupportPoints(maps.depth.View(), maps.cost.View(), near, options);
  ASSERT_EQ(points.size(), expected.size());
  ASSERT_GT(points.size(), 3u);
  ASSERT_LT(points.size(), 12u);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(points[i].col, expected[i].col);
    EXPECT_EQ(points[i].row, expected[i].row);
    EXPECT_EQ(points[i].depth, expected[i].depth);
  }
}

TEST_F(HostDepthEngineTest, ConsistencyIsThatOfTheMapsAndColours) {
  const FramePtr other = RandomFrame(2, 15, 11);
  FusionOptions options;
  options.min_consistent_views = 1;
  EngineView reference = View(reference_), confirming = View(source_), without = View(other);
  reference.estimate = EstimateOf(reference_, {0, 0, -1, 4}, 0.1f);
  confirming.estimate = EstimateOf(source_, {0, 0, -1, 4.01f}, 0.1f);
  const ConsistencyResult result = engine_.FilterByConsistency(reference, {without, confirming}, options);
  const auto fusion_view = [&](const EngineView& view, const EstimateMaps& maps) {
    const Frame& frame = *view.frame;
    return FusionView{frame.camera,       frame.cam_from_world, maps.depth.View(),
                      maps.normal.View(), maps.cost.View(),     frame.color.View()};
  };
  const EstimateMaps reference_maps = engine_.Download(reference.estimate);
  const EstimateMaps confirming_maps = engine_.Download(confirming.estimate);
  const ConsistencyResult expected = FilterByConsistency(
      fusion_view(reference, reference_maps), {FusionView(), fusion_view(confirming, confirming_maps)}, options);
  EXPECT_TRUE(SamePixels(result.consistent_views, expected.consistent_views));
  EXPECT_TRUE(SamePixels(result.confidence, expected.confidence));
  ASSERT_EQ(result.points_in_camera.size(), expected.points_in_camera.size());
  ASSERT_GT(result.points_in_camera.size(), 50u);
  EXPECT_EQ(result.points_in_camera[0].position.z, expected.points_in_camera[0].position.z);
  EXPECT_EQ(result.points_in_camera[0].color.r, 10);
}

TEST_F(HostDepthEngineTest, DeviceTimeAddsUpUntilItIsTaken) {
  EXPECT_EQ(engine_.PopDeviceTime(), 0);
  const EngineEstimatePtr estimate = engine_.RunPhotometric(Problem(), {}, 0);
  engine_.RunGeometric(Problem(), {}, estimate, 0);
  EXPECT_EQ(engine_.PopDeviceTime(), 14);
  EXPECT_EQ(engine_.PopDeviceTime(), 0);
  EXPECT_EQ(engine_.device_name(), "spy");
  EXPECT_EQ(engine_.DeviceBytes(), 0u);
  EXPECT_EQ(engine_.FreeDeviceBytes(), 0u);
}

struct ForeignImage final : EngineImage {};
struct ForeignEstimate final : EngineEstimate {};

TEST_F(HostDepthEngineTest, NullAndForeignImagesAreRefused) {
  EXPECT_THROW(engine_.Load(nullptr, 0), InvalidInputError);
  const EngineEstimatePtr start = EstimateOf(reference_, {0, 0, -1, 3}, 0);
  for (const EngineImagePtr& bad : {EngineImagePtr(), EngineImagePtr(std::make_shared<ForeignImage>())}) {
    EngineProblem bad_reference = Problem(), bad_source = Problem();
    bad_reference.reference.image = bad;
    bad_source.sources[0].image = bad;
    for (const EngineProblem& problem : {bad_reference, bad_source}) {
      EXPECT_THAT(ErrorOf([&] { engine_.RunPhotometric(problem, {}, 0); }), HasSubstr("null"));
      EXPECT_THAT(ErrorOf([&] { engine_.RunPlanarPrior(problem, {}, start, {}); }), HasSubstr("null"));
      EXPECT_THAT(ErrorOf([&] { engine_.RunGeometric(problem, {}, start, 0); }), HasSubstr("null"));
    }
  }
  EngineProblem no_frame = Problem();
  no_frame.sources[0].frame = nullptr;
  EXPECT_THAT(ErrorOf([&] { engine_.RunPhotometric(no_frame, {}, 0); }), HasSubstr("source view"));
  EXPECT_NO_THROW(engine_.RunPhotometric(Problem(), {}, 0)) << "the engine can be used again";
}

TEST_F(HostDepthEngineTest, NullAndForeignEstimatesAreRefused) {
  for (const EngineEstimatePtr& bad : {EngineEstimatePtr(), EngineEstimatePtr(std::make_shared<ForeignEstimate>())}) {
    EXPECT_THROW(engine_.Upsample(bad, reference_, 0), InvalidInputError);
    EXPECT_THROW(engine_.FindSupportPoints(bad, kRange, {}), InvalidInputError);
    EXPECT_THROW(engine_.RunPlanarPrior(Problem(), {}, bad, {}), InvalidInputError);
    EXPECT_THROW(engine_.RunGeometric(Problem(), {}, bad, 0), InvalidInputError);
    EXPECT_THROW(engine_.Download(bad), InvalidInputError);
    EXPECT_THROW(engine_.DownloadState(bad), InvalidInputError);
    EngineView reference = View(reference_);
    reference.estimate = bad;
    EXPECT_THROW(engine_.FilterByConsistency(reference, {}, {}), InvalidInputError);
  }
  EngineProblem foreign_source = Problem();
  foreign_source.sources[0].estimate = std::make_shared<ForeignEstimate>();
  const EngineEstimatePtr start = EstimateOf(reference_, {0, 0, -1, 3}, 0);
  EXPECT_THROW(engine_.RunGeometric(foreign_source, {}, start, 0), InvalidInputError);
  EngineView reference = View(reference_);
  reference.estimate = start;
  EXPECT_THROW(engine_.FilterByConsistency(reference, foreign_source.sources, {}), InvalidInputError);
  EXPECT_THROW(engine_.FilterByConsistency({nullptr, nullptr, start}, {}, {}), InvalidInputError);
  EXPECT_NO_THROW(engine_.RunGeometric(Problem(), {}, start, 0)) << "the engine can be used again";
}

TEST_F(HostDepthEngineTest, OverABorrowedMatcherCannotBeShared) {
  EXPECT_THAT(ErrorOf([&] { engine_.Share(); }), HasSubstr("cannot be shared"));
  EXPECT_THROW(HostDepthEngine(static_cast<PatchMatch*>(nullptr)), InvalidInputError);
}

TEST(CpuDepthEngineTest, SharedEnginesReadEachOthersHandles) {
  std::vector<FramePtr> frames;
  for (PlanarView& view : RenderPlanarScene(WorldPlane::Slanted(10, 15, 4), 40, 30, 3)) {
    Frame frame;
    frame.id = static_cast<int64_t>(frames.size());
    frame.camera = view.camera;
    frame.cam_from_world = view.cam_from_world;
    frame.gray = std::move(view.gray);
    frames.push_back(std::make_shared<const Frame>(std::move(frame)));
  }
  const std::unique_ptr<DepthEngine> engine = MakeCpuDepthEngine();
  const std::unique_ptr<DepthEngine> shared = engine->Share();
  EXPECT_NE(shared, nullptr);
  EXPECT_EQ(shared->device_name(), engine->device_name());
  EngineProblem problem;
  problem.reference = {frames[0], engine->Load(frames[0], 1), nullptr};
  problem.sources = {{frames[1], shared->Load(frames[1], 1), nullptr},
                     {frames[2], engine->Load(frames[2], 1), nullptr}};
  problem.depth_range = {2, 8};
  const EngineEstimatePtr start = engine->Upsample(engine->RunPhotometric(problem, {}, 1), frames[0], 1);
  const EngineEstimatePtr one = engine->RunGeometric(problem, {}, start, 0);
  const EngineEstimatePtr other = shared->RunGeometric(problem, {}, start, 0);
  EXPECT_TRUE(SameBits(engine->DownloadState(other), shared->DownloadState(one)));
  ExpectValid(engine->DownloadState(other), frames[0]->camera, problem.depth_range, 2.5f);
}

}  // namespace
}  // namespace acmp
