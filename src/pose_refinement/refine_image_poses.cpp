#include <tbb/parallel_for.h>

#include <algorithm>
#include <set>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/median.h"
#include "acmp_mapping/pose_refinement/pose_refinement.h"
#include "bundle_refinement.h"
#include "corner_detection.h"
#include "landmark_matching.h"
#include "resection.h"

namespace acmp {
namespace {

constexpr size_t kSearchSources = 5;         // a landmark's depth is looked for in so many of the best sources
constexpr size_t kMinLandmarkSightings = 2;  // fewer say nothing about depth and poses together

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

/// Stamps in seconds if all have one and they ascend, else the images' numbers.
std::vector<double> TimesOf(const std::vector<PosedImage>& images) {
  std::vector<double> times;
  bool ascending = true;
  for (size_t i = 0; i < images.size(); ++i) {
    times.push_back(images[i].stamp_s);
    ascending &= images[i].stamp_s > 0 && (i == 0 || times[i] > times[i - 1]);
  }
  for (size_t i = 0; !ascending && i < times.size(); ++i) times[i] = static_cast<double>(i);
  return times;
}

class ImageSet {
 public:
  ImageSet(const std::vector<PosedImage>& images, const PoseRefinementOptions& options,
           const std::function<void()>& check)
      : images_(images), options_(options), check_(check), views_(images.size()), neighbours_(images.size()) {
    Bundle& b = bundle_;
    for (const PosedImage& image : images) {
      b.cameras.push_back(image.camera);
      b.received.push_back(ToViewPose(image.cam_from_world));
      b.origin += b.received.back().centre / static_cast<double>(images.size());
    }
    for (ViewPose& pose : b.received) pose.centre -= b.origin;
    b.poses = b.expected = b.received;
    b.times = TimesOf(images);
    b.motions.resize(images.size());
    for (size_t i = 0; i < images.size(); ++i) {
      for (int source : images[i].sources) {
        neighbours_[i].insert(source);
        neighbours_[static_cast<size_t>(source)].insert(static_cast<int>(i));
      }
    }
  }

  void Load(const std::function<ImagePixels(size_t)>& load) {
    tbb::parallel_for(size_t{0}, views_.size(), [&](size_t i) {
      const ImagePixels pixels = load(i);
      const GrayImage& gray = pixels.gray;
      const PinholeCamera& camera = bundle_.cameras[i];
      if (gray.width() != camera.width || gray.height() != camera.height) {
        throw InvalidInputError(Concat("image ", images_[i].id, ": ", gray.width(), " x ", gray.height(),
                                       " px: must be of the camera's ", camera.width, " x ", camera.height));
      }
      views_[i] = {camera, GrayPyramid(gray.View()), MakeMaskDistance(pixels.mask)};
    });
    Check();
  }

  /// Finds landmarks and where they are seen.
  void FindLandmarks() {
    std::vector<std::vector<Landmark>> of_view(views_.size());
    tbb::parallel_for(size_t{0}, views_.size(), [&](size_t i) { of_view[i] = LandmarksOf(i); });
    Check();
    for (std::vector<Landmark>& landmarks : of_view) {
      bundle_.landmarks.insert(bundle_.landmarks.end(), landmarks.begin(), landmarks.end());
    }
  }

  /// Looks for known landmarks again, where refined poses say they are.
  void FindAgain() {
    tbb::parallel_for(size_t{0}, bundle_.landmarks.size(), [&](size_t i) {
      Landmark& landmark = bundle_.landmarks[i];
      Triangulate(bundle_.poses, bundle_.cameras, &landmark);
      FindSightings(&landmark);
    });
    Check();
    auto& landmarks = bundle_.landmarks;
    landmarks.erase(std::remove_if(landmarks.begin(), landmarks.end(),
                                   [](const Landmark& l) { return l.sightings.size() < kMinLandmarkSightings; }),
                    landmarks.end());
  }

  Bundle& bundle() { return bundle_; }

 private:
  void Check() const {
    if (check_) check_();
  }

  PosedView Posed(int index) const {
    return {index, &views_[static_cast<size_t>(index)], bundle_.poses[static_cast<size_t>(index)]};
  }

  void FindSightings(Landmark* landmark) const {
    landmark->sightings.clear();
    const PosedView anchor = Posed(landmark->anchor);
    for (int view : neighbours_[static_cast<size_t>(landmark->anchor)]) {
      const Alignment alignment = FindInView(*landmark, anchor, Posed(view), {});
      if (alignment.found) landmark->sightings.push_back({view, alignment.pixel});
    }
  }

