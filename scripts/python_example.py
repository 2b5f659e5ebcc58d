#!/usr/bin/python3
"""Depth of all images of a folder from Python, without files in between: an example of acmp_mapping.offline.

FOLDER has a COLMAP model with its images, or the layout of MVSNet and ACMP, as the scenes of acmp_make_scene. Where it has
true depth (depth/000000.png, millimetres) the maps are compared with it. With --output, maps and cloud are saved in one
file for numpy.load.

Example, after source scripts/ros_environment.sh $PWD/build:
  acmp_make_scene room
  scripts/python_example.py room --output room.npz"""

import argparse
import sys
from pathlib import Path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--preset", default="balanced")
    parser.add_argument("--max-image-size", type=int, default=0)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--output", help="file, .npz")
    arguments = parser.parse_args()
    try:  # after --help, which needs neither
        import numpy as np
        from acmp_mapping import offline
    except ImportError as error:
        parser.error(f"{error}: source scripts/ros_environment.sh $PWD/build first (docs/python.md)")

    scene = offline.read_scene(arguments.folder)  # a dict: images, K, cam_from_world, points and more, all numpy
    result = offline.reconstruct(**scene, preset=arguments.preset, max_image_size=arguments.max_image_size,
                                 device=arguments.device)
    arrays = {"points": result.cloud.points, "colors": result.cloud.colors, "normals": result.cloud.normals}
    for index, image in enumerate(result.images):
        if image.depth is None:
            print(f"{image.name}: no map: {image.no_map}")
            continue
        sure = image.confidence > 0.5
        line = f"{image.name}: {100 * sure.mean():.1f} % of pixels with confidence above 0.5"
        truth = Path(arguments.folder, "depth", f"{index:06d}.png")
        if truth.exists():
            from PIL import Image  # Debian: python3-pil
            found = offline.evaluate_depth(image.depth, np.asarray(Image.open(truth)).astype(np.float32) / 1000)
            line += f"; median error {found['median_error']:.4f}, {found['below_relative'][0.02]:.1f} % within 2 %"
        print(line)
        arrays.update({f"depth_{index}": image.depth, f"normal_{index}": image.normal, f"K_{index}": image.K})
    print(f"{len(result.cloud.points)} points, made by {result.device}")
    if arguments.output:
        np.savez_compressed(arguments.output, **arrays)


if __name__ == "__main__":
    try:
        main()
    except (ValueError, RuntimeError) as error:
        print(f"python_example.py: {error}", file=sys.stderr)
        sys.exit(2 if isinstance(error, ValueError) else 1)
