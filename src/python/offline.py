"""The offline pipeline of acmp_mapping and its evaluation, on numpy arrays.

Conventions: camera axes are x right, y down, z forward; depth is the z coordinate. Pixel centres lie at integer
coordinates: the centre of the first pixel is (0, 0), as in OpenCV and in ROS CameraInfo (COLMAP's is (0.5, 0.5)). Depths,
points and poses are in one unit of length, which you choose. A pose cam_from_world takes points of the world to the camera:
p_cam = R p_world + t.

Wrong input raises ValueError and a failure of the machine RuntimeError, with the words of the command line tools.
Functions compute without Python's lock: other threads go on meanwhile, and Ctrl-C raises KeyboardInterrupt soon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from acmp_mapping import _offline

if TYPE_CHECKING:
    from numpy.typing import ArrayLike  # numpy 1.20: Debian 11 has 1.19

__all__ = ["Cloud", "ImageResult", "Reconstruction", "evaluate_cloud", "evaluate_depth", "read_scene", "reconstruct"]


@dataclass(frozen=True, eq=False)
class Cloud:
    """M points of surfaces: pixels that are probably right, averaged with what agrees.

    Attributes:
      points: (M, 3) float32, in the world; float64 where the world's coordinates are too large for float32 (UTM, geocentric).
      normals: (M, 3) float32, unit normals in the world.
      colors: (M, 3) uint8, RGB.
      confidence: (M,) float32, 0 to 1."""

    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True, eq=False)
class ImageResult:
    """Maps of one image, at the size that was matched: arrays of float32, or None without a map.

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
      no_map: str, why there are no maps; empty where there are."""

    name: str
    depth: Optional[np.ndarray]
    normal: Optional[np.ndarray]
    cost: Optional[np.ndarray]
    confidence: Optional[np.ndarray]
    K: np.ndarray
    cam_from_world: np.ndarray
    source_views: list[int]
    no_map: str


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What reconstruct() returns.

    Attributes:
      images: list of ImageResult, in the order of the input.
      cloud: Cloud, fused from all images.
      device: str, what did it."""

    images: list[ImageResult]
    cloud: Cloud
    device: str


def _elements(value, name, count=None):
    """Those of a list or array: as many as `count` says."""
    try:
        elements = list(value)
    except TypeError:
        raise ValueError(f"{name}: must be a sequence") from None
    if count is not None and len(elements) != count:
        raise ValueError(f"{name}: has {len(elements)} elements: must be one for each of {count} images")
    return elements


def _of_shape(array, name, shapes, wanted):
    """The array, which must have one of the shapes, in which None is any length."""
    for shape in shapes:
        if array.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape)):
            return array
    raise ValueError(f"{name}: shape {array.shape}: must be {wanted}")


