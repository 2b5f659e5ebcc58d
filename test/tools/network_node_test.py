#!/usr/bin/python3
"""scripts/network_node.py: descriptions, what goes into a network and what is made of its output, and the node with a
network and ROS that are played. With --onnx networks that ONNX Runtime runs; exit code 77 where that is missing.

usage: network_node_test.py SOURCE_FOLDER [--onnx]"""
import contextlib
import io
import os
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import types
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
import PIL.Image
import yaml

SOURCE = Path(sys.argv.pop(1)).absolute()
WITH_ONNX = "--onnx" in sys.argv
sys.path.insert(0, str(SOURCE / "scripts"))
import network_node as node  # noqa: E402
import tiny_onnx  # noqa: E402

WIDTH, HEIGHT = 48, 32
try:
    from acmp_mapping import _offline as _  # noqa: F401
    decodes = lambda test: test  # noqa: E731
except ImportError as error:
    decodes = unittest.skip(f"needs the Python module: {error}")


def test_image():
    """Brightness grows to the right and, less, downwards; colours differ; height x width x 3."""
    ramp = np.add.outer(np.arange(HEIGHT), 3 * np.arange(WIDTH))
    return np.stack([60 + ramp, 40 + ramp, 20 + ramp], 2).astype(np.uint8)


class TestCase(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def describe(self, **changes):
        """A description with these values; None: without the key."""
        content = {"file": "tiny.onnx", "kind": "inverse_depth", "size": [WIDTH, HEIGHT], **changes}
        path = self.folder / "tiny.yaml"
        path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value is not None}))
        return node.Description(str(path))


class Descriptions(TestCase):
    def test_shipped_ones_can_be_read_and_say_where_the_network_is_and_its_licence(self):
        paths = list((SOURCE / "config/networks").glob("*.yaml"))
        self.assertGreaterEqual(len(paths), 8)
        for path in paths:
            with self.subTest(path):
                description = node.Description(path)
                self.assertTrue(description.source and description.licence)
                self.assertIn(Path.home() / ".ros/acmp_mapping/networks", description.file.parents)

    def test_the_file_is_beside_the_description(self):
        self.assertEqual(self.describe().file, self.folder / "tiny.onnx")
        self.assertEqual(self.describe(file="/other/tiny.onnx").file, Path("/other/tiny.onnx"))

    def test_a_name_alone_is_one_of_those_that_are_shipped(self):
        for name in "midas_small.yaml", "midas_small":
            self.assertEqual(node.Description(name).kind, "inverse_depth")
        for name in "midas_smal.yaml", "/opt/config/networks/midas_smal.yaml":
            with self.assertRaisesRegex(node.Refused, r"midas_small\.yaml\?.*sky_u2net\.yaml"):
                node.Description(name)

    def test_bad_values_are_named(self):
        bad = [(dict(file=None), "file: missing"), (dict(kind="disparity"), "'disparity': must be one of depth, inverse_depth"),
               (dict(longer_sid=320), "longer_sid: is not known: longer_side\\?"), (dict(qwzx=1), "qwzx: .*; known are file"),
               (dict(mean=[1, 2]), "mean: \\[1, 2\\]: must be 3 numbers"), (dict(std=[1, 0, 1]), "std: .*between 1e-09"),
               (dict(pixel_max=0), "pixel_max: 0: must be between"), (dict(pixel_max="1"), "pixel_max: '1': must be a number"),
               (dict(longer_side=320), "size: must be there, or"), (dict(size=[320, 240.0]), "size: .* whole numbers"),
               (dict(multiple_of=14), "multiple_of: is for longer_side"), (dict(kind="probability"), "threshold: must be there"),
               (dict(threshold=0.5), "threshold: .*only then"), (dict(kind="classes", ignore=[]), "ignore: \\[\\]"),
               (dict(grow=3), "grow: is for masks"), (dict(kind="classes", labels=[1, 256]), "labels: .*between 0 and 255"),
               (dict(labels=[1]), "labels: .*only then"), (dict(kind="classes", labels=[1], ignore=[0]), "beside ignore"),
               (dict(kind="classes", labels=[1], grow=3), "grow: is for masks")]
        for changes, words in bad:
            with self.subTest(changes), self.assertRaisesRegex(node.Refused, "tiny.yaml: .*" + words):
                self.describe(**changes)
        bomb = b"a: &a [x,x]\n" + b"".join(b"%c: &%c [*%c,*%c]\n" % (98 + i, 98 + i, 97 + i, 97 + i) for i in range(20))
        for text in (b"- 1", b"", b"a: [", b"\xe9", bomb, b"[" * 100000, b"grow: " + b"9" * 100000):
            path = self.folder / "bad.yaml"
            path.write_bytes(text)
            with self.subTest(text), self.assertRaisesRegex(node.Refused, "bad.yaml: "):
                node.Description(str(path))
        os.mkfifo(self.folder / "pipe.yaml")
        for path in (self.folder / "pipe.yaml", "/dev/zero"):
            with self.assertRaisesRegex(node.Refused, "pipe or a device"):
                node.Description(str(path))
        with self.assertRaisesRegex(node.Refused, "no such file"):
            node.Description(str(self.folder / "none.yaml"))

    def test_the_input_keeps_the_images_shape_where_its_size_is_free(self):
        self.assertEqual(self.describe(size=[320, 192]).input_size(640, 480), (320, 192))
        free = self.describe(size=None, longer_side=518, multiple_of=14)
        self.assertEqual(free.input_size(640, 480), (518, 392))  # 388.5 is nearer to 28 than to 27 times 14
        self.assertEqual(free.input_size(480, 640), (392, 518))
        self.assertEqual(free.input_size(4000, 20), (518, 14))


