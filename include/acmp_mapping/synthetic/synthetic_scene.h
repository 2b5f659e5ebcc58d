#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/keyframe/frame.h"

namespace acmp {

/// Where the images are taken. Analytic geometry; unit metres, world z up.
enum class SyntheticPlace {
  /// A room with blank walls and floor (a faint gradient), trims along their edges, a textured table, boxes, a sphere
  /// and pictures on a wall; about 5 degrees between keyframes.
  kRoom,
  /// Blank walls and floor without trims; rods, cables and lamp posts 8 to 25 mm thick, a wall of equal tiles, a faint
  /// carpet and faint veneer, a glossy picture; about 4 degrees between keyframes.
  kOffice,
  /// A street with houses on both sides under a sky, seen from a vehicle that drives along it looking ahead: blank
  /// plaster, bricks, trees, posts and wires; what is seen is 2 to 60 m away, 45 cm between keyframes.
  kStreet,
};

/// Classes of what the places show, see config/labels.yaml. What stands in another place than the room is kThing.
enum SyntheticLabel : Label {
  kFloor = 1,
  kCeiling,
  kWall,
  kSky,
  kTrim,
  kTable,
  kTableware,
  kFurniture,
  kPicture,
  kThing
};

/// From light to grey levels: a lens, a shutter and a linear sensor with the noise of the EMVA 1288 standard (variance
/// linear in the signal), clipped and rounded to 8 bits. The default is a camera that only has noise.
struct ImagingModel {
  double read_noise_grey = 1.5;  ///< standard deviation per colour channel in the dark, 0..50; in grey two thirds
  double grey_per_electron = 0;  ///< gain K: shot noise has the variance K * signal (grey^2). 0..1; 0: none
  double psf_sigma_px = 0;       ///< standard deviation of the point spread of lens and demosaicing, 0..5
  double shake_deg = 0;          ///< how far the camera turns about each axis while the shutter is open (bell-shaped
                                 ///< with this standard deviation, per image): motion blur. 0..2
  double exposure_spread = 0;    ///< s: exposures from (1 - s) / (1 + s) to (1 + s) / (1 - s), per image. 0..0.5
  bool vignetting = false;       ///< natural vignetting: cos^4 of the angle from the optical axis
};

struct SyntheticSceneOptions {
  int width = 240;     ///< px
  int height = 180;    ///< px
  int keyframes = 14;  ///< 2..1000
  uint32_t seed = 1;
  SyntheticPlace place = SyntheticPlace::kRoom;
  ImagingModel imaging = {};
  /// Something moves through the place, ahead of the camera. Frames have masks of it; true depths, normals and surfaces
  /// are those of the place without it.
  bool moving_object = false;
  bool standing = false;         ///< the camera stays where the middle one of the keyframes would be taken
  double stereo_baseline_m = 0;  ///< of a second camera like the first, that far to its right. 0..5; 0: none
  /// Of a fisheye (equidistant, nearly) whose circle fills the image's shorter side, deg, 121..240; 0: a pinhole.
  double field_of_view = 0;
};

/// Sets place and imaging to those of a named scene. "room": the room with the default camera. "hard": the office with
/// a hand-held video camera indoors. "street": the street with a video camera by day. Throws InvalidInputError for
/// another name.
void SelectSyntheticScene(const std::string& name, SyntheticSceneOptions* options);

struct SyntheticView;

/// A view as a fisheye has it.
struct SyntheticWideImage {
  Lens lens;         ///< with its field of view
  ColorImage color;  ///< black outside of the circle
  std::vector<Eigen::Vector3d> landmarks_in_world;
  std::vector<SyntheticView> others;  ///< pinhole views from there that show what the first does not
};

/// What the renderer knows exactly about one image.
struct SyntheticView {
  Frame frame;  ///< colour as the camera gives it, landmarks as a SLAM frontend would have them; see moving_object
  /// z of the first surface at each pixel centre, at the middle of the exposure as the pose; 0: sky.
  DepthMap true_depth;
  NormalMap true_normal;             ///< camera frame; 0: sky
  Image<unsigned char> low_texture;  ///< 1 on surfaces of one colour, 0 elsewhere
  LabelImage true_labels;            ///< SyntheticLabel
  SyntheticPlace place = SyntheticPlace::kRoom;
  DepthMap shown_depth;        ///< as true_depth, of what the image shows: with what moves. Empty where nothing does
  std::optional<Frame> right;  ///< of the second camera, with the id and stamp of `frame`, without landmarks and mask
  std::optional<SyntheticWideImage> wide;  ///< of field_of_view: `frame` then looks ahead
};

/// Renders a place along its path. The same options give the same bytes on every machine (integer noise, no
/// function of libm that may differ).
std::vector<SyntheticView> MakeSyntheticScene(const SyntheticSceneOptions& options);

/// Throws InvalidInputError unless SampleSyntheticSurface takes it.
void CheckSurfaceSpacing(float spacing_m);

/// Points on the true surfaces seen by at least one of the views, with their labels, about `spacing_m` apart, for cloud
/// metrics.
PointCloud SampleSyntheticSurface(const std::vector<SyntheticView>& views, float spacing_m);

/// Writes a synthetic scene as a dataset folder: images/, cameras.txt, sparse/ (COLMAP model) and sparse.ply,
/// cams/ and pair.txt (MVSNet / ACMP layout), depth/ (ground truth, 16-bit millimetres), low_texture/ (white: blank
/// walls and floor), masks/ (of what moves, where something does; named as COLMAP names them), surface.ply
/// (ground-truth cloud, points `surface_spacing_m` apart). Of a fisheye images/, sparse/, sparse.ply and surface.ply
/// alone. Throws ProcessingError with the system's reason when something cannot be written.
void WriteSceneFiles(const std::filesystem::path& folder, const std::vector<SyntheticView>& views,
                     float surface_spacing_m);

}  // namespace acmp
