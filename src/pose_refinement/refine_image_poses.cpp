#include <tbb/parallel_for.h>

#include <algorithm>
#include <set>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "bundle_refinement.h"
#include "matching.h"

namespace acmp {
namespace {

constexpr size_t kSearchSources = 5;  // a landmark's depth is looked for in so many of the best sources

void CheckImages(const std::vector<PosedImage>& images) {
  const int count = static_cast<int>(images.size());
  for (int i = 0; i < count; ++i) {
    const PosedImage& image = images[static_cast<size_t>(i)];
    const std::string name = Concat("image ", image.id);
    CheckCamera(name.c_str(), image.camera);
    CheckPose(name.c_str(), image.cam_from_world);
    CheckDepthRange(name.c_str(), image.depth_range);
    for (int source : image.sources) {
      if (source < 0 || source >= count || source == i) {
        throw InvalidInputError(Concat(name, ": source view ", source, ": must be another of the ", count, " images"));
      }
    }
  }
}

class ImageSet {
 public:
  ImageSet(const std::vector<PosedImage>& images, const PoseRefinementOptions& options,
           const std::function<void()>& check)
      : images_(images), options_(options), check_(check), neighbours_(images.size()) {
    for (const PosedImage& image : images) {
      bundle().origin += ToViewPose(image.cam_from_world).centre / static_cast<double>(images.size());
    }
    for (size_t i = 0; i < images.size(); ++i) {
      bundle().Add(images[i].id, static_cast<double>(i), images[i].camera, images[i].cam_from_world);
      for (int source : images[i].sources) {
        neighbours_[i].insert(source);
        neighbours_[static_cast<size_t>(source)].insert(static_cast<int>(i));
      }
    }
    bundle().expected = bundle().received;
  }

  void Load(const std::function<ImagePixels(size_t)>& load) {
    set_.views.resize(images_.size());
    tbb::parallel_for(size_t{0}, images_.size(), [&](size_t i) {
      const ImagePixels pixels = load(i);
      set_.views[i] = MakeView(Concat("image ", images_[i].id), images_[i].camera, pixels.gray, pixels.mask);
    });
    Check();
  }

  /// Finds landmarks and where they are seen.
  void FindLandmarks() {
    std::vector<std::vector<Landmark>> of_view(images_.size());
    tbb::parallel_for(size_t{0}, images_.size(), [&](size_t i) {
      const std::vector<int>& sources = images_[i].sources;
      const auto num_searched = static_cast<std::ptrdiff_t>(std::min(sources.size(), kSearchSources));
      const std::vector<int> searched(sources.begin(), sources.begin() + num_searched);
      const View& view = set_.views[i];
      for (const Eigen::Vector2d& corner : PickCorners(view, CornerResponse(view), options_.corners)) {
        auto found = set_.FindLandmark(static_cast<int>(i), corner, images_[i].depth_range, searched, neighbours_[i]);
        if (found) of_view[i].push_back(std::move(*found));
      }
    });
    Check();
    for (std::vector<Landmark>& landmarks : of_view) {
      bundle().landmarks.insert(bundle().landmarks.end(), landmarks.begin(), landmarks.end());
    }
  }

  /// Looks for known landmarks again, where refined poses say they are.
  void FindAgain() {
    std::vector<Landmark>& landmarks = bundle().landmarks;
    tbb::parallel_for(size_t{0}, landmarks.size(), [&](size_t i) {
      Landmark& landmark = landmarks[i];
      Triangulate(bundle().poses, bundle().cameras, &landmark);
      landmark.sightings = set_.FindSightings(landmark, neighbours_[static_cast<size_t>(landmark.anchor)]);
    });
    Check();
    landmarks.erase(std::remove_if(landmarks.begin(), landmarks.end(),
                                   [](const Landmark& l) { return l.sightings.size() < kMinSightings; }),
                    landmarks.end());
  }

  Bundle& bundle() { return set_.bundle; }

 private:
  void Check() const {
    if (check_) check_();
  }

  const std::vector<PosedImage>& images_;
  const PoseRefinementOptions& options_;
  const std::function<void()>& check_;
  std::vector<std::set<int>> neighbours_;  ///< sources, and those whose source the image is
  ImageBundle set_;
};

/// What moves while each image is read out.
std::vector<ReadoutMotion> ReadoutsOf(const Bundle& bundle, double readout) {
  std::vector<std::vector<double>> inverse_depths(bundle.size());
  for (const Landmark& landmark : bundle.landmarks) {
    inverse_depths[static_cast<size_t>(landmark.anchor)].push_back(landmark.inverse_depth);
  }
  const std::vector<CameraMotion> motions = MotionsOf(bundle);
  std::vector<ReadoutMotion> readouts;
  for (size_t i = 0; i < bundle.size(); ++i) {
    const double typical = inverse_depths[i].empty() ? 1 / TypicalDepth(bundle) : Median(std::move(inverse_depths[i]));
    readouts.push_back(
        {readout * motions[i].angular, readout * typical * (bundle.poses[i].rotation * motions[i].linear)});
  }
  return readouts;
}

}  // namespace

PoseRefinement RefineImagePoses(const std::vector<PosedImage>& images, const std::function<ImagePixels(size_t)>& load,
                                const PoseRefinementOptions& options, bool frees, const std::function<void()>& check) {
  Validate(options);
  CheckImages(images);
  ImageSet set(images, options, check);
  if (options.refine == RefinePoses::kOff) return Unrefined(set.bundle(), "refinement is off");
  constexpr size_t kMinImages = 3;
  if (images.size() < kMinImages) {
    return Unrefined(set.bundle(), Concat(images.size(), " images: needs ", kMinImages));
  }
  set.Load(load);
  set.FindLandmarks();
  RefinementState state;
  constexpr int kFirstIterations = 15;
  std::optional<Bundle> refined;
  if (RefineBundle(1, kFirstIterations, 0, &set.bundle(), &state)) {
    set.FindAgain();
    refined = CompareModels(set.bundle(), state.weights, &state.comparison);
  }
  if (!refined) return Unrefined(set.bundle(), "the bundle adjustment found no solution");
  state.bent = AreBent(state.comparison, kNearerOfAll);
  state.camera = state.comparison.camera;
  const std::vector<ViewPose> resected = ResectViews(*refined, state.camera);
  // As the images are is how received poses see them, too: that is what they are compared by.
  PoseRefinement result = JudgeRefinement(*refined, resected, state, options, false);
  if (!result.changed) return result;
  frees = frees && result.checks.has_camera_errors;
  const std::vector<ViewPose>&found = frees ? refined->poses : resected, &received = refined->received;
  const std::vector<ViewPose> scaled =
      Moved(FitSimilarity(found, received, images.size(), TypicalDepth(*refined)), found);
  // Along the received ones, in their scale.
  const std::vector<Similarity> aligned = AlignAlong(PairsOf(scaled, received, images.size()), 1);
  std::vector<ViewPose> placed;
  for (size_t i = 0; i < images.size(); ++i) placed.push_back(Moved(aligned[i], {scaled[i]}).front());
  SetPoses(*refined, scaled, placed, &result);
  if (!frees) return result;
  const std::vector<ReadoutMotion> readouts = ReadoutsOf(*refined, state.camera.readout);
  for (size_t i = 0; i < images.size(); ++i) result.poses[i].readout = readouts[i];
  return result;
}

}  // namespace acmp
