"""pycolmap reads the model that acmp_reconstruct --colmap writes: cameras, poses, points, and that the images that a point names
see it where its feature is, within 1 px. Skipped (exit code 77) without pycolmap, which is not in Debian.
Usage: pycolmap_test.py FOLDER_OF_THE_PROGRAMS"""
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

try:
    import pycolmap
except ImportError as error:
    print(f"skipped: {error} (PyPI: pip install --target FOLDER pycolmap, and PYTHONPATH=FOLDER)")
    sys.exit(77)

PROGRAMS = Path(sys.argv.pop(1)).absolute()
IMAGES, WIDTH, HEIGHT = 6, 160, 120


def run(program, *arguments):
    subprocess.run([PROGRAMS / program, *arguments], check=True, stdout=subprocess.DEVNULL)


class Model(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        work = Path(cls.folder.name)
        run("acmp_make_scene", work / "room", "--width", str(WIDTH), "--height", str(HEIGHT), "--keyframes", str(IMAGES))
        run("acmp_reconstruct", work / "room", work / "out", "--colmap", "--preset", "online", "--device", "cpu", "--quiet",
            "--no-pictures")
        cls.given = pycolmap.Reconstruction(str(work / "room/sparse/0"))
        cls.written = pycolmap.Reconstruction(str(work / "out/colmap/sparse/0"))

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @staticmethod
    def pose(image):
        pose = image.cam_from_world
        return (pose() if callable(pose) else pose).matrix()  # a method from pycolmap 3.12 on

    def test_cameras(self):
        self.assertTrue(self.written.cameras)
        for camera in self.written.cameras.values():
            self.assertEqual((camera.width, camera.height), (WIDTH, HEIGHT))
            given = next(iter(self.given.cameras.values()))
            # Both are pinholes of the same size: nothing is resampled.
            np.testing.assert_allclose(camera.calibration_matrix(), given.calibration_matrix(), atol=1e-9)

    def test_poses(self):
        given = {image.name: self.pose(image) for image in self.given.images.values()}
        written = {image.name: self.pose(image) for image in self.written.images.values()}
        self.assertEqual(sorted(written), sorted(given))
        self.assertEqual(len(written), IMAGES)
        for name, pose in written.items():
            np.testing.assert_allclose(pose, given[name], atol=1e-9, err_msg=name)  # through quaternions in double

    def test_points_lie_where_their_images_see_them(self):
        self.assertGreater(len(self.written.points3D), 500)
        errors = []
        for point in self.written.points3D.values():
            self.assertTrue(point.track.elements)
            for element in point.track.elements:
                image = self.written.images[element.image_id]
                at = self.pose(image) @ np.append(point.xyz, 1)
                self.assertGreater(at[2], 0)
                pixel = self.written.cameras[image.camera_id].calibration_matrix() @ at
                errors.append(np.linalg.norm(pixel[:2] / pixel[2] - image.points2D[element.point2D_idx].xy))
        self.assertLess(max(errors), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