  std::vector<Landmark> LandmarksOf(size_t i) const {
    const PosedView anchor = Posed(static_cast<int>(i));
    std::vector<PosedView> others;
    for (int source : images_[i].sources) {
      if (others.size() < kSearchSources) others.push_back(Posed(source));
    }
    std::vector<Landmark> landmarks;
    for (const Eigen::Vector2d& corner : PickCorners(views_[i], CornerResponse(views_[i].pyramid.level(0)), {},
                                                     CornersFor(bundle_.cameras[i], options_.corners))) {
      Landmark landmark;
      landmark.anchor = static_cast<int>(i);
      landmark.pixel = corner;
      landmark.inverse_depth = SearchInverseDepth(anchor, corner, images_[i].depth_range, others);
      if (!(landmark.inverse_depth > 0)) continue;
      landmark.held_out = IsHeldOut(images_[i].id, corner);
      FindSightings(&landmark);
      if (landmark.sightings.size() < kMinLandmarkSightings) continue;
      Triangulate(bundle_.poses, bundle_.cameras, &landmark);
      if (landmark.inverse_depth > 0) landmarks.push_back(std::move(landmark));
    }
    return landmarks;
  }

  const std::vector<PosedImage>& images_;
  const PoseRefinementOptions& options_;
  const std::function<void()>& check_;
  std::vector<View> views_;
  std::vector<std::set<int>> neighbours_;  ///< sources, and those whose source the image is
  Bundle bundle_;
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

/// Poses along the received ones (AlignAlong), in their scale.
std::vector<ViewPose> PlacedAlong(const std::vector<ViewPose>& poses, const std::vector<ViewPose>& received) {
  std::vector<PosePair> pairs;
  for (size_t i = 0; i < poses.size(); ++i) {
    pairs.push_back({ToRigidTransform(poses[i]).inverse(), ToRigidTransform(received[i]).inverse()});
  }
  const std::vector<Similarity> aligned = AlignAlong(pairs, 1);
  std::vector<ViewPose> placed;
  for (size_t i = 0; i < poses.size(); ++i) placed.push_back(Moved(aligned[i], {poses[i]}).front());
  return placed;
}

}  // namespace

PoseRefinement RefineImagePoses(const std::vector<PosedImage>& images, const std::function<ImagePixels(size_t)>& load,
                                const PoseRefinementOptions& options, bool frees, const std::function<void()>& check) {
  Validate(options);
  CheckImages(images);
  std::vector<int64_t> ids;
  std::vector<RigidTransform> received;
  for (const PosedImage& image : images) {
    ids.push_back(image.id);
    received.push_back(image.cam_from_world);
  }
  if (options.refine == RefinePoses::kOff) return Unrefined(ids, received, "refinement is off");
  constexpr size_t kMinImages = 3;
  if (images.size() < kMinImages) {
    return Unrefined(ids, received, Concat(images.size(), " images: needs ", kMinImages));
  }
  ImageSet set(images, options, check);
  set.Load(load);
  set.FindLandmarks();
  RefinementState state;
  constexpr int kFirstIterations = 15;
  std::optional<Bundle> refined;
  if (RefineBundle(1, kFirstIterations, 0, &set.bundle(), &state)) {
    set.FindAgain();
    refined = CompareModels(set.bundle(), state.weights, &state.comparison);
  }
  if (!refined) return Unrefined(ids, received, "the bundle adjustment found no solution");
  state.bent = AreBent(state.comparison, kNearerOfAll);
  state.camera = state.comparison.camera;
  const std::vector<ViewPose> resected = ResectViews(*refined, state.camera);
  // As the images are is how received poses see them, too: that is what they are compared by.
  PoseRefinement result = JudgeRefinement(*refined, ids, received, resected, state, options, false);
  if (!result.changed) return result;
  const std::vector<ReadoutMotion> readouts = ReadoutsOf(*refined, state.camera.readout);
  frees = frees && result.has_camera_errors;
  const std::vector<ViewPose>& found = frees ? refined->poses : resected;
  const std::vector<ViewPose> scaled =
      Moved(FitSimilarity(found, refined->received, found.size(), TypicalDepth(*refined)), found);
  const std::vector<ViewPose> placed = PlacedAlong(scaled, refined->received);
  const auto in_world = [&](const ViewPose& pose) {
    return ToRigidTransform({pose.rotation, pose.centre + refined->origin});
  };
  for (size_t i = 0; i < images.size(); ++i) {
    result.poses[i].cam_from_world = in_world(scaled[i]);
    result.poses[i].cam_from_received = in_world(placed[i]);
    if (frees) result.poses[i].readout = readouts[i];
  }
  return result;
}

}  // namespace acmp
