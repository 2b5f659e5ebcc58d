#!/usr/bin/python3
"""Draws a mesh (PLY of save_map or acmp_reconstruct --mesh) into a picture: in colour and, beside it, by its shape alone.

usage: draw_mesh.py MESH.ply PICTURE.png [--up X Y Z] [--size PIXELS]

Looks from the side from which most of the surface was seen, from above. Triangles seen from behind are left out, so that one
looks into a room through its walls. No display and no OpenGL: numpy and PIL draw. Exits with 2 for unusable files."""
import argparse
import sys

import numpy as np
from PIL import Image

PLY_TYPES = {"float": "<f4", "uchar": "u1", "int": "<i4", "uint": "<u4"}
FOCAL = 1.2           # focal length over the width of the picture
ASPECT = 0.75         # height over width of each half
FILLED = 0.96         # share of the picture that the mesh fills
LIFT = 0.7            # how much the viewer looks down: tangent of the angle
BACKGROUND = (38, 40, 46)
GREY, AMBIENT = 235.0, 0.15
BATCH_PIXELS = 1 << 20  # pixels of triangles that are looked at at once: bounds the memory


def read_header(file):
    """Of each element of a PLY file: how many there are and the words of their properties."""
    elements, element = {}, None
    for line in iter(file.readline, b"end_header\n"):
        words = line.decode("ascii", "replace").split()
        if words[:1] == ["element"] and len(words) == 3:
            element = elements[words[1]] = (int(words[2]), [])
        elif words[:1] == ["property"] and element:
            element[1].append(words[1:])
        elif words[:1] not in (["comment"], ["format"], ["ply"]):
            raise ValueError("the header has the line %r" % line)
    return elements


def read_records(file):
    """Vertices and faces of a binary PLY file, whose faces must have three corners."""
    if file.readline() != b"ply\n" or file.readline() != b"format binary_little_endian 1.0\n":
        raise ValueError("no binary PLY file")
    elements = read_header(file)
    if list(elements) != ["vertex", "face"]:
        raise ValueError("no vertices and faces")
    (vertex_count, vertex), (face_count, ((_, count, index, _),)) = elements["vertex"], elements["face"]
    vertex = np.dtype([(name, PLY_TYPES[kind]) for kind, name in vertex])
    face = np.dtype([("count", PLY_TYPES[count]), ("index", PLY_TYPES[index], 3)])
    data = file.read()
    return np.frombuffer(data, vertex, vertex_count), np.frombuffer(data, face, face_count, vertex_count * vertex.itemsize)


def read_mesh(path):
    """Positions, normals and colours (0..255) of the vertices, N x 3 each, and the triangles, M x 3. Raises OSError, and
    ValueError for what is no mesh with normals and colours."""
    try:
        with open(path, "rb") as file:
            vertices, faces = read_records(file)
        positions, normals, colors = (np.stack([vertices[name].astype(float) for name in names.split()], 1)
                                      for names in ("x y z", "nx ny nz", "red green blue"))
        triangles = faces["index"].astype(np.int64)
        if len(faces) == 0 or (faces["count"] != 3).any():
            raise ValueError("no triangles, or others")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError("triangles of vertices that are not there")
    except (KeyError, ValueError) as error:
        raise ValueError("%s: %s" % (path, error)) from error
    return positions, normals, colors, triangles


def unit(vector):
    return vector / max(np.linalg.norm(vector), 1e-12)


def choose_view(points, normals, up):
    """The viewer's position and the axes of its picture (right, down, forward) as rows."""
    centre = np.percentile(points, [2, 98], axis=0).mean(0)
    seen_from = normals.mean(0) - up * (normals.mean(0) @ up)
    if np.linalg.norm(seen_from) < 1e-6:  # from all sides, or from above alone
        seen_from = np.cross(up, [0.0, 1.0, 0.0] if abs(up[1]) < 0.9 else [1.0, 0.0, 0.0])
    forward = -unit(unit(seen_from) + LIFT * up)
    right = unit(np.cross(forward, up))
    axes = np.stack([right, np.cross(forward, right), forward])
    seen = (points - centre) @ axes.T
    distances = FOCAL * (np.abs(seen[:, :2]) / [1, ASPECT]).max(1) / (0.5 * FILLED) - seen[:, 2]
    return centre - forward * np.percentile(distances, 99), axes


