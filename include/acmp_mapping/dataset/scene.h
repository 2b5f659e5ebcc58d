#pragma once

#include <cstddef>
#include <deque>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/geometry/pinhole_camera.h"
#include "acmp_mapping/geometry/rigid_transform.h"
#include "acmp_mapping/keyframe/depth_range.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

class Rectifier;

/// Which pinhole image of a wide one a scene image is (SplitWideImages).
struct FaceOfImage {
  PinholeCamera file_camera;                                     ///< of the whole image, as stored
  Eigen::Matrix3d lens_from_face = Eigen::Matrix3d::Identity();  ///< rotation
};

/// One image of a scene on disk, or a face of one.
struct SceneImage {
  std::string name;                   ///< file name relative to the image folder; of a face see SplitWideImages
  std::filesystem::path path;         ///< of the file
  std::filesystem::path mask;         ///< of its mask (AddMasks); empty: it has none
  std::filesystem::path prior_depth;  ///< of its depth map from outside (AddPriorDepths); empty: it has none
  PinholeCamera camera;               ///< of the file as stored, or of the face; pixel centres at integers
  LensDistortion distortion;          ///< of the file
  double field_of_view = 0;           ///< Lens's, deg
  std::optional<FaceOfImage> face;    ///< nothing: all of the file, undistorted to the same K
  ReadoutMotion readout;              ///< of the file; none for faces
  RigidTransform cam_from_world = RigidTransform::Identity();
  /// Moves what is made of the image to where it is written: matched poses may have a drift of their own.
  RigidTransform placed_from_world = RigidTransform::Identity();
  std::vector<int> landmark_indices;      ///< into Scene::landmarks_in_world: points this image observes
  std::optional<DepthRange> depth_range;  ///< where the dataset names one
  std::vector<int> ranked_sources;        ///< image indices, best first, where the dataset names them (pair.txt)
};

/// World_from_cam of the image in what is written.
inline RigidTransform WrittenPose(const SceneImage& image) {
  return image.placed_from_world * image.cam_from_world.inverse();
}

/// What takes lens distortion and rolling shutter out of images, kept for the next images of the same camera: its maps
/// take time to make. Several threads may use it.
class RectifierCache {
 public:
  /// An image with a rolling shutter has one of its own, which is not kept.
  std::shared_ptr<const Rectifier> Of(const SceneImage& image);

  /// Of all that are kept, the oldest go first; the newest stays, whatever it takes.
  void set_max_bytes(size_t bytes) { max_bytes_ = bytes; }
  size_t bytes() const;

 private:
  size_t SumOfBytes() const;  ///< the lock is held

  size_t max_bytes_ = 120'000'000;
  mutable std::mutex mutex_;
  std::deque<std::shared_ptr<const Rectifier>> newest_;
};

/// A posed image set. Image i of `images` has index i everywhere.
struct Scene {
  std::filesystem::path root;
  std::vector<SceneImage> images;
  std::vector<Eigen::Vector3d> landmarks_in_world;
  std::vector<std::string> warnings;  ///< what was left aside and why, for the user
  std::string note;                   ///< which of two layouts was read; empty: there is one
  std::shared_ptr<RectifierCache> rectifiers = std::make_shared<RectifierCache>();  ///< of its images
};

enum class SceneFormat { kAuto, kColmap, kMvsnet };

/// "auto", "colmap" or "mvsnet"; throws InvalidInputError for anything else.
SceneFormat ParseSceneFormat(const std::string& name);

/// Where K of the MVSNet layout has the centre of the first pixel: (0, 0), or (0.5, 0.5) as COLMAP and what copies its
/// K.
enum class PixelCenters { kInteger, kHalf };

/// "integer" or "half"; throws InvalidInputError for anything else.
PixelCenters ParsePixelCenters(const std::string& name);

/// "0,3,7-12" as sorted, unique indices below `count`; empty: all. Throws InvalidInputError naming the part that is not
/// one.
std::vector<int> ParseImageIndices(const std::string& text, int count);

/// Reads a COLMAP model (text or binary; in `root`, `root/sparse` or `root/sparse/0`, images in `root/images`) or the
/// MVSNet / ACMP layout (`cams/%08d_cam.txt`, `pair.txt`, `images/%08d.*` or `%06d.*`). kAuto prefers MVSNet's, since
/// its pair.txt names the source views; landmarks are read from a COLMAP model beside it when there is one with the
/// same images. Images of a COLMAP model that are missing are left out, with a warning. Throws InvalidInputError naming
/// file, line and value for whatever is missing, truncated or out of bounds.
/// @param centers of MVSNet's K; where a COLMAP model beside it speaks for the other, there is a warning. kHalf for a
///                COLMAP model, whose centres are known, is an InvalidInputError
/// @param image_folder empty: `root/images`
Scene ReadScene(const std::filesystem::path& root, SceneFormat format = SceneFormat::kAuto,
                PixelCenters centers = PixelCenters::kInteger, const std::filesystem::path& image_folder = {});

/// Puts the pinhole images that FacesOf names in the place of each wide image, in its order and with its mask and depth
/// from outside: the face ahead has the name of the image, a/b.jpg, another one for example a/b_face_left.jpg. All
/// faces of an image have its landmarks. Images without distortion are no wide ones. Throws InvalidInputError where
/// another image has a face's name already.
void SplitWideImages(Scene* scene);

/// The indices from the first to behind the last of the images of the same file: the faces of a wide image, or one.
std::pair<int, int> ImagesOfFile(const Scene& scene, int index);

/// The points that an image observes, world frame.
std::vector<Eigen::Vector3d> LandmarksOf(const Scene& scene, const SceneImage& image);

/// The stored image, still distorted. Throws InvalidInputError for an unreadable or truncated file or a size that
/// differs from the camera's.
ColorImage LoadImage(const Scene& scene, int index);

/// Loads one image, takes lens and rolling shutter out if need be (black and masked where nothing is known) and makes a
/// frame of it with id = index, its mask and its landmarks. Throws as LoadImage and LoadMask do.
/// @param max_size of MakeFrame
Frame LoadFrame(const Scene& scene, int index, int max_size = 0);

// Files beside the images, in folders of their own: masks, and depth maps from outside.

/// Finds the masks of a scene's images in a folder, named as COLMAP names them: that of images/a/b.jpg is
/// FOLDER/a/b.jpg.png. Returns how many images have one; the others count as a whole. Throws InvalidInputError where
/// the folder is missing or has a mask for no image.
size_t AddMasks(const std::filesystem::path& folder, Scene* scene);

/// Reads a PNG or JPEG picture: black = ignore, everything else = use. Throws InvalidInputError as ReadColorImage does.
Mask ReadMask(const std::filesystem::path& path);
/// The same of a mask that must have the size of its image.
Mask ReadMask(const std::filesystem::path& path, const ImageSize& of_image);

/// What of the undistorted image counts: neither what its mask ignores, nor what the lens did not see. Empty where all
/// does. Throws as ReadMask does.
Mask LoadMask(const Scene& scene, const SceneImage& image);

/// Finds the depth maps from outside of a scene's images in a folder: that of images/a/b.jpg is FOLDER/a/b with .pfm,
/// .dmb or .png (16 bit, thousandths), or the whole name with one of these. Returns how many images have one. Throws
/// InvalidInputError where the folder is missing or has one for no image, and where an image has several.
size_t AddPriorDepths(const std::filesystem::path& folder, Scene* scene);

/// As stored; 0: unknown. Empty: the image has none. Throws as ReadDepth does.
DepthMap ReadPriorDepthOf(const SceneImage& image);

}  // namespace acmp
