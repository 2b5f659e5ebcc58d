#!/usr/bin/python3
"""Poses that scripts/perturb_poses.py writes.

usage: perturb_poses_test.py SOURCE_FOLDER"""
import math
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPT = os.path.join(os.path.abspath(sys.argv.pop(1)), "scripts", "perturb_poses.py")
sys.dont_write_bytecode = True
sys.path.insert(0, os.path.dirname(SCRIPT))
import perturb_poses

# Turned by 90 degrees about z, 2 in front of the origin.
POSE = [[0.0, -1.0, 0.0, 0.5], [1.0, 0.0, 0.0, -0.25], [0.0, 0.0, 1.0, 2.0]]
REST = "0 0 0 1\n\nintrinsic\n500 0 160\n0 500 120\n0 0 1\n\n1.5 0.02 192 5.2\n"


def rows_of(path):
    return [[float(x) for x in line.split()] for line in path.read_text().split("\n")[1:4]]


def center_of(pose):
    return [-sum(pose[k][i] * pose[k][3] for k in range(3)) for i in range(3)]


def angle_between(a, b):
    trace = sum(a[i][k] * b[i][k] for i in range(3) for k in range(3))
    return math.degrees(math.acos(max(-1.0, min(1.0, (trace - 1) / 2))))


class PerturbPoses(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        self.scene = self.root / "scene"
        (self.scene / "images").mkdir(parents=True)
        (self.scene / "cams").mkdir()
        (self.scene / "pair.txt").write_text("0\n")
        for i in range(200):
            text = "extrinsic\n" + "\n".join(" ".join(map(str, row)) for row in POSE) + "\n" + REST
            (self.scene / "cams" / ("%08d_cam.txt" % i)).write_text(text)

    def run_script(self, output, rotation, position, seed=1):
        return subprocess.run([sys.executable, SCRIPT, str(self.scene), str(self.root / output), "--rotation-deg",
                               str(rotation), "--position", str(position), "--seed", str(seed)],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True)

    def poses(self, output):
        return [rows_of(path) for path in sorted((self.root / output / "cams").iterdir())]

    def test_errors_have_the_size_that_was_asked_for(self):
        self.assertEqual(self.run_script("out", 0.5, 0.01).returncode, 0)
        turns, moves = 0, 0
        for pose in self.poses("out"):
            for i in range(3):
                for k in range(3):
                    dot = sum(pose[i][j] * pose[k][j] for j in range(3))
                    self.assertAlmostEqual(dot, float(i == k), places=9)
            turns += angle_between(pose, POSE)**2
            moves += sum((a - b)**2 for a, b in zip(center_of(pose), center_of(POSE)))
        # Mean squares of 600 numbers: their relative standard deviation is sqrt(2 / 600) = 6 %; five of them.
        self.assertAlmostEqual(turns / 600 / 0.5**2, 1, delta=0.3)
        self.assertAlmostEqual(moves / 600 / 0.01**2, 1, delta=0.3)

    def test_without_errors_the_scene_stays_the_same(self):
        self.assertEqual(self.run_script("out", 0, 0).returncode, 0)
        for pose in self.poses("out"):
            for row, expected in zip(pose, POSE):
                for value, true in zip(row, expected):
                    self.assertAlmostEqual(value, true, places=12)
        text = (self.root / "out" / "cams" / "00000007_cam.txt").read_text()
        self.assertTrue(text.endswith(REST))
        self.assertEqual((self.root / "out" / "images").resolve(), (self.scene / "images").resolve())
        self.assertEqual((self.root / "out" / "pair.txt").read_text(), "0\n")

    def test_a_turn_is_about_the_axes_of_the_camera_and_keeps_its_place(self):
        turned = perturb_poses.perturbed(POSE, [0, 0, math.radians(90)], [0, 0, 0])
        for value, expected in zip(center_of(turned), center_of(POSE)):
            self.assertAlmostEqual(value, expected)
        # A point on the camera's x axis lies on its y axis when the frame has been turned by 90 degrees about z.
        point = [sum(POSE[k][i] * ((1, 0, 0)[k] - POSE[k][3]) for k in range(3)) for i in range(3)]
        seen = [sum(row[k] * point[k] for k in range(3)) + row[3] for row in turned]
        for value, expected in zip(seen, (0, 1, 0)):
            self.assertAlmostEqual(value, expected)


if __name__ == "__main__":
    unittest.main()
