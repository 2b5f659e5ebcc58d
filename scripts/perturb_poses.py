#!/usr/bin/env python3
"""Copies a scene with errors in its poses, as those of a SLAM system have: what depth maps are worth then (docs/experiments.md).

    scripts/perturb_poses.py SCENE OUTPUT --rotation-deg 0.03 --position 0.001
    acmp_reconstruct OUTPUT out && acmp_evaluate depth SCENE out/depth

SCENE has images/, cams/ and pair.txt (MVSNet's layout); so has OUTPUT, where images/ is a link. Errors are independent and
normally distributed: rotations about the axes of each camera, positions along those of the world.
"""
import argparse
import math
import random
import shutil
import sys
from pathlib import Path


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def rotation_about(vector):
    """Rodrigues' formula: by the vector's length in radians about its direction."""
    angle = math.sqrt(sum(x * x for x in vector))
    if angle == 0:
        return [[float(i == j) for j in range(3)] for i in range(3)]
    x, y, z = vector
    cross = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    twice = product(cross, cross)
    a, b = math.sin(angle) / angle, (1 - math.cos(angle)) / angle**2
    return [[(i == j) + a * cross[i][j] + b * twice[i][j] for j in range(3)] for i in range(3)]


def perturbed(extrinsic, rotation_error, position_error):
    """Rows of T_cam_world whose camera is turned and moved. Position: scene units, axes of the world."""
    rotation = [row[:3] for row in extrinsic]
    center = [-sum(rotation[k][i] * extrinsic[k][3] for k in range(3)) + position_error[i] for i in range(3)]
    turned = product(rotation_about(rotation_error), rotation)
    return [row + [-sum(row[k] * center[k] for k in range(3))] for row in turned]


def perturb_file(source, target, draw_rotation, draw_position):
    lines = source.read_text().split("\n")
    try:
        first = [line.strip() for line in lines].index("extrinsic") + 1
        extrinsic = [[float(x) for x in lines[first + i].split()] for i in range(3)]
        if any(len(row) != 4 for row in extrinsic):
            raise ValueError("a row without four numbers")
    except (ValueError, IndexError) as error:
        raise SystemExit("%s: no extrinsic of three rows of four numbers (%s)" % (source, error))
    for i, row in enumerate(perturbed(extrinsic, draw_rotation(), draw_position())):
        lines[first + i] = " ".join("%.12g" % x for x in row)
    target.write_text("\n".join(lines))


def not_negative(text):
    value = float(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError("%s: must be finite and at least 0" % text)
    return value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("output", type=Path, help="must not exist")
    parser.add_argument("--rotation-deg", type=not_negative, required=True, help="standard deviation per axis, degrees")
    parser.add_argument("--position", type=not_negative, required=True, help="standard deviation per axis, scene units")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cameras = sorted((options.scene / "cams").glob("*_cam.txt"))
    if not cameras or not (options.scene / "pair.txt").is_file() or not (options.scene / "images").is_dir():
        raise SystemExit("%s: needs images/, cams/*_cam.txt and pair.txt" % options.scene)
    if options.output.exists():
        raise SystemExit("%s: exists" % options.output)
    (options.output / "cams").mkdir(parents=True)
    (options.output / "images").symlink_to((options.scene / "images").resolve())
    shutil.copy(options.scene / "pair.txt", options.output)
    random_numbers = random.Random(options.seed)
    turn = math.radians(options.rotation_deg)
    for path in cameras:
        perturb_file(path, options.output / "cams" / path.name,
                     lambda: [random_numbers.gauss(0, turn) for _ in range(3)],
                     lambda: [random_numbers.gauss(0, options.position) for _ in range(3)])
    print("%d poses with errors of %g degrees and %g per axis in %s" %
          (len(cameras), options.rotation_deg, options.position, options.output))


if __name__ == "__main__":
    sys.exit(main())
