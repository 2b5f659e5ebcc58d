#!/usr/bin/python3
"""scripts/draw_mesh.py on meshes of which the picture is known.

usage: draw_mesh_test.py SOURCE_FOLDER"""
import os
import struct
import subprocess
import sys
import tempfile
import unittest

import numpy as np
from PIL import Image

SCRIPT = os.path.join(os.path.abspath(sys.argv.pop(1)), "scripts/draw_mesh.py")
WIDTH, HEIGHT = 64, 48
RED, GREEN, BLUE, BACKGROUND = (250, 0, 0), (0, 250, 0), (0, 0, 250), (38, 40, 46)
sys.path.insert(0, os.path.dirname(SCRIPT))
import draw_mesh  # noqa: E402


def square(y, half, color, towards=-1):
    """Corners, normals, colours and two triangles of an upright square about (0, y, 0) that is seen from y = towards."""
    corners = np.array([[-half, y, -half], [half, y, -half], [half, y, half], [-half, y, half]], float)
    order = np.array([[0, 1, 2], [0, 2, 3]])  # counterclockwise for who is in front, where y is smaller
    return corners, np.tile([0.0, towards, 0.0], (4, 1)), np.tile(color, (4, 1)), order if towards < 0 else order[:, ::-1]


def write(path, *parts, faces=None, origin=None):
    """With an origin, which is added, coordinates are double, as those of maps far from it."""
    corners, normals, colors = (np.concatenate([part[k] for part in parts]) for k in range(3))
    triangles = np.concatenate([part[3] + 4 * i for i, part in enumerate(parts)]) if faces is None else faces
    with open(path, "wb") as file:
        file.write(b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n" % len(corners))
        for name in "x y z nx ny nz".split():
            file.write(b"property %s %s\n" % (b"double" if origin is not None and len(name) == 1 else b"float", name.encode()))
        for name in "red green blue".split():
            file.write(b"property uchar %s\n" % name.encode())
        file.write(b"element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(triangles))
        for row in zip(corners, normals, colors):
            position = struct.pack("<3f", *row[0]) if origin is None else struct.pack("<3d", *(row[0] + origin))
            file.write(position + struct.pack("<3f3B", *row[1], *map(int, row[2])))
        for triangle in triangles:
            file.write(struct.pack("<B3i", 3, *map(int, triangle)))


class DrawMesh(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.mesh = os.path.join(self.folder.name, "mesh.ply")

    def draw(self, *parts, origin=None):
        """The coloured half and the half of its shape."""
        write(self.mesh, *parts, origin=origin)
        picture, triangles = draw_mesh.draw(draw_mesh.read_mesh(self.mesh), [0, 0, 1], WIDTH)
        self.assertEqual(triangles, 2 * len(parts))
        self.assertEqual(picture.shape, (HEIGHT, 2 * WIDTH, 3))
        return picture[:, :WIDTH], picture[:, WIDTH:]

    def count(self, picture, color):
        return int((np.abs(picture.astype(int) - color).max(-1) <= 1).sum())

    def test_a_square_is_seen_whole_and_without_gaps(self):
        colored, shape = self.draw(square(0, 1, GREEN))
        green = np.abs(colored.astype(int) - GREEN).max(-1) <= 1
        self.assertEqual(green.sum() + self.count(colored, BACKGROUND), WIDTH * HEIGHT)
        self.assertGreater(green.sum(), WIDTH * HEIGHT // 4)
        self.assertFalse(green[[0, -1]].any() or green[:, [0, -1]].any(), "it goes out of the picture")
        for row in green[green.any(1)]:  # one run of pixels: no gap along the diagonal
            self.assertEqual(np.abs(np.diff(row.astype(int))).sum(), 2)
        self.assertEqual((shape != BACKGROUND).any(-1).sum(), green.sum())

    def test_the_nearest_is_seen_whatever_comes_first(self):
        near, far = square(-0.5, 0.3, RED), square(0.5, 1, GREEN)
        first, second = self.draw(near, far)[0], self.draw(far, near)[0]
        np.testing.assert_array_equal(first, second)
        self.assertGreater(self.count(first, RED), 50)
        self.assertGreater(self.count(first, GREEN), 200)

    def test_a_mesh_far_from_the_origin_is_seen_as_one_near_it(self):
        parts = square(-0.5, 0.3, RED), square(0.5, 1, GREEN)
        near, far = self.draw(*parts), self.draw(*parts, origin=np.array([2.0**22, -2.0**22, 2.0**9]))
        np.testing.assert_array_equal(near, far)

    def test_what_is_seen_from_behind_is_left_out(self):
        colored, _ = self.draw(square(0.5, 1, GREEN), square(0.6, 1, GREEN), square(-0.5, 0.3, BLUE, towards=1))
        self.assertEqual(self.count(colored, BLUE), 0)
        self.assertGreater(self.count(colored, GREEN), 200)

    def test_bad_files_are_told(self):
        write(self.mesh, square(0, 1, RED))
        with open(self.mesh, "rb") as file:
            good = file.read()
        bad = {"cut": good[:-5], "other": b"solid\n" + good, "no_header": good[:60],
               "points": good.replace(b"element face 2", b"element face 0"),
               "other_type": good.replace(b"property float nx", b"property where nx")}
        for name, data in bad.items():
            with self.subTest(name):
                with open(self.mesh, "wb") as file:
                    file.write(data)
                self.assert_refused()
        with self.subTest("index"):
            write(self.mesh, square(0, 1, RED), faces=np.array([[0, 1, 4]]))
            self.assert_refused()

    def assert_refused(self):
        with self.assertRaisesRegex(ValueError, self.mesh):
            draw_mesh.read_mesh(self.mesh)

if __name__ == "__main__":
    unittest.main(verbosity=2)
