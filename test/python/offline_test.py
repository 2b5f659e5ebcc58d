#!/usr/bin/python3
"""The Python module acmp_mapping.offline: bits of acmp_reconstruct, inputs as documented, errors, threads and Ctrl-C.

Usage: offline_test.py ACMP_RECONSTRUCT ACMP_MAKE_SCENE, with the module on PYTHONPATH"""

import inspect
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import warnings
from pathlib import Path
from unittest import mock

import numpy as np
from PIL import Image
from acmp_mapping import offline

PROGRAM, MAKE_SCENE = sys.argv[1:3]
IMAGES, WIDTH, HEIGHT = 4, 64, 48
QUICK = {"device": "cpu", "preset": "online"}
PHOTOMETRIC = {"device": "cpu", "preset": "acmh", "source_views": 2,  # quicker
               "options": {"geometric_passes": 0}}
MAPS = ("depth", "normal", "cost", "confidence")


def read_pfm(path):
    with open(path, "rb") as file:
        channels = {b"Pf": 1, b"PF": 3}[file.readline().strip()]
        width, height = map(int, file.readline().split())
        file.readline()
        return np.frombuffer(file.read(), "<f4").reshape(height, width, channels)[::-1].squeeze()


def read_ply(path):
    header, _, body = Path(path).read_bytes().partition(b"end_header\n")
    types = {"float": "<f4", "uchar": "u1"}
    fields = [(name, types[kind]) for kind, name in re.findall(r"property (\w+) (\w+)", header.decode())]
    return np.frombuffer(body, fields)


def columns(cloud, *names):
    return np.stack([cloud[name] for name in names], axis=1)


class OfflineTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.temporary.name)
        cls.scene = str(cls.folder / "scene")
        subprocess.run([MAKE_SCENE, cls.scene, "--width", str(WIDTH), "--height", str(HEIGHT), "--keyframes",
                        str(IMAGES), "--spacing", "0.5"], check=True, stdout=subprocess.DEVNULL)
        cls.input = offline.read_scene(cls.scene)
        cls.result = offline.reconstruct(**cls.input, **QUICK)
        cls.photometric = offline.reconstruct(**cls.input, **PHOTOMETRIC)

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def arguments(self, **changes):
        return {**self.input, **QUICK, **changes}

    def photometric_of(self, **changes):
        return offline.reconstruct(**{**self.input, **PHOTOMETRIC, **changes})

    def assert_same_maps(self, result, expected):
        for image, wanted in zip(result.images, expected.images):
            for kind in MAPS:
                np.testing.assert_array_equal(getattr(image, kind), getattr(wanted, kind), kind)
        np.testing.assert_array_equal(result.cloud.points, expected.cloud.points)

    def assert_is_of_tool(self, result, *options):
        output = self.folder / "tool"
        subprocess.run([PROGRAM, self.scene, str(output), "--device", "cpu", "--preset", "online", "--no-pictures",
                        "--quiet", "--overwrite", *options], check=True)
        self.assertEqual(len(result.images), IMAGES)
        for index, image in enumerate(result.images):
            for kind in MAPS:
                array = getattr(image, kind)
                self.assertEqual(array.dtype, np.float32)
                np.testing.assert_array_equal(array, read_pfm(output / kind / f"{index:06d}.pfm"), kind)
        cloud = read_ply(output / "fused.ply")
        self.assertGreater(len(cloud), 100)
        np.testing.assert_array_equal(result.cloud.points, columns(cloud, "x", "y", "z"))
        np.testing.assert_array_equal(result.cloud.normals, columns(cloud, "nx", "ny", "nz"))
        np.testing.assert_array_equal(result.cloud.colors, columns(cloud, "red", "green", "blue"))
        np.testing.assert_array_equal(result.cloud.confidence, cloud["confidence"])

    def test_bits_of_the_tool_on_both_layouts(self):
        self.assert_is_of_tool(self.result)
        colmap = offline.read_scene(self.scene, format="colmap")
        self.assertEqual(colmap["depth_range"], [None] * IMAGES)  # from the points
        changes = {"max_image_size": 60, "source_views": 2, "seed": 7, "options": {"geometric_passes": 1}}
        self.assert_is_of_tool(offline.reconstruct(**{**colmap, **QUICK, **changes}), "--format", "colmap",
                               "--max-image-size", "60", "--source-views", "2", "--seed", "7", "--set",
                               "geometric_passes=1")

    def test_online_schedule_of_a_model_without_points_takes_the_range_from_matches(self):
        model = self.folder / "without_points"
        shutil.copytree(f"{self.scene}/images", model / "images")
        shutil.copytree(f"{self.scene}/sparse", model / "sparse")
        (model / "sparse/points3D.bin").write_bytes(bytes(8))  # their number
        data = (model / "sparse/images.bin").read_bytes()
        without, at = data[:8], 8
        for _ in range(IMAGES):
            end_of_name = data.index(b"\0", at + 64) + 1  # after id, pose and camera
            without += data[at:end_of_name] + bytes(8)
            at = end_of_name + 8 + 24 * int.from_bytes(data[end_of_name:end_of_name + 8], "little")
        (model / "sparse/images.bin").write_bytes(without)
        run = subprocess.run([PROGRAM, model, self.folder / "of_matches", "--schedule", "online", "--preset", "online",
                              "--device", "cpu", "--no-pictures", "--quiet"], stderr=subprocess.PIPE, text=True, check=False)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("keyframe 1: no sparse points tell its depth range", run.stderr)  # the notice
        self.assertEqual(len(list((self.folder / "of_matches/depth").glob("*.pfm"))), IMAGES - 1)  # all but the first

    def test_prior_depth_is_that_of_the_tool(self):
        folder = self.folder / "prior"
        folder.mkdir()
        prior = [image.depth * 1.3 for image in self.result.images]  # up to a scale
        for name, depth in zip(self.input["names"], prior):
            (folder / name).with_suffix(".pfm").write_bytes(
                b"Pf\n%d %d\n-1\n" % (WIDTH, HEIGHT) + depth[::-1].astype("<f4").tobytes())
        result = offline.reconstruct(**self.arguments(prior_depth=prior))
        self.assert_is_of_tool(result, "--prior-depth", str(folder))
        read = offline.read_scene(self.scene, prior_depth=str(folder))["prior_depth"]
        np.testing.assert_allclose(read[0], prior[0], rtol=1e-6)
        with self.assertRaisesRegex(ValueError, r"prior_depth\[1\]: no pixel"):
            offline.reconstruct(**self.arguments(prior_depth=[None, np.zeros((4, 4)), None, None]))
        with self.assertRaisesRegex(ValueError, "prior_depth=: needs completion"):
            self.photometric_of(prior_depth=prior)

    def test_poses_that_do_not_fit_the_images_are_told_with_what_fits(self):
        scene = str(self.folder / "larger")
        subprocess.run([MAKE_SCENE, scene, "--width", "320", "--height", "240", "--keyframes", "8", "--spacing", "0.5"],
                       check=True, stdout=subprocess.DEVNULL)
        given = {**offline.read_scene(scene), **PHOTOMETRIC, "max_image_size": 64, "ranked_sources": None,
                 "depth_range": (0.5, 9.0)}
        poses = np.array(given.pop("cam_from_world"))
        opengl = np.linalg.inv(poses) @ np.diag([1.0, -1, -1, 1])

        def told(**changes):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    offline.reconstruct(**{**given, "max_image_size": 0, **changes})
                except ValueError as error:
                    return str(error)
            return " ".join(str(warning.message) for warning in caught)
        self.assertNotIn("do not fit", told(cam_from_world=poses))
        self.assertIn("inverted", told(world_from_cam=poses))
        self.assertIn("OpenGL", told(world_from_cam=opengl))

    def test_what_comes_out(self):
        image = self.result.images[0]
        self.assertEqual((image.name, image.no_map), ("000000.png", ""))
        self.assertEqual(image.depth.shape, (HEIGHT, WIDTH))
        self.assertEqual(image.normal.shape, (HEIGHT, WIDTH, 3))
        self.assertTrue(np.isfinite(image.depth).all())
        np.testing.assert_array_equal(image.K, self.input["K"][0])
        np.testing.assert_array_equal(image.cam_from_world, self.input["cam_from_world"][0])
        self.assertEqual(sorted(image.source_views), [1, 2, 3])
        self.assertIn("cpu", self.result.device)

    def test_images_of_any_order_strides_and_channels(self):
        images = self.input["images"]
        bgr = [image[..., ::-1] for image in images]
        self.assert_same_maps(self.photometric_of(images=bgr, color_order="bgr"), self.photometric)
        padded = np.zeros((IMAGES, HEIGHT + 3, 2 * WIDTH, 3), np.uint8)
        padded[:, 1:HEIGHT + 1, ::2] = images
        views = padded[:, 1:HEIGHT + 1, ::2]
        self.assertFalse(views[0].flags.c_contiguous)
        self.assert_same_maps(self.photometric_of(images=views), self.photometric)
        fortran = [np.asfortranarray(image) for image in images]
        three_rows = self.input["cam_from_world"][:, :3]
        self.assert_same_maps(self.photometric_of(images=fortran, cam_from_world=three_rows), self.photometric)
        gray = [image[..., 1] for image in images]
        of_gray = self.photometric_of(images=gray)
        same = [np.repeat(image[..., None], 3, axis=2) for image in gray]
        self.assert_same_maps(self.photometric_of(images=same), of_gray)
        self.assertTrue((of_gray.cloud.colors == of_gray.cloud.colors[:, :1]).all())

    def test_inverse_poses_one_camera_one_range_and_all_points(self):
        shared = self.arguments(K=self.input["K"][0], cam_from_world=None, depth_range=None, ranked_sources=None,
                                world_from_cam=np.linalg.inv(self.input["cam_from_world"]),
                                points=np.concatenate(self.input["points"]))
        for result in (offline.reconstruct(**shared), offline.reconstruct(**{**shared, "depth_range": (0.5, 20)})):
            truth = self.truth(0)
            self.assertGreater(offline.evaluate_depth(result.images[0].depth, truth)["below_relative"][0.05], 50)
        with self.assertWarnsRegex(UserWarning, "became"):  # hardly any pixel
            narrow = offline.reconstruct(**{**shared, **PHOTOMETRIC, "depth_range": (9, 10)})
        self.assertLess(offline.evaluate_depth(narrow.images[0].depth, truth)["below_relative"][0.05], 20)

    def test_other_threads_go_on_while_points_of_all_images_are_sorted_out(self):
        count, turns, ended = 15, [0], threading.Event()

        def work():
            while not ended.is_set():
                turns[0] += 1
                time.sleep(0)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            before = []
            K = np.repeat(self.input["K"][:1], count, axis=0)
            K[-1, 0, 1] = 1  # refused at the last image, so that nothing else gives other threads a turn
            arguments = {"images": [self.input["images"][0]] * count, "K": K, "points": np.zeros((300_000, 3)),
                         "cam_from_world": np.repeat(self.input["cam_from_world"][:1], count, axis=0), "device": "cpu"}
            call = offline._offline.reconstruct  # pylint: disable=protected-access
            with mock.patch.object(offline._offline, "reconstruct", lambda *a: (before.append(turns[0]), call(*a))):  # pylint: disable=protected-access
                with self.assertRaisesRegex(ValueError, r"K\[14\]"):
                    offline.reconstruct(**arguments)
            self.assertGreater(turns[0], before[0] + 1)
        finally:
            ended.set()
            thread.join()

    def truth(self, index):
        return np.asarray(Image.open(Path(self.scene) / "depth" / f"{index:06d}.png")).astype(float) / 1000

    def test_masks_and_images_without_source_views(self):
        masks = [np.ones((HEIGHT, WIDTH), bool), None, np.full((HEIGHT, WIDTH), 255, np.uint8), None]
        masks[0][5:15, 10:30] = False
        poses = self.input["cam_from_world"].copy()
        poses[3] = np.diag([-1, 1, -1, 1]) @ poses[3]  # looks the other way
        result = self.photometric_of(masks=masks, cam_from_world=poses, ranked_sources=None)
        self.assertTrue((result.images[0].depth[5:15, 10:30] == 0).all())
        self.assertGreater((result.images[0].depth > 0).mean(), 0.5)
        self.assertIsNone(result.images[3].depth)
        self.assertIn("0 useful source views for depths of", result.images[3].no_map)
        (self.folder / "masks").mkdir()
        mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
        mask[:20] = 0
        Image.fromarray(mask).save(self.folder / "masks" / "000002.png.png")
        masks = offline.read_scene(self.scene, masks=str(self.folder / "masks"))["masks"]
        np.testing.assert_array_equal(masks[2] > 0, mask > 0)
        self.assertEqual([mask is None for mask in masks], [True, True, False, True])

    def test_bad_input_is_named(self):
        images, k, poses = self.input["images"], self.input["K"], self.input["cam_from_world"]

        def changed(array, index, value):
            array = array.copy()
            array[index] = value
            return array

        for words, changes in (
                ("images: there are none", {"images": []}),
                ("images[1]: dtype float64: must be uint8", {"images": [images[0], images[1] / 255.0, *images[2:]]}),
                ("images[0]: shape (48, 64, 4): must be (height, width) or (height, width, 3)",
                 {"images": [np.zeros((48, 64, 4), np.uint8), *images[1:]]}),
                ("K: shape (4, 4): must be (3, 3), or (4, 3, 3) for 4 images", {"K": np.eye(4)}),
                ("K: dtype complex128: must be real numbers", {"K": 1j * k}),
                ("K[0] = [", {"K": changed(k, (0, 0, 1), 0.1)}),
                ("cam_from_world: shape (3, 4, 4): must be (4, 4, 4) or (4, 3, 4) for 4 images", {"cam_from_world": poses[:3]}),
                ("cam_from_world[1]: the rotation is off orthonormal by",
                 {"cam_from_world": changed(poses, 1, 2 * poses[1] - np.diag([0, 0, 0, 1]))}),
                ("cam_from_world[3]: last row 0 0 0 2: must be 0 0 0 1",
                 {"cam_from_world": changed(poses, (3, 3, 3), 2)}),
                ("give either cam_from_world or world_from_cam", {"cam_from_world": None}),
                ("depth_range", {"depth_range": (5, 4)}),
                ("depth_range: has 3 elements: must be one for each of 4 images", {"depth_range": (1, 2, 3)}),
                ("give a depth range (depth_range=, or points=)", {"depth_range": None, "points": None}),
                ("points[0]: shape (5, 2): must be (M, 3)", {"points": [np.zeros((5, 2))] * 4}),
                ("image 000000.png: frame 0: mask size 5 x 6: must be the image's, 64 x 48",
                 {"masks": [np.ones((6, 5), bool), None, None, None]}),
                ("masks[0]: dtype float64: must be bool or uint8", {"masks": [np.ones((48, 64))] * 4}),
                ("image 000001.png: source view = 4: must be in [0, 3]", {"ranked_sources": [[1], [4], [], []]}),
                ("geometric_passes", {"options": {"geometric_pass": 1}})):
            with self.subTest(words=words):
                with self.assertRaises(ValueError) as raised:
                    offline.reconstruct(**self.arguments(**changes))
                self.assertIn(words, str(raised.exception))
        with self.assertRaisesRegex(ValueError, "no_such_folder"):
            offline.read_scene("/no_such_folder")

    def test_signatures_say_what_the_documentation_does(self):
        for name in offline.__all__:
            public = getattr(offline, name)
            self.assertTrue(public.__doc__, name)
            parameters = inspect.signature(public).parameters  # what editors show: there are no stubs beside it
            self.assertLessEqual(set(parameters), set(public.__annotations__), name)
            text = inspect.getdoc(public)  # without the indentation that Python 3.13 takes away anyway
            section = re.search(r"^(?:Args|Attributes):\n(.*?)(?:\n\n|\Z)", text, re.DOTALL | re.MULTILINE)
            documented = re.findall(r"^ {2}(\w+):", section.group(1), re.MULTILINE)
            self.assertEqual(documented, list(parameters), name)
        self.assertLessEqual(set(self.input), set(inspect.signature(offline.reconstruct).parameters))

    def slow(self):
        """Arguments of a run that takes many seconds."""
        factor = 8
        images = [image.repeat(factor, 0).repeat(factor, 1) for image in self.input["images"]]
        k = self.input["K"] * factor
        k[:, 2, 2] = 1
        return self.arguments(images=images, K=k, preset="balanced")

    def test_threads_run_side_by_side_and_control_c_ends_a_run(self):
        begun = time.process_time()
        self.photometric_of()
        small = time.process_time() - begun
        sent = []

        def interrupt():
            for _ in range(100):  # comes to its end before the run's only where other threads run beside it
                time.sleep(0.005)
            sent.append(time.process_time())
            os.kill(os.getpid(), signal.SIGINT)

        thread = threading.Thread(target=interrupt)
        thread.start()
        with self.assertRaises(KeyboardInterrupt):
            offline.reconstruct(**self.slow())
        thread.join()
        after = time.process_time() - sent[0]
        print(f"stopped {after:.2f} s of processor time after the signal; the small run takes {small:.2f} s")
        # The whole run has 64 times the pixels of the small one and more steps.
        self.assertLess(after, 16 * small)
        results = [None, None]

        def run(place):
            results[place] = self.photometric_of()

        threads = [threading.Thread(target=run, args=(place,)) for place in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for result in results:
            self.assert_same_maps(result, self.photometric)

    def test_evaluation(self):
        truth = np.array([[2.0, 2.0, 0.0], [4.0, np.nan, 4.0]])
        depth = np.array([[2.01, np.nan, 1.0], [4.15, 1.0, 0.0]], np.float32)
        found = offline.evaluate_depth(depth, truth)
        self.assertEqual((found["pixels"], found["density"]), (4, 50))
        self.assertEqual(found["below_absolute"], {0.02: 25, 0.05: 25, 0.1: 25})
        self.assertEqual(found["below_relative"], {0.01: 25, 0.02: 25, 0.05: 50})
        self.assertEqual(offline.evaluate_depth(depth, truth, mask=truth == 2)["pixels"], 2)
        with self.assertRaisesRegex(ValueError, r"depth: shape \(6,\)"):
            offline.evaluate_depth(depth.ravel(), truth)
        points = np.random.default_rng(1).uniform(0, 1, (200, 3))
        for place in ([0, 0, 0], [-4.2e6, 6e5, 4.7e6]):  # geocentric: float32 knows half metres there
            near, far = offline.evaluate_cloud(points + place + [0.03, 0, 0], points + place, thresholds=[0.01, 0.04])
            self.assertEqual(far, {"threshold": 0.04, "accuracy": 100, "completeness": 100, "f1": 100})
            self.assertLess(near["f1"], 20)
        with self.assertRaisesRegex(ValueError, "voxel"):
            offline.evaluate_cloud(points, points, voxel_size=0)
        with self.assertRaisesRegex(ValueError, r"truth: shape \(200, 2\)"):
            offline.evaluate_cloud(points, points[:, :2])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