def _numbers(value, name, shapes, wanted):
    """In double precision, from whatever numpy takes for real numbers."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: dtype {array.dtype}: must be real numbers")
    return _of_shape(array.astype(np.float64), name, shapes, wanted)


def _map(value, name):
    return _numbers(value, name, [(None, None)], "(height, width)")


def _points(value, name):
    return _numbers(value, name, [(None, 3)], "(M, 3)")


def _bytes(value, name, dtypes, shapes, wanted):
    array = np.asarray(value)
    if array.dtype not in dtypes:
        raise ValueError(f"{name}: dtype {array.dtype}: must be {' or '.join(dtypes)}")
    return _of_shape(array, name, shapes, wanted)


def _color(value, name, is_bgr):
    """(height, width, 3), red first."""
    array = _bytes(value, name, ["uint8"], [(None, None), (None, None, 3)], "(height, width) or (height, width, 3)")
    if array.ndim == 2:
        return np.repeat(array[..., None], 3, axis=2)
    return array[..., ::-1] if is_bgr else array


def _mask(value, name):
    return None if value is None else _bytes(value, name, ["bool", "uint8"], [(None, None)], "(height, width)")


def _prior_depth(value, name):
    return None if value is None else _map(value, name)


def _depth_range(value, name):
    return None if value is None else tuple(_numbers(value, name, [(2,)], "(near, far)"))


def _of_each(value, name, count, convert):
    """convert(element, its name) for each image; without a value None."""
    if value is None:
        return [None] * count
    return [convert(element, f"{name}[{i}]") for i, element in enumerate(_elements(value, name, count))]


def _cameras(value, count):
    k = _numbers(value, "K", [(3, 3), (count, 3, 3)], f"(3, 3), or ({count}, 3, 3) for {count} images")
    return np.broadcast_to(k, (count, 3, 3))


def _poses(value, name, count):
    return _numbers(value, name, [(count, 4, 4), (count, 3, 4)],
                    f"({count}, 4, 4) or ({count}, 3, 4) for {count} images")


def _depth_ranges(value, count):
    if value is not None:
        elements = _elements(value, "depth_range")
        if len(elements) == 2 and elements[0] is not None and np.ndim(elements[0]) == 0:
            return [_depth_range(value, "depth_range")] * count
    return _of_each(value, "depth_range", count, _depth_range)


def _assignment(name, value):
    return f"{name}={str(value).lower() if isinstance(value, (bool, np.bool_)) else value}"


def reconstruct(
    images: Sequence[np.ndarray],
    K: ArrayLike,
    *,
    cam_from_world: Optional[ArrayLike] = None,
    world_from_cam: Optional[ArrayLike] = None,
    depth_range: Union[Tuple[float, float], Sequence[Optional[Tuple[float, float]]], None] = None,
    points: Union[ArrayLike, Sequence[ArrayLike], None] = None,
    masks: Optional[Sequence[Optional[np.ndarray]]] = None,
    prior_depth: Optional[Sequence[Optional[ArrayLike]]] = None,
    ranked_sources: Optional[Sequence[Sequence[int]]] = None,
    names: Optional[Sequence[str]] = None,
    color_order: str = "rgb",
    preset: str = "balanced",
    options: Mapping[str, Any] = {},
    source_views: int = 10,
    max_image_size: int = 0,
    seed: int = 1,
    device: str = "auto",
) -> Reconstruction:
    """Depth, normals and confidence of images with known cameras, and one point cloud.

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
      prior_depth: for each image None or an array (h, w) of real numbers, z of the whole image at any size, of a network or
          another sensor, for what no view confirms; unknown where it is not finite and > 0. Its scale is fitted.
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
      Reconstruction. What was left aside, that hardly any pixel became a point, and that the poses do not fit the images
      (with what fits, such as inverted ones) is a UserWarning.

    Raises:
      ValueError: names the value that is wrong and its bound.
      RuntimeError: a device failed or there is not enough memory."""
    if color_order not in ("rgb", "bgr"):
        raise ValueError(f"color_order = {color_order}: must be rgb or bgr")
    colors = [_color(image, f"images[{i}]", color_order == "bgr") for i, image in enumerate(_elements(images, "images"))]
    count = len(colors)
    if count == 0:
        raise ValueError("images: there are none")
    cameras = _cameras(K, count)
    if (cam_from_world is None) == (world_from_cam is None):
        raise ValueError("poses: give either cam_from_world or world_from_cam")
    pose_name = "cam_from_world" if world_from_cam is None else "world_from_cam"
    poses = _poses(cam_from_world if world_from_cam is None else world_from_cam, pose_name, count)
    in_all = isinstance(points, np.ndarray) and points.ndim == 2
    sparse = [_points(points, "points")] if in_all else _of_each(points, "points", count, _points)
    results, cloud, used_device = _offline.reconstruct(
        colors, cameras, poses, pose_name, _depth_ranges(depth_range, count), in_all, sparse,
        _of_each(masks, "masks", count, _mask), _of_each(prior_depth, "prior_depth", count, _prior_depth),
        [[]] * count if ranked_sources is None else _elements(ranked_sources, "ranked_sources", count),
        [str(i) for i in range(count)] if names is None else _elements(names, "names", count), preset,
        [_assignment(*option) for option in options.items()], source_views, max_image_size, seed, device)
    return Reconstruction([ImageResult(*result) for result in results], Cloud(*cloud), used_device)


def read_scene(folder: str, *, format: str = "auto", pixel_centers: str = "integer", masks: str = "",
               prior_depth: str = "", image_path: str = "") -> dict[str, Any]:
    """Reads a folder with a COLMAP model or the layout of MVSNet and ACMP, as acmp_reconstruct does.

    reconstruct(**read_scene(folder)) does the whole folder. Images with lens distortion are undistorted, and those of more
    than 120 degrees become several each, the faces of a cube. All images are in memory: 3 bytes per pixel.

    Args:
      folder: of the scene.
      format: "auto", "colmap" or "mvsnet".
      pixel_centers: of mvsnet, where K has the centre of the first pixel: "integer" (0, 0) or "half" (0.5, 0.5).
      masks: folder of masks, IMAGE_NAME.png each: what is black is ignored. Empty: none.
      prior_depth: folder of depth maps from outside, as for acmp_reconstruct --prior-depth. Empty: none.
      image_path: folder of the images. Empty: images in `folder`.

    Returns:
      dict of the arguments of reconstruct() by name: images (RGB), K, cam_from_world, points, depth_range, masks,
      prior_depth, ranked_sources, names. What is left aside is a UserWarning.

    Raises:
      ValueError: names file, line and value of what is missing, damaged or out of bounds."""
    scene = _offline.read_scene(str(folder), format, pixel_centers, str(masks), str(prior_depth), str(image_path))
    return {**scene, "K": np.stack(scene["K"]), "cam_from_world": np.stack(scene["cam_from_world"])}


def evaluate_depth(depth: ArrayLike, truth: ArrayLike, mask: Optional[ArrayLike] = None) -> dict[str, Any]:
    """Compares a depth map with the truth, at every pixel where the truth is known.

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
      ValueError: wrong shapes or dtypes."""
    return _offline.evaluate_depth(_map(depth, "depth"), _map(truth, "truth"), _mask(mask, "mask"))


def evaluate_cloud(points: ArrayLike, truth: ArrayLike, thresholds: Sequence[float] = (0.02, 0.05),
                   voxel_size: float = 0.01) -> list[dict[str, float]]:
    """Compares points with true ones, as the ETH3D multi-view benchmark does.

    Args:
      points: (M, 3) finite numbers, of the reconstruction.
      truth: (L, 3) finite numbers, at least one.
      thresholds: distances, > 0.
      voxel_size: shares are taken in voxels of this size and averaged, so that dense regions do not dominate; > 0.

    Returns:
      list of dict, one per threshold: threshold; accuracy, percent of `points` within it of the truth; completeness,
      percent of `truth` within it of the points; f1, their harmonic mean.

    Raises:
      ValueError: wrong shapes or values."""
    return _offline.evaluate_cloud(_points(points, "points"), _points(truth, "truth"), list(thresholds), voxel_size)
