#pragma once

/// What help() says in Python.
namespace acmp::python {

constexpr const char* kModuleDoc = R"(The offline pipeline of acmp_mapping and its evaluation, on numpy arrays.

Conventions: camera axes are x right, y down, z forward; depth is the z coordinate. Pixel centres lie at integer
coordinates: the centre of the first pixel is (0, 0), as in OpenCV and in ROS CameraInfo (COLMAP's is (0.5, 0.5)). Depths,
points and poses are in one unit of length, which you choose. A pose cam_from_world takes points of the world to the camera:
p_cam = R p_world + t.

Wrong input raises ValueError and a failure of the machine RuntimeError, with the words of the command line tools.
Functions compute without Python's lock: other threads go on meanwhile, and Ctrl-C raises KeyboardInterrupt soon.)";

constexpr const char* kReconstructDoc =
    R"(Depth, normals and confidence of images with known cameras, and one point cloud.

The maps and points are those that acmp_reconstruct writes for the same input, bit by bit.

Args:
  images: N arrays of uint8, each (height, width, 3) or, for grey, (height, width); of any sizes and strides.
      Undistorted.
  K: (3, 3) for all images or (N, 3, 3), [fx 0 cx; 0 fy cy; 0 0 1] in pixels of the images as they are given.
  cam_from_world: (N, 4, 4) or (N, 3, 4) poses; or give
  world_from_cam: their inverses, in the same form.
  depth_range: (near, far) to search, 0 < near < far, for all images; or for each of them such a pair or None. Where
      there is none it comes from `points`: [q02 / 2, 2 q98] of the depths in view, which must be 10 or more.
  points: sparse points in the world, (M, 3) for all images, or for each image an (M, 3) array of those that it
      observes. What is not finite or not in view is left out.
  masks: for each image None or an array (height, width) of bool or uint8: pixels with 0 are not matched and get no
      depth.
  ranked_sources: for each image the indices of those to match it against, best first; of these the first
      `source_views` are used. An empty list: chosen from the poses, as for all images without this argument.
  names: of the images, for messages. By default "0", "1", ...
  color_order: "rgb" or "bgr" (OpenCV's), of images with three channels. Colours of the cloud are always RGB.
  preset: "balanced", "online" (half of the time or less), or one of the papers' "acmp", "acmp_no_geometric", "acmh",
      "acmm".
  options: options of the pipeline by name, over those of the preset: see "acmp_reconstruct --help", --set.
  source_views: images to match each image against at most, 1 to 32.
  max_image_size: shrink images so that the longer side has at most this many pixels; 0: as they are.
  seed: of the random numbers. The same seed gives the same bits.
  device: "auto" (the first GPU if there is one), "cuda" or "cpu".

Returns:
  Reconstruction. What was left aside, and that hardly any pixel became a point, is a UserWarning.

Raises:
  ValueError: names the value that is wrong and its bound.
  RuntimeError: a device failed or there is not enough memory.)";

constexpr const char* kReconstructionDoc = R"(What reconstruct() returns.

Attributes:
  images: list of ImageResult, in the order of the input.
  cloud: Cloud, fused from all images.
  device: str, what did it.)";

constexpr const char* kImageResultDoc =
    R"(Maps of one image, at the size that was matched: arrays of float32, or None without a map.

Attributes:
  name: str
  depth: (height, width), z in the unit of the poses; 0 where it is unknown. Never NaN.
  normal: (height, width, 3), unit normals in the camera's frame that face the camera; 0 where depth is unknown.
  cost: (height, width), matching cost: 0 (perfect) to 2 (no view confirms it, filled in);
      1.9999999: filled in where a view had confirmed something; inf: other images speak against the depth,
      which makes no point.
  confidence: (height, width), 0 to 1, probability that the depth is right; 0 where unknown.
  K: (3, 3) of the maps, in their pixels.
  cam_from_world: (4, 4)
  source_views: list of int, the images that it was matched against, best first.
  no_map: str, why there are no maps; empty where there are.)";

constexpr const char* kCloudDoc = R"(M points of surfaces: pixels that are probably right, averaged with what agrees.

Attributes:
  points: (M, 3) float32, in the world; float64 where the world's coordinates are too large for float32 (UTM, geocentric).
  normals: (M, 3) float32, unit normals in the world.
  colors: (M, 3) uint8, RGB.
  confidence: (M,) float32, 0 to 1.)";

constexpr const char* kReadSceneDoc =
    R"(Reads a folder with a COLMAP model or the layout of MVSNet and ACMP, as acmp_reconstruct does.

reconstruct(**read_scene(folder)) does the whole folder. Images with lens distortion are undistorted. All images are in
memory: 3 bytes per pixel.

Args:
  folder: of the scene.
  format: "auto", "colmap" or "mvsnet".
  pixel_centers: of mvsnet, where K has the centre of the first pixel: "integer" (0, 0) or "half" (0.5, 0.5).
  masks: folder of masks, IMAGE_NAME.png each: what is black is ignored. Empty: none.

Returns:
  dict of the arguments of reconstruct() by name: images (RGB), K, cam_from_world, points, depth_range, masks,
  ranked_sources, names. What is left aside is a UserWarning.

Raises:
  ValueError: names file, line and value of what is missing, damaged or out of bounds.)";

constexpr const char* kEvaluateDepthDoc =
    R"(Compares a depth map with the truth, at every pixel where the truth is known.

Args:
  depth: (height, width) numbers. What is not finite and > 0 is missing and counts as wrong. A map of another size than
      the truth is looked up at the nearest pixel centre.
  truth: (height, width) numbers; unknown where it is not finite and > 0.
  mask: None or (height, width) of the truth, bool or uint8: only pixels that are not 0 count.

Returns:
  dict: pixels with truth; density, percent of them with an estimate; median_error of those, in the unit of depth;
  below_absolute and below_relative, dicts from threshold (0.02, 0.05, 0.10 units; 0.01, 0.02, 0.05 of the true depth)
  to percent of all pixels with truth. NaN where there is nothing to say.

Raises:
  ValueError: wrong shapes or dtypes.)";

constexpr const char* kEvaluateCloudDoc = R"(Compares points with true ones, as the ETH3D multi-view benchmark does.

Args:
  points: (M, 3) finite numbers, of the reconstruction.
  truth: (L, 3) finite numbers, at least one.
  thresholds: distances, > 0.
  voxel_size: shares are taken in voxels of this size and averaged, so that dense regions do not dominate; > 0.

Returns:
  list of dict, one per threshold: threshold; accuracy, percent of `points` within it of the truth; completeness,
  percent of `truth` within it of the points; f1, their harmonic mean.

Raises:
  ValueError: wrong shapes or values.)";

}  // namespace acmp::python
