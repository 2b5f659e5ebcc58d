#!/usr/bin/python3
"""Draws a mesh (PLY of save_map or acmp_reconstruct --mesh) into a picture: in colour and, beside it, by its shape alone.

usage: draw_mesh.py MESH.ply PICTURE.png [--up X Y Z] [--size PIXELS]

Looks from the side from which most of the surface was seen, from above. Triangles seen from behind are left out, so that one
looks into a room through its walls. No display and no OpenGL: numpy and PIL draw. Exits with 2 for unusable files."""
import argparse
import sys

import numpy as np
from PIL import Image, ImageDraw

PLY_TYPES = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
FOCAL = 1.2           # focal length over the width of the picture
ASPECT = 0.75         # height over width of each half
FILLED = 0.94         # share of the picture that the mesh fills
LIFT = 0.7            # how much the viewer looks down: tangent of the angle
BACKGROUND = (38, 40, 46)
GREY, AMBIENT = 235.0, 0.15


def read_records(file):
    """Vertices and faces of a binary PLY file, whose faces must have three corners."""
    header, _, data = file.read().partition(b"end_header\n")
    header = [line.split() for line in header.decode("ascii", "replace").splitlines()]
    if header[:2] != [["ply"], ["format", "binary_little_endian", "1.0"]]:
        raise ValueError("no binary PLY file")
    elements = {}  # name: how many, and the words of their properties
    for words in header[2:]:
        if words[0] == "element":
            elements[words[1]] = count, properties = int(words[2]), []
        elif words[0] == "property":
            properties.append(words[1:])
        elif words[0] != "comment":
            raise ValueError(f"the header has {' '.join(words)!r}")
    (vertex_count, vertex), (face_count, ((_, count, index, _),)) = elements["vertex"], elements["face"]
    vertex = np.dtype([(name, PLY_TYPES[kind]) for kind, name in vertex])
    face = np.dtype([("count", PLY_TYPES[count]), ("index", PLY_TYPES[index], 3)])
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
    except (IndexError, KeyError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
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


def draw(mesh, up, width):
    """The picture, and of how many triangles the mesh is. Each is drawn in one colour over those that are farther away."""
    points, normals, colors, triangles = mesh
    size = width, round(ASPECT * width)
    eye, axes = choose_view(points, normals, unit(np.asarray(up, float)))
    seen = (points - eye) @ axes.T
    depth = np.where(seen[:, 2] > 0, seen[:, 2], -1.0)
    projected = np.column_stack([FOCAL * width * seen[:, :2] / depth[:, None] + np.array(size) / 2, depth])
    corners = projected[triangles]
    (ax, ay), (bx, by), (cx, cy) = (corners[:, k, :2].T for k in range(3))
    faces_us = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay) < 0
    visible = np.flatnonzero((corners[:, :, 2] > 0).all(1) & faces_us)
    visible = visible[np.argsort(-corners[visible, :, 2].mean(1), kind="stable")]
    light = -axes[2] - 0.5 * axes[1] - 0.4 * axes[0]  # behind the viewer, from above and from the left
    shade = 0.5 + 0.5 * (normals[triangles[visible]].mean(1) @ unit(light))  # dark only where it faces away
    greys = np.rint(GREY * (AMBIENT + (1 - AMBIENT) * np.clip(shade, 0, 1))).astype(int)
    halves = [Image.new("RGB", size, BACKGROUND) for _ in range(2)]
    colored, shape = (ImageDraw.Draw(half) for half in halves)
    for corner, color, grey in zip(corners[visible, :, :2], np.rint(colors[triangles[visible]].mean(1)).astype(int), greys):
        polygon = [tuple(point) for point in corner]
        colored.polygon(polygon, fill=tuple(color))
        shape.polygon(polygon, fill=(grey, grey, grey))
    return np.hstack([np.asarray(half) for half in halves]), len(triangles)


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
        print(f"draw_mesh: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"mesh: {triangles} triangles, drawn in {arguments.picture}")


if __name__ == "__main__":
    main()
