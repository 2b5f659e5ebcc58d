#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/dataset/scene.h"
#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "progress.h"

namespace acmp {

/// Reads the scene of the options, with masks and depth maps from outside; wide images are split into faces. Throws
/// InvalidInputError as ReadScene, AddMasks, AddPriorDepths, CheckLens and SplitWideImages do.
Scene ReadSceneInput(const ReconstructOptions& options);

/// Says how many images have masks, and reads those of `indices` once, so that a bad one is found now. Returns the
/// indices of the images that are of use: a warning names those of which their mask ignores every pixel. Throws
/// InvalidInputError as LoadMask does, and where no image is of use.
std::vector<int> TakeMasks(const ReconstructOptions& options, const std::vector<int>& indices, const Scene& scene,
                           Progress* progress);

/// Says how many of `indices` have a depth map from outside; a warning names those without any depth. Throws
/// InvalidInputError as ReadPriorDepthOf does.
void CheckPriorDepths(const ReconstructOptions& options, const std::vector<int>& indices, const Scene& scene,
                      Progress* progress);

/// Of the content of each image's files: itself, its mask, its prior depth (ChecksumsOf). Reads them, without decoding,
/// side by side. Throws Interrupted.
/// @param also is called for each, in any thread
std::vector<std::string> HashFiles(const Scene& scene, const std::vector<int>& indices, const StopRequest& interrupt,
                                   const std::function<void(int index)>& also);

/// The first image whose files are others than when `files` was what HashFiles said of `indices`; -1: there is none.
int FindChangedImage(const Scene& scene, const std::vector<int>& indices, const std::vector<std::string>& files,
                     const StopRequest& interrupt);

/// Of all that a run reads: files, cameras, poses, landmarks, ranges and source views that the dataset names.
/// @param files what HashFiles says of the image at the same place of `indices`
/// @return 8 digits
std::string InputHash(const Scene& scene, const std::vector<int>& indices, const std::vector<std::string>& files);

/// What to do with one image of the scene.
struct ImagePlan {
  int index = 0;             ///< in the scene
  DepthRange range;          ///< offline schedule only
  std::vector<int> sources;  ///< scene indices, best first; online those that the mapper chose, once it has run
  std::string no_map;        ///< why the image gets no map; empty when it gets one
};

/// Images that take part, in the order of their index.
struct ReconstructPlan {
  std::vector<ImagePlan> images;
  std::vector<std::string> warnings;
  /// Of the coordinates that points are kept in (LocalOrigin): zero where the cameras are near the world's.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();

  /// Null where the image takes no part.
  const ImagePlan* Find(int index) const;
  /// Whether the image takes part and gets a map.
  bool HasMap(int index) const {
    const ImagePlan* image = Find(index);
    return image && image->no_map.empty();
  }
  /// Scene indices of the images.
  std::vector<int> Indices() const;
  /// Of those that get a map.
  std::set<int> WithMap() const;
  /// The image and its source views that get a map: whose estimates its refinements and its points are made of.
  std::vector<int> ImagesRead(const ImagePlan& image) const;
};

/// Throws InvalidInputError with an example when no image gets a map.
void CheckSomeImageGetsAMap(const ReconstructPlan& plan, const Scene& scene);

/// The range that the dataset names for an image, with the margin that is searched beside it.
std::optional<DepthRange> DatasetRange(const SceneImage& image);

/// Decides source views of every image for the offline schedule; with the online one the mapper does. An image without
/// a range or with too few source views gets no map; throws InvalidInputError when none gets one.
/// @param given ranges to search, of the image at the same place of `indices`; where there is none, that of the
/// options,
///              else the dataset's, else the landmarks'
ReconstructPlan MakePlan(const Scene& scene, const std::vector<int>& indices, const ReconstructOptions& options,
                         const std::vector<std::optional<DepthRange>>& given = {});

/// All the depths that the dataset names for the images, with the same margin as offline; 0, 0 when it names none.
DepthRange UnionOfDatasetRanges(const Scene& scene, const std::vector<int>& indices);

/// The content of a plan's file: the plan and its images.
/// @param files what HashFiles says of each image of the plan
/// @param root of the scene; paths below are relative to it, so that machines may have it at different places
std::string FormatPlan(const Scene& scene, const ReconstructPlan& plan, const std::vector<std::string>& files,
                       const std::filesystem::path& root);
/// Back again. Images keep their indices in the scene and are without landmarks and ranking, which only the plan is
/// made of.
/// @param files by scene index
void ParsePlan(const std::string& content, const std::filesystem::path& root, Scene* scene, ReconstructPlan* plan,
               std::map<int, std::string>* files);

/// Of an image as stored, at the size at which it is matched.
PinholeCamera MatchedCamera(const SceneImage& image, const ReconstructOptions& options);

/// Throws InvalidInputError for an image that has no pixel left when it is halved as often as the options say.
void CheckSizes(const Scene& scene, const std::vector<int>& indices, const ReconstructOptions& options);

/// --refine-poses: replaces the poses of the images that take part by refined ones, or leaves them as they are, and
/// says which and why. Images are matched against the plan's source views. Reads every image once. Where the camera has
/// errors and poses are replaced, lens and rolling shutter of the images change, too: what is matched is free of them.
/// Returns the lens as it turned out to be, where the calibration leaves errors and all images have the same.
std::optional<Lens> RefineScenePoses(const ReconstructPlan& plan, const ReconstructOptions& options,
                                     const StopRequest& interrupt, Scene* scene, Progress* progress);

}  // namespace acmp
