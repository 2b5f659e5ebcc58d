"""Types of acmp_mapping.offline for editors and type checkers; what the values mean is in its docstrings."""
from typing import Any, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike

class Cloud:
    points: np.ndarray
    normals: np.ndarray
    colors: np.ndarray
    confidence: np.ndarray

class ImageResult:
    name: str
    depth: Optional[np.ndarray]
    normal: Optional[np.ndarray]
    cost: Optional[np.ndarray]
    confidence: Optional[np.ndarray]
    K: np.ndarray
    cam_from_world: np.ndarray
    source_views: list[int]
    no_map: str

class Reconstruction:
    images: list[ImageResult]
    cloud: Cloud
    device: str

def reconstruct(
    images: Sequence[np.ndarray],
    K: ArrayLike,
    *,
    cam_from_world: Optional[ArrayLike] = None,
    world_from_cam: Optional[ArrayLike] = None,
    depth_range: Union[Tuple[float, float], Sequence[Optional[Tuple[float, float]]], None] = None,
    points: Union[ArrayLike, Sequence[ArrayLike], None] = None,
    masks: Optional[Sequence[Optional[np.ndarray]]] = None,
    ranked_sources: Optional[Sequence[Sequence[int]]] = None,
    names: Optional[Sequence[str]] = None,
    color_order: str = "rgb",
    preset: str = "balanced",
    options: Mapping[str, Any] = {},
    source_views: int = 10,
    max_image_size: int = 0,
    seed: int = 1,
    device: str = "auto",
) -> Reconstruction: ...
def read_scene(
    folder: str, *, format: str = "auto", pixel_centers: str = "integer", masks: str = ""
) -> dict[str, Any]: ...
def evaluate_depth(depth: ArrayLike, truth: ArrayLike, mask: Optional[ArrayLike] = None) -> dict[str, Any]: ...
def evaluate_cloud(
    points: ArrayLike, truth: ArrayLike, thresholds: Sequence[float] = [0.02, 0.05], voxel_size: float = 0.01
) -> list[dict[str, float]]: ...
