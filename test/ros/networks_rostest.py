#!/usr/bin/env python3
"""dense_mapper.launch with depth_network and mask_network beside the mapper, which maps the synthetic room. With ONNX
Runtime the networks are tiny ones that the test makes; a network that cannot be loaded is tested without it, too."""
import importlib.util
import os
import subprocess
import sys
import tempfile
import unittest
import xmlrpc.client

import numpy as np
import rosbag
import rosgraph
import roslaunch.config
import roslaunch.scriptapi
import roslaunch.xmlloader
import roslib.packages
import rosnode
import rospy
import rostest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

PACKAGE = roslib.packages.get_pkg_dir("acmp_mapping")
sys.path.insert(0, os.path.join(PACKAGE, "test/tools"))
sys.path.insert(0, os.path.join(PACKAGE, "scripts"))
import network_node  # noqa: E402
import tiny_onnx  # noqa: E402

KEYFRAMES, WIDTH, HEIGHT = 6, 128, 96
TIMEOUT_S = 300
BRIGHT = 120 + 1 / 6  # mean of three bytes from which on a pixel is ignored: none has just this
WITHOUT_ONNX = importlib.util.find_spec("onnxruntime") is None


def wait_for(condition, what):
    end = rospy.get_time() + TIMEOUT_S
    while not condition():
        assert rospy.get_time() < end, f"waited {TIMEOUT_S} s for {what}"
        rospy.sleep(0.05)


def receivers(node):
    """(subscriber, topic) of all that `node` sends, once the connection stands; nothing before the node has started, though
    the master may know one of the same name that has ended."""
    api = rosnode.get_api_uri(rosgraph.Master(rospy.get_name()), node, skip_cache=True)
    if not api:
        return set()
    try:
        info = xmlrpc.client.ServerProxy(api).getBusInfo(rospy.get_name())[2]
    except ConnectionRefusedError:
        return set()
    return {(entry[1], entry[4]) for entry in info if entry[2] == "o"}


def pixels(message, kind):
    return np.frombuffer(message.data, kind).reshape(message.height, message.width, -1)


class NetworksTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        bag = os.path.join(cls.folder.name, "room.bag")
        subprocess.run([roslib.packages.find_node("acmp_mapping", "acmp_make_bag")[0], "--synthetic", bag, "--width",
                        str(WIDTH), "--height", str(HEIGHT), "--keyframes", str(KEYFRAMES)], check=True,
                       stdout=subprocess.DEVNULL)
        with rosbag.Bag(bag) as recorded:
            cls.inputs = [(topic, message) for topic, message, _ in recorded.read_messages() if not topic.startswith("/tf")]
        cls.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=100) for topic, message in cls.inputs}
        cls.status = {}  # by name: the newest
        cls.subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, cls.note)
        cls.launched = roslaunch.scriptapi.ROSLaunch()
        cls.launched.start()
        cls.addClassCleanup(cls.launched.stop)
        rospy.wait_for_service("/acmp/dense_mapper/flush", TIMEOUT_S)

    @classmethod
    def note(cls, message):
        for status in message.status:
            cls.status[status.name] = status

    def told(self, *words):
        """Whether some value of a status has all these words in it or its key."""
        return any(all(word in text for word in words) for status in list(self.status.values())
                   for text in [status.message] + [f"{value.key}: {value.value}" for value in status.values])

    def setUp(self):
        self.received = {topic: [] for topic in ("/acmp/depth/image_rect", "/acmp/prior_depth", "/acmp/mask")}
        subscribers = [rospy.Subscriber(topic, Image, messages.append) for topic, messages in self.received.items()]
        for subscriber in subscribers:
            self.addCleanup(subscriber.unregister)
        wait_for(lambda: subscribers[0].get_num_connections() > 0, "the mapper's depth")

    def start(self, **descriptions):
        """The nodes that the launch line starts."""
        arguments = []
        for name, content in descriptions.items():
            path = os.path.join(self.folder.name, name + ".yaml")
            with open(path, "w") as file:
                yaml.safe_dump(content, file)
            arguments.append(f"{name}:={path}")
        config = roslaunch.config.ROSLaunchConfig()
        roslaunch.xmlloader.XmlLoader().load(os.path.join(PACKAGE, "launch/dense_mapper.launch"), config, verbose=False,
                                             argv=arguments)
        nodes = [node for node in config.nodes if node.type == "network_node.py"]
        self.assertEqual(len(nodes), len(descriptions))
        return {node.name: self.launched.launch(node) for node in nodes}

    def send(self, wanted):
        """Of the recording what is on the topics that are wanted."""
        wait_for(lambda: all(p.get_num_connections() > 0 for p in self.publishers.values()), "the mapper")
        for topic, message in self.inputs:
            if wanted(topic):
                self.publishers[topic].publish(message)

    def depths(self):
        """The mapper's maps of all keyframes by stamp; not the newest one of before, which new subscribers get."""
        stamps = {m.header.stamp for topic, m in self.inputs if topic == "/camera/image_raw"}

        def of_these():
            return [m for m in self.received["/acmp/depth/image_rect"] if m.header.stamp in stamps]

        def complete():
            return rospy.ServiceProxy("/acmp/dense_mapper/flush", Trigger)().success and len(of_these()) >= KEYFRAMES
        wait_for(complete, "the maps")
        return {m.header.stamp: pixels(m, "<f4")[:, :, 0] for m in of_these()}

    def test_a_network_that_cannot_be_loaded(self):
        missing = {"file": "none.onnx", "kind": "inverse_depth", "size": [WIDTH, HEIGHT]}
        for process in self.start(depth_network=missing).values():
            wait_for(lambda process=process: not process.is_alive(), "the end of the node")
            self.assertEqual(process.exit_code, 2)
        self.send(lambda topic: True)
        self.assertEqual(len(self.depths()), KEYFRAMES)
        self.assertTrue(rospy.ServiceProxy("/acmp/dense_mapper/reset", Trigger)().success)

    @unittest.skipIf(WITHOUT_ONNX, "ONNX Runtime is missing")
    def test_networks_beside_the_mapper(self):
        with open(os.path.join(self.folder.name, "tiny.onnx"), "wb") as file:
            file.write(tiny_onnx.brightness())
        tiny = {"file": "tiny.onnx", "size": [WIDTH, HEIGHT], "pixel_max": 255}
        later = rospy.Duration(100)  # than what another test has sent
        for message in {id(m): m for _, m in self.inputs if hasattr(m, "header")}.values():
            message.header.stamp += later
        self.start(depth_network={**tiny, "kind": "inverse_depth"},
                   mask_network={**tiny, "kind": "probability", "threshold": BRIGHT, "grow": 1})
        for node, topic in (("depth_network", "/acmp/prior_depth"), ("mask_network", "/acmp/mask")):
            for receiver in ("/acmp/dense_mapper", rospy.get_name()):
                wait_for(lambda n=node, pair=(receiver, topic): pair in receivers("/acmp/" + n), (node, receiver))
        wait_for(lambda: self.publishers["/camera/image_raw"].get_num_connections() >= 3, "both networks")

        # Poses, when the mapper has all maps and masks: so nothing depends on how long an image waits.
        self.send(lambda topic: topic != "/slam/pose")
        for topic in ("/acmp/prior_depth", "/acmp/mask"):
            wait_for(lambda topic=topic: self.told(topic, f"{KEYFRAMES} received"), topic)
        self.send(lambda topic: topic == "/slam/pose")
        depths = self.depths()

        images = {m.header.stamp: m for topic, m in self.inputs if topic == "/camera/image_raw"}
        self.assertEqual(depths.keys(), images.keys())
        masks, priors = ({m.header.stamp: m for m in self.received[topic]} for topic in ("/acmp/mask", "/acmp/prior_depth"))
        for stamp, image in images.items():
            self.assertEqual(image.encoding, "rgb8")
            bright = pixels(image, np.uint8).mean(2)
            ignored = network_node.grown(bright > BRIGHT, 1)
            self.assertTrue(0.05 < ignored.mean() < 0.95, "the threshold must divide the image")
            mask, prior = masks[stamp], priors[stamp]
            self.assertEqual((mask.encoding, mask.header.frame_id), ("mono8", image.header.frame_id))
            np.testing.assert_array_equal(pixels(mask, np.uint8)[:, :, 0], np.where(ignored, 0, 255))
            self.assertEqual((prior.encoding, prior.header.frame_id), ("32FC1", image.header.frame_id))
            inverse = (bright - bright.min()) / (bright.max() - bright.min())
            # 1e-5: rounding of float32; up to a constant that the mapper fits
            offset = 1 / pixels(prior, "<f4")[:, :, 0] - inverse
            self.assertLess(np.ptp(offset), 1e-5)
            self.assertTrue(np.isnan(depths[stamp][ignored]).all())
            self.assertGreater(np.isfinite(depths[stamp][~ignored]).mean(), 0.25)
        wait_for(lambda: self.told("unused_prior_depth", "it explains"), "word that brightness is no depth")
        self.assertFalse(self.told("no_prior_depth") or self.told("no_mask"), self.status)
        for name in ("acmp/depth_network: network", "acmp/mask_network: network"):
            wait_for(lambda name=name: self.status[name].message == "waits for images", name)
            values = {value.key: value.value for value in self.status[name].values}
            self.assertEqual([values[key] for key in ("images", "published", "skipped, too slow", "refused")],
                             [str(KEYFRAMES), str(KEYFRAMES), "0", "0"])


if __name__ == "__main__":
    if WITHOUT_ONNX:
        print("skipped: networks beside the mapper: ONNX Runtime is missing")
    rospy.init_node("networks_rostest")
    rostest.rosrun("acmp_mapping", "networks_rostest", NetworksTest, sys.argv)