def draw_batch(corners, first, size, nearest, owner, weights):
    """Fills in for each pixel where one of these triangles (T x 3 corners of column, row, depth) is the nearest."""
    width, height = size
    low = np.clip(np.ceil(corners[:, :, :2].min(1)), 0, [width, height]).astype(int)
    high = np.clip(np.floor(corners[:, :, :2].max(1)) + 1, 0, [width, height]).astype(int)
    spans = np.maximum(high - low, 0)
    areas = spans.prod(1)
    which = np.repeat(np.arange(len(corners)), areas)
    step = np.arange(len(which)) - np.repeat(np.cumsum(areas) - areas, areas)
    cols, rows = low[which, 0] + step % spans[which, 0], low[which, 1] + step // spans[which, 0]
    (ax, ay), (bx, by), (cx, cy) = (corners[which, k, :2].T for k in range(3))
    doubled = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    a = ((bx - cols) * (cy - rows) - (cx - cols) * (by - rows)) / doubled
    b = ((cx - cols) * (ay - rows) - (ax - cols) * (cy - rows)) / doubled
    shares = np.stack([a, b, 1 - a - b], 1)
    depth = (shares * corners[which, :, 2]).sum(1)
    pixels = rows * width + cols
    kept = np.flatnonzero((shares >= 0).all(1) & (depth < nearest[pixels]))
    kept = kept[np.argsort(-depth[kept], kind="stable")]  # the nearest is written last
    nearest[pixels[kept]] = depth[kept]
    owner[pixels[kept]] = first[which[kept]]
    weights[pixels[kept]] = shares[kept]


def rasterize(corners, size):
    """For each pixel (row by row) the triangle that is seen there, -1: none, and its corners' weights."""
    width, height = size
    (ax, ay), (bx, by), (cx, cy) = (corners[:, k, :2].T for k in range(3))
    in_front = (corners[:, :, 2] > 0).all(1)
    visible = np.flatnonzero(in_front & ((bx - ax) * (cy - ay) - (cx - ax) * (by - ay) < 0))
    box = np.clip(corners[visible, :, :2], 0, [width, height])
    areas = (np.ptp(box, axis=1) + 1).prod(1)
    batch = (np.cumsum(areas) // BATCH_PIXELS).astype(int)
    nearest = np.full(width * height, np.inf)
    owner = np.full(width * height, -1)
    weights = np.zeros((width * height, 3))
    for part in np.split(visible, np.flatnonzero(np.diff(batch)) + 1):
        draw_batch(corners[part], part, size, nearest, owner, weights)
    return owner, weights


def draw(mesh, up, width):
    points, normals, colors, triangles = mesh
    size = width, round(ASPECT * width)
    eye, axes = choose_view(points, normals, unit(np.asarray(up, float)))
    seen = (points - eye) @ axes.T
    depth = np.where(seen[:, 2] > 0, seen[:, 2], -1.0)
    projected = np.column_stack([FOCAL * width * seen[:, :2] / depth[:, None] + np.array(size) / 2, depth])
    owner, weights = rasterize(projected[triangles], size)
    shown = owner >= 0
    corner = triangles[owner[shown]]
    light = -axes[2] - 0.5 * axes[1] - 0.4 * axes[0]  # behind the viewer, from above and from the left
    normal = (normals[corner] * weights[shown][:, :, None]).sum(1)
    shade = AMBIENT + (1 - AMBIENT) * np.clip(0.5 + 0.5 * (normal @ unit(light)), 0, 1)  # dark only where it faces away
    picture = np.empty((2, size[1] * size[0], 3), np.uint8)
    picture[:] = BACKGROUND
    picture[0, shown] = (colors[corner] * weights[shown][:, :, None]).sum(1)
    picture[1, shown] = (GREY * shade)[:, None]
    return np.hstack(picture.reshape(2, size[1], size[0], 3)), len(triangles)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh")
    parser.add_argument("picture")
    parser.add_argument("--up", type=float, nargs=3, default=[0, 0, 1], metavar=("X", "Y", "Z"), help="in the mesh's world")
    parser.add_argument("--size", type=int, default=640, help="width of each half of the picture, px")
    arguments = parser.parse_args()
    try:
        picture, triangles = draw(read_mesh(arguments.mesh), arguments.up, arguments.size)
        Image.fromarray(picture).save(arguments.picture, optimize=True)
    except (OSError, ValueError) as error:
        print("draw_mesh: %s" % error, file=sys.stderr)
        return 2
    print("mesh: %d triangles, drawn in %s" % (triangles, arguments.picture))
    return 0


if __name__ == "__main__":
    sys.exit(main())