class Arrays(TestCase):
    def test_pixels_are_scaled_and_ordered(self):
        image = test_image()
        description = self.describe(mean=[0.5, 0.25, 0], std=[0.5, 1, 2])
        prepared = node.prepare(description, image, (WIDTH, HEIGHT))
        self.assertEqual((prepared.shape, prepared.dtype), ((3, HEIGHT, WIDTH), np.float32))
        expected = (image[7, 5] / 255 - [0.5, 0.25, 0]) / [0.5, 1, 2]
        np.testing.assert_allclose(prepared[:, 7, 5], expected, atol=1e-6)  # rounding of float32
        reversed_ = node.prepare(self.describe(color_order="bgr", pixel_max=255), image, (WIDTH, HEIGHT))
        np.testing.assert_allclose(reversed_[:, 7, 5], image[7, 5, ::-1], atol=1e-4)

    def test_the_whole_image_is_resized(self):
        prepared = node.prepare(self.describe(pixel_max=255), test_image(), (24, 8))
        self.assertEqual(prepared.shape, (3, 8, 24))
        # The ramp stays one: column c of 24 covers 2c and 2c + 1 of 48, row 3 of 8 rows 12 to 15. The rims lack what lies
        # beyond them; rounding.
        np.testing.assert_allclose(prepared[0, 3, 1:-1], 60 + 13.5 + 3 * (2 * np.arange(24) + 0.5)[1:-1], atol=1)

    def test_inverse_depth_is_known_up_to_scale_and_shift(self):
        output = np.linspace(-3, 5, 12).reshape(3, 4)
        depth = node.to_depth(self.describe(), output)
        self.assertEqual(depth.dtype, np.float32)
        self.assertTrue((depth > 0).all())
        scale, shift = np.polyfit(output.ravel(), 1 / depth.ravel(), 1)
        self.assertGreater(scale, 0)
        np.testing.assert_allclose(1 / depth, scale * output + shift, rtol=1e-5)  # rounding of float32
        output[1, 2] = np.nan
        again = node.to_depth(self.describe(), output)
        self.assertEqual(again[1, 2], 0)
        np.testing.assert_array_equal(again[0], depth[0])

    def test_depth_stays(self):
        output = np.array([[1.5, 2.0], [-1, np.inf]])
        np.testing.assert_array_equal(node.to_depth(self.describe(kind="depth"), output), [[1.5, 2], [0, 0]])

    def test_useless_depth_is_refused(self):
        for kind, output, words in (("inverse_depth", np.full((2, 3), 0.25), "the same everywhere: 0.25"),
                                    ("depth", np.full((2, 3), 7.0), "the same everywhere: 7"),
                                    ("inverse_depth", np.full((2, 3), np.nan), "none of the network's 6 values is finite"),
                                    ("depth", np.full((2, 3), -1.0), "none of .* is positive and finite")):
            with self.subTest(kind=kind, words=words), self.assertRaisesRegex(node.Refused, words):
                node.to_depth(self.describe(kind=kind), output)

    def probability_mask(self, output, size, **changes):
        return node.to_mask(self.describe(kind="probability", threshold=0.5, **changes), output, size)

    def test_probability_becomes_a_mask_of_the_images_size(self):
        probability = np.zeros((4, 6))
        self.assertTrue((self.probability_mask(probability, (12, 8)) == 255).all())
        probability[:, 4:] = 0.8
        mask = self.probability_mask(probability, (60, 40))
        self.assertEqual((mask.shape, mask.dtype), ((40, 60), np.uint8))
        self.assertEqual(set(np.unique(mask)), {0, 255})
        # Between the centres of columns 3 and 4, px 35 and 45, it grows from 0 to 0.8: 0.5 is 6.25 px on.
        np.testing.assert_array_equal((mask == 0).sum(1), 60 - 41)
        grown = self.probability_mask(probability, (60, 40), grow=3)
        np.testing.assert_array_equal((grown == 0).sum(1), 60 - 41 + 3)
        with self.assertRaisesRegex(node.Refused, "1 of the network's 4 values are not finite"):
            self.probability_mask(np.array([[0, 1], [np.nan, 0]]), (12, 8))

    def test_what_is_ignored_grows_on_all_sides(self):
        ignored = np.zeros((9, 12), bool)
        ignored[[4, 8], [5, 0]] = True
        expected = np.zeros((9, 12), bool)
        expected[2:7, 3:8] = expected[6:, :3] = True
        np.testing.assert_array_equal(node.grown(ignored, 2), expected)
        np.testing.assert_array_equal(node.grown(ignored, 0), ignored)
        self.assertTrue(node.grown(ignored, 50).all())

    def test_classes_become_a_mask(self):
        description = self.describe(kind="classes", ignore=[2, 7])
        numbers = np.array([[0, 2], [7, 1]])
        expected = np.array([[255, 0], [0, 255]]).repeat(3, 0).repeat(5, 1)
        np.testing.assert_array_equal(node.to_mask(description, numbers, (10, 6)), expected)
        scores = (np.arange(8)[:, None, None] == numbers) * 1.0
        np.testing.assert_array_equal(node.to_mask(description, scores, (10, 6)), expected)

    def test_classes_become_labels(self):
        description = self.describe(kind="classes", labels=[9, 0, 7, 250])
        self.assertEqual((description.topic, self.describe(kind="classes", ignore=[1]).topic), ("labels", "mask"))
        numbers = np.array([[0, 1], [2, 3]])
        expected = np.array([[9, 0], [7, 250]]).repeat(3, 0).repeat(5, 1)
        for output in (numbers, numbers.astype(np.float32), (np.arange(4)[:, None, None] == numbers) * 1.0):
            labels = node.to_mask(description, output, (10, 6))
            np.testing.assert_array_equal(labels, expected)
            self.assertEqual(labels.dtype, np.uint8)
        with self.assertRaisesRegex(node.Refused, "classes from 0 to 4: labels has 4"):
            node.to_mask(description, numbers + [[0, 0], [0, 1]], (10, 6))


def message(encoding, array):
    """A sensor_msgs/Image of rows of bytes."""
    rows = array.reshape(array.shape[0], -1)
    return types.SimpleNamespace(encoding=encoding, height=HEIGHT, width=WIDTH, step=rows.shape[1], data=rows.tobytes(),
                                 is_bigendian=False, header=types.SimpleNamespace(stamp="1.5"))


class Images(TestCase):
    @decodes
    def test_raw_images_are_those_of_the_mapper(self):  # whose test has the other encodings
        image, decoder = test_image(), node.decoders().RawImageDecoder()
        for encoding, array in (("rgb8", image), ("bgr8", image[:, :, ::-1]), ("8UC3", image[:, :, ::-1])):
            np.testing.assert_array_equal(node.raw_decoded(decoder, message(encoding, array)), image)
        wide = image[:, :, :1].astype("<u2") << 4
        wide[0, 0] = 0xFFF
        grey = node.raw_decoded(decoder, message("mono16", wide.view(np.uint8)))
        np.testing.assert_array_equal(grey[1:], image[1:, :, :1].repeat(3, 2))
        with self.assertRaisesRegex(ValueError, '"32FC1".* is it a depth map'):
            node.raw_decoded(decoder, message("32FC1", image))

    @decodes
    def test_pictures(self):
        for kind in ("PNG", "JPEG"):
            data = io.BytesIO()
            PIL.Image.fromarray(test_image()).save(data, kind, **({"quality": 95} if kind == "JPEG" else {}))
            # 8: what JPEG of this quality may change
            self.assertLessEqual(np.abs(node.decoded(data.getvalue()).astype(int) - test_image()).max(), 8, kind)
            with self.assertRaisesRegex(node.Refused, "picture of 60 bytes"):
                node.decoded(data.getvalue()[:60])
            with self.assertRaisesRegex(node.Refused, f"{WIDTH} x {HEIGHT} px: must be 64 x 48"):
                node.decoded(data.getvalue(), (64, 48))
            with self.assertRaisesRegex(node.Refused, f"{WIDTH} x {HEIGHT} px: at most 100"):
                node.decoded(data.getvalue(), None, 100)
        wide = io.BytesIO()
        PIL.Image.fromarray(test_image()[:, :, 0].astype(np.uint16) * 256).save(wide, "PNG")
        # 1: libpng scales 16 bits to 8
        np.testing.assert_allclose(node.decoded(wide.getvalue())[:, :, 1].astype(int), test_image()[:, :, 0], atol=1)

    @decodes
    def test_what_is_no_jpeg_or_png_is_handed_to_nobody(self):
        marker = self.folder / "gs"  # PIL starts a program of this name on PostScript
        marker.write_text(f"#!/bin/sh\ntouch {self.folder}/started\n")
        marker.chmod(0o755)
        pictures = [b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 20 20\n%%EndComments\nshowpage\n%%EOF\n"]
        for kind in ("TIFF", "GIF", "BMP", "PPM"):
            data = io.BytesIO()
            PIL.Image.fromarray(test_image()).save(data, kind)
            pictures.append(data.getvalue())
        with mock.patch.dict(os.environ, PATH=f"{self.folder}:{os.environ['PATH']}"):
            for picture in pictures:
                with self.subTest(picture[:20]), self.assertRaisesRegex(node.Refused, "neither a PNG nor a JPEG"):
                    node.decoded(picture)
        self.assertFalse((self.folder / "started").exists())


class FakeRos:
    """What the node uses of ROS; published messages are in `published` by topic."""

    def __init__(self, mapper, **remaps):
        self.published, self.over, self.warnings = {}, threading.Event(), []
        self.rospy = types.SimpleNamespace(
            get_param=lambda name, default: {"dense_mapper": mapper}.get(name, default), get_name=lambda: "/acmp/depth_network",
            is_shutdown=self.over.is_set, Publisher=self.publisher, logwarn_throttle=lambda _, text: self.warnings.append(text),
            Subscriber=lambda topic, kind, callback, **_: types.SimpleNamespace(
                resolved_name=self.rospy.resolve_name(topic), kind=kind, callback=callback),
            get_namespace=lambda: "/acmp/",
            resolve_name=lambda name: name if name[0] == "/" else remaps.get(name, "/acmp/" + name),
            Time=types.SimpleNamespace(now=lambda: 0))
        self.Image = self.CompressedImage = self.CameraInfo = self.DiagnosticArray = self.Header = types.SimpleNamespace
        self.DiagnosticStatus = mock.Mock(OK=0, WARN=1, ERROR=2, side_effect=lambda **values: types.SimpleNamespace(**values))
        self.KeyValue = lambda key, value: (key, value)

    def publisher(self, topic, _, **__):
        self.published[topic] = []
        return types.SimpleNamespace(publish=self.published[topic].append, resolved_name="/" + topic)


class FakeNetwork:
    """Depth that is the red of the image, once `go` is set. Refuses images without any."""

    def __init__(self, description):
        self.description, self.device, self.go, self.begun = description, "CPU", threading.Event(), threading.Event()

    def run(self, rgb):
        self.begun.set()
        self.go.wait()
        if (rgb == 1).all():
            raise SystemExit(0)
        if not rgb.any():
            raise node.Refused("the network's output is the same everywhere: 0")
        return np.asfortranarray(rgb[:, :, 0], np.float32)  # as arrays may lie in memory


@decodes
class Nodes(TestCase):
    def play(self, mapper, count, image=test_image()):
        """Sends images while the network is busy with the first; waits until all are accounted for."""
        ros, network = FakeRos(mapper), FakeNetwork(self.describe())
        played = node.Node(network, ros)
        thread = threading.Thread(target=played.run)
        thread.start()
        try:
            for number in range(count):
                sent = message("rgb8", image)
                sent.header = types.SimpleNamespace(stamp=number, frame_id="camera")
                played.receive(sent)
                self.assertTrue(network.begun.wait(60))
            network.go.set()
            for _ in range(600):
                accounted = sum(played.counts[name] for name in ("published", "skipped", "refused"))
                if accounted == count:
                    break
                threading.Event().wait(0.1)
            self.assertEqual(accounted, count)
        finally:
            network.go.set()
            ros.over.set()
            thread.join()
        return played, ros

    def test_the_newest_wins(self):
        played, ros = self.play({"overload": "drop", "image_transport": "raw"}, 5)
        depths = ros.published["prior_depth"]
        self.assertEqual([depth.header.stamp for depth in depths], [0, 4])
        depth = depths[1]
        self.assertEqual((depth.encoding, depth.width, depth.height, depth.step, depth.header.frame_id),
                         ("32FC1", WIDTH, HEIGHT, 4 * WIDTH, "camera"))
        np.testing.assert_array_equal(np.frombuffer(depth.data, np.float32).reshape(HEIGHT, WIDTH),
                                      test_image()[:, :, 0])
        status = played.diagnosis()
        self.assertEqual((status.level, status.name), (1, "acmp/depth_network: network"))
        self.assertIn("skipped 3 of the last 5 images", status.message)
        self.assertIn(("skipped, too slow", "3"), status.values)
        self.assertEqual((played.diagnosis().level, played.diagnosis().message), (0, "waits for images"))

    def test_a_recording_loses_nothing(self):
        played, ros = self.play({"overload": "block"}, 5)
        self.assertEqual([depth.header.stamp for depth in ros.published["prior_depth"]], list(range(5)))
        self.assertEqual((played.diagnosis().level, played.told["skipped"]), (0, 0))

    def test_a_recording_waits_within_bounds(self):
        with mock.patch.object(node, "WAITING_BYTES", 3 * test_image().size):
            played, ros = self.play({"overload": "block"}, 6)
        self.assertEqual([depth.header.stamp for depth in ros.published["prior_depth"]], [0, 3, 4, 5])
        self.assertRegex(played.diagnosis().message, "skipped 2 of the last 6 images.*rosbag play")

    def test_a_network_that_gives_up_does_not_end_the_node(self):
        played, ros = self.play({}, 1, np.ones((HEIGHT, WIDTH, 3), np.uint8))
        self.assertEqual(played.counts["refused"], 1)
        self.assertIn("SystemExit", played.problem)

    def test_pictures_have_the_size_of_their_camera(self):
        ros = FakeRos({"image_transport": "compressed"})
        played = node.Node(FakeNetwork(self.describe()), ros)
        data = io.BytesIO()
        PIL.Image.fromarray(test_image()).save(data, "PNG")
        picture = types.SimpleNamespace(format="png", data=data.getvalue())
        with mock.patch.object(node, "UNTOLD_PIXELS", 100), self.assertRaisesRegex(node.Refused, "no camera_info has come"):
            played.decode(picture)
        info = types.SimpleNamespace(width=2 * WIDTH, height=2 * HEIGHT, binning_x=2, binning_y=2,
                                     roi=types.SimpleNamespace(width=0, height=0))
        played.receive_info(info)
        np.testing.assert_array_equal(played.decode(picture), test_image())
        info.binning_x = 1
        played.receive_info(info)
        with self.assertRaisesRegex(node.Refused, "must be 96 x 32"):
            played.decode(picture)

    def test_it_ends_though_the_network_hangs(self):
        program = textwrap.dedent(f"""
            import sys, types
            sys.argv = ["network_node_test.py", {str(SOURCE)!r}]
            sys.path[:0] = [{str(Path(__file__).parent)!r}, {str(SOURCE / "scripts")!r}]
            import network_node_test as test
            node, ros = test.node, test.FakeRos({{}})
            ros.rospy.init_node = ros.rospy.loginfo = ros.rospy.logerr = lambda *_: None
            ros.rospy.Subscriber = lambda topic, kind, callback, **_: callback(test.message("rgb8", test.test_image()))
            node.import_ros = lambda: ros
            def hang(_):
                import ctypes
                print("hangs", flush=True)
                ctypes.PyDLL(None).pause()  # with the interpreter's lock
            node.Description = lambda path: types.SimpleNamespace(path=path, is_depth=True, topic="prior_depth")
            node.Network = lambda *_: types.SimpleNamespace(description=node.Description("x"), device="CPU", run=hang)
            sys.argv = ["network_node.py", "x"]
            node.main()
            """)
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
            self.addCleanup(process.kill)
            self.assertEqual(process.stdout.readline(), "hangs\n")
            process.send_signal(signal.SIGTERM)
            self.assertEqual(process.wait(60), -signal.SIGTERM)

    def test_what_is_refused_is_told(self):
        played, ros = self.play({}, 1, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        self.assertEqual(ros.published["prior_depth"], [])
        status = played.diagnosis()
        self.assertEqual((status.level, status.message), (2, "image 0: the network's output is the same everywhere: 0"))
        self.assertEqual(ros.warnings, [status.message])

    def test_it_takes_what_the_mapper_takes(self):
        for transport, remaps, topic in (("raw", {"image": "/cam0"}, "/cam0"),
                                         ("compressed", {"image": "/cam0"}, "/cam0/compressed"),
                                         ("compressed", {"image": "/cam0/compressed"}, "/cam0/compressed"),
                                         ("compressed", {"image": "/cam0", "image/compressed": "/jpeg"}, "/jpeg")):
            ros = FakeRos({"image_transport": transport}, **remaps)
            self.assertEqual(node.Node(FakeNetwork(self.describe()), ros).subscriber.resolved_name, topic)
        ros = FakeRos({})
        played = node.Node(FakeNetwork(self.describe(kind="probability", threshold=0.5)), ros)
        self.assertIn("mask", ros.published)
        self.assertEqual(played.diagnosis().message, "no image yet on /acmp/image")


def run_main(*arguments):
    """Exit code and what was printed."""
    out = io.StringIO()
    with mock.patch.object(sys, "argv", ["network_node.py", *arguments]), contextlib.redirect_stdout(out), \
            contextlib.redirect_stderr(out):
        return node.main(), out.getvalue()


class WithoutOnnxRuntime(TestCase):
    def test_it_says_what_to_install(self):
        description = self.describe()
        with mock.patch.dict(sys.modules, {"onnxruntime": None}):
            code, text = run_main(description.path, "--images", str(self.folder), str(self.folder))
        self.assertEqual(code, 2)
        self.assertIn("ONNX Runtime is missing (pip install onnxruntime", text)


class OnnxNetworks(TestCase):
    def load(self, model=None, **changes):
        if model is not None:
            (self.folder / "tiny.onnx").write_bytes(model)
        return node.Network(self.describe(**changes), 1)

    def test_axes_and_types_of_the_input(self):
        inputs = [("planes first", (1, 3, "height", "width"), 1), ("of fixed size", (1, 3, HEIGHT, WIDTH), 1),
                  ("colours last", (1, HEIGHT, WIDTH, 3), 3), ("of some images", ("batch", "images", 3, "height", "width"), 2)]
        expected = test_image().mean(2)
        for name, shape, axis in inputs:
            for element in (tiny_onnx.FLOAT, tiny_onnx.FLOAT16):
                network = self.load(tiny_onnx.brightness(shape, axis, element), kind="depth", pixel_max=255)
                with self.subTest(name, element=element):
                    # 0.13: half of a unit in the last place of float16 at 255, and as much of the sum's
                    np.testing.assert_allclose(network.run(test_image()), expected, atol=0.13)

    def test_scores_of_classes(self):
        scores = tiny_onnx.model([tiny_onnx.node("Neg", ["image"], "scores")], [tiny_onnx.tensor("image", (1, 3, "h", "w"))],
                                 [tiny_onnx.tensor("scores", (1, 3, "h", "w"))])
        self.assertTrue((self.load(scores, kind="classes", ignore=[2]).run(test_image()) == 0).all(), "blue is least")
        self.assertTrue((self.load(scores, kind="classes", ignore=[0, 1]).run(test_image()) == 255).all())

    def test_networks_that_are_not_as_described(self):
        two = tiny_onnx.model([tiny_onnx.node("Add", ["image", "state"], "out")],
                              [tiny_onnx.tensor(name, (1, 3, "h", "w")) for name in ("image", "state")],
                              [tiny_onnx.tensor("out", (1, 3, "h", "w"))])
        colors = tiny_onnx.model([tiny_onnx.node("Neg", ["image"], "out")], [tiny_onnx.tensor("image", (1, 3, "h", "w"))],
                                 [tiny_onnx.tensor("out", (1, 3, "h", "w"))])
        bright = tiny_onnx.brightness()
        bad = [(b"no network", {}, "tiny.onnx: ONNX Runtime cannot read it"), (bright[:-20], {}, "ONNX Runtime cannot read"),
               (two, {}, "has 2 inputs \\(image, state\\): must have one"),
               (bright, dict(input="pixels"), "input: the network has no pixels, but image"),
               (bright, dict(output="depth"), "output: the network has no depth, but bright"),
               (tiny_onnx.brightness((1, 3, 64, 96)), {}, "input image is \\[1, 3, 64, 96\\]: .* makes \\[1, 3, 32, 48\\]"),
               (tiny_onnx.brightness((1, 1, "h", "w")), {}, "makes \\[1, 3, 32, 48\\]"),
               (tiny_onnx.brightness(element=7), {}, "input image is a tensor\\(int64\\): must be one of"),
               (colors, {}, "output out is \\[1, 3, 32, 48\\]: kind inverse_depth needs one value for each pixel"),
               (tiny_onnx.brightness(axis=3), {}, "output bright is \\[1, 3, 32, 1\\]")]
        for model, changes, words in bad:
            with self.subTest(words), self.assertRaisesRegex(node.Refused, words):
                self.load(model, **changes)

    def test_a_missing_file_and_where_to_get_it(self):
        with self.assertRaisesRegex(node.Refused, "tiny.onnx is missing; get it from the moon"):
            self.load(source="the moon")

    @decodes
    def test_a_folder(self):
        images, out, path = (str(self.folder / name) for name in ("images", "out", "tiny.yaml"))
        Path(images, "left.png").mkdir(parents=True)  # no picture
        PIL.Image.fromarray(test_image()).save(f"{images}/left.png/a.png")
        self.load(tiny_onnx.brightness(), kind="depth")
        code, text = run_main(path, "--images", images, out)
        self.assertEqual((code, text.count("1 of 1 images")), (0, 1), text)
        header, _, depth = Path(out, "left.png/a.pfm").read_bytes().partition(b"-1.0\n")
        self.assertEqual(header, b"Pf\n%d %d\n" % (WIDTH, HEIGHT))
        depth = np.frombuffer(depth, "<f4").reshape(HEIGHT, WIDTH)[::-1]
        np.testing.assert_allclose(depth, test_image().mean(2) / 255, rtol=1e-5)  # rounding of float32
        self.describe(kind="probability", threshold=100 / 255)
        self.assertEqual(run_main(path, "--images", images, out)[0], 0)
        mask = np.asarray(PIL.Image.open(f"{out}/left.png/a.png.png"))
        np.testing.assert_array_equal(mask, np.where(test_image().mean(2) >= 100, 0, 255))
        Path(images, "cut.jpg").write_bytes(b"\xff\xd8")
        code, text = run_main(path, "--images", images, out)
        self.assertEqual(code, 1)
        self.assertRegex(text, "cut.jpg: picture of 2 bytes(.|\n)*1 of 2 images")
        self.assertEqual(run_main(path, "--images", out + "/none", out)[0], 2)


if __name__ == "__main__":
    if WITH_ONNX:
        sys.argv.remove("--onnx")
        try:
            import onnxruntime  # noqa: F401
        except ImportError:
            print("skipped: ONNX Runtime is missing (pip install onnxruntime)")
            sys.exit(77)
    else:
        del OnnxNetworks
    unittest.main(verbosity=2)
