#!/usr/bin/python3
"""The launch files of launch/consumers for packages that Debian does not have. The consumers are played here, by what
their sources say they read: each gets the topics and parameters that its launch file gives it, and must find in them
all that it needs of every keyframe. The mapper maps the synthetic room, whose true surfaces are known."""
import glob
import os
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rosbag
import roslaunch.scriptapi
import roslib.packages
import rospy
import rostest
from geometry_msgs.msg import PoseStamped, TransformStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

import consumer_side as side

KEYFRAMES, WIDTH, HEIGHT = 6, 128, 96
LOWEST, HIGHEST = 0.12, 1.8  # of an obstacle, m
CAMERA, WORLD, MAP, ROBOT = "cam0_optical", "slam_world", "map", "base_link"
INPUTS = {"/camera/image_raw": "image", "/camera/camera_info": "camera_info", "/slam/pose": "pose",
          "/slam/sparse_points": "sparse_points"}
FOLDER = os.path.join(roslib.packages.get_pkg_dir("acmp_mapping"), "launch/consumers")
COLOR_ENCODINGS = ("mono8", "mono16", "rgb8", "bgr8", "rgba8", "bgra8")
TIMEOUT_S = 300

# By launch file: type of its node, arguments, and what the node reads.
CONSUMERS = {
    "costmap_2d.launch": ("costmap_2d_node", [f"global_frame:={MAP}", f"robot_base_frame:={ROBOT}",
                                              f"min_height:={LOWEST}", f"max_height:={HIGHEST}"], {}),
    "nvblox.launch": ("nvblox_node", [f"camera_frame:={CAMERA}", f"world_frame:={WORLD}"],
                      {"depth/image": Image, "depth/camera_info": CameraInfo, "color/image": Image,
                       "color/camera_info": CameraInfo, "pose": PoseStamped}),
    "rtabmap_keyframes.launch": ("rtabmap", [f"camera_frame:={CAMERA}", f"world_frame:={WORLD}"],
                                 {"rgb/image": Image, "depth/image": Image, "rgb/camera_info": CameraInfo}),
    "voxblox.launch": ("tsdf_server", [f"world_frame:={WORLD}"],
                       {"pointcloud": PointCloud2, "transform": TransformStamped}),
}


def program(package, name):
    found = roslib.packages.find_node(package, name)
    assert found, f"no program {name} in the package {package}"
    return found[0]


def load(launch, *arguments):
    node_type, needed, _ = CONSUMERS[launch]
    return side.Consumer(os.path.join(FOLDER, launch), node_type, *needed, *arguments)


def stamp(message):
    return message.header.stamp.to_nsec()


def wait_for(condition, what):
    end = rospy.get_time() + TIMEOUT_S
    while not condition():
        assert rospy.get_time() < end, f"waited {TIMEOUT_S} s for {what()}"
        rospy.sleep(0.05)


def as_map_sees(points):
    """From the frontend's world to the robot's map, which is turned and elsewhere; z is up in both."""
    turned = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    return points @ turned.T + [3.0, -2.0, 0.0]


class ConsumersTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        bag, truth = os.path.join(cls.folder.name, "room.bag"), os.path.join(cls.folder.name, "truth")
        subprocess.run([program("acmp_mapping", "acmp_make_bag"), "--synthetic", bag, "--ground-truth", truth,
                        "--width", str(WIDTH), "--height", str(HEIGHT), "--keyframes", str(KEYFRAMES), "--rate", "10",
                        "--camera-frame", CAMERA, "--world-frame", WORLD], check=True, stdout=subprocess.DEVNULL)
        cls.surface = side.read_ply(os.path.join(truth, "surface.ply"))
        cls.is_surface = staticmethod(side.Near(cls.surface, 0.075))
        cls.consumers = {launch: load(launch) for launch in CONSUMERS}
        cls.read_bag(bag)
        cls.start_consumers()
        cls.play()

    @classmethod
    def read_bag(cls, path):
        """Inputs of the mapper in order, the true poses, and tf as the frontend and the robot broadcast it."""
        cls.inputs, cls.poses, cls.tf = [], {}, side.Tf()
        with rosbag.Bag(path) as bag:
            for topic, message, _ in bag.read_messages():
                if topic == "/tf":
                    for entry in message.transforms:
                        cls.tf.add(entry.header.frame_id, entry.child_frame_id, stamp(entry),
                                   side.matrix(entry.transform.translation, entry.transform.rotation))
                elif topic in INPUTS:
                    cls.inputs.append((topic, message))
                if topic == "/slam/pose":
                    cls.poses[stamp(message)] = side.matrix(message.pose.position, message.pose.orientation)
        map_from_world = np.eye(4)
        map_from_world[:3, :3] = (as_map_sees(np.eye(3)) - as_map_sees(np.zeros(3))).T
        map_from_world[:3, 3] = as_map_sees(np.zeros(3))
        cls.tf.add(MAP, WORLD, None, map_from_world)
        cls.tf.add(CAMERA, ROBOT, None, np.eye(4))

    @classmethod
    def start_consumers(cls):
        """Subscriptions of all of them, and the node of voxblox.launch that is no consumer."""
        cls.launched = roslaunch.scriptapi.ROSLaunch()
        cls.launched.start()
        cls.addClassCleanup(cls.launched.stop)
        helpers = [node for node in cls.consumers["voxblox.launch"].config.nodes if node.package == "topic_tools"]
        for node in helpers:
            program(node.package, node.type)
            cls.launched.launch(node)
        cls.recorder = side.Recorder()
        for launch, (_, _, topics) in CONSUMERS.items():
            for name, message_type in topics.items():
                cls.recorder.subscribe(cls.consumers[launch].topic(name), message_type)
        for source in cls.consumers["costmap_2d.launch"].observation_sources().values():
            cls.recorder.subscribe(source["topic"], PointCloud2)

        own = {(rospy.get_name(), topic) for topic in cls.recorder.subscribers}
        others = {(node.namespace + node.name, "/acmp/keyframe_pose") for node in helpers}

        def missing():
            senders = ["/acmp/dense_mapper"] + [node.namespace + node.name for node in helpers]
            return (own | others) - set.union(*(side.receivers(sender) for sender in senders))

        rospy.wait_for_service("/acmp/dense_mapper/flush", TIMEOUT_S)
        # What nobody sends is reported by the test of who wants it.
        end = rospy.get_time() + 60
        while missing() and rospy.get_time() < end:
            rospy.sleep(0.05)
        cls.missing = {topic for _, topic in missing()}

    @classmethod
    def play(cls):
        publishers = {topic: rospy.Publisher("/" + INPUTS[topic], type(message), queue_size=100)
                      for topic, message in cls.inputs}
        wait_for(lambda: all(publisher.get_num_connections() > 0 for publisher in publishers.values()),
                 lambda: "the mapper")
        for topic, message in cls.inputs:
            publishers[topic].publish(message)
        wait_for(lambda: flush() and all(len(cls.recorder.messages(topic)) >= KEYFRAMES
                                         for topic in set(cls.recorder.subscribers) - cls.missing),
                 lambda: {topic: len(cls.recorder.messages(topic)) for topic in cls.recorder.subscribers})

    def received(self, consumer, *names):
        """What came on topics of the consumer, in order. Every keyframe, each once."""
        topics = [consumer.topic(name) for name in names]
        self.assertEqual(self.missing & set(topics), set(), "nobody publishes this with the type that is wanted")
        for topic in topics:
            self.assertEqual([stamp(message) for message in self.recorder.messages(topic)], sorted(self.poses), topic)
        return self.recorder.of(*topics)

    def assert_on_surface(self, points_in_world, least=0.9):
        on_surface = self.is_surface(points_in_world)
        self.assertGreater(len(points_in_world), 500)
        self.assertGreaterEqual(on_surface.mean(), least)

    def check_camera(self, image, info):
        self.assertEqual((info.width, info.height), (image.width, image.height))
        self.assertEqual(info.header.frame_id, image.header.frame_id)
        self.assertFalse(any(info.D), "the images are without distortion")
        self.assertGreater(min(info.K[0], info.K[4], info.P[0], info.P[5]), 0)
        self.assertEqual([info.K[i] for i in (0, 2, 4, 5)], [info.P[i] for i in (0, 2, 5, 6)])

    def check_depth(self, image):
        self.assertEqual(image.encoding, "32FC1")
        self.assertEqual(image.is_bigendian, 0)
        self.assertEqual(image.step, 4 * image.width, "it is read as one block")
        self.assertEqual(len(image.data), image.step * image.height)
        depth = np.frombuffer(image.data, "<f4")
        known = depth[~np.isnan(depth)]
        self.assertGreater(len(known), 0.25 * len(depth))
        self.assertLess(len(known), len(depth), "there must be unknown pixels to look at")
        self.assertTrue((np.isfinite(known) & (known > 0)).all(), "NaN is unknown, all else a depth")

    def check_color(self, image):
        self.assertIn(image.encoding, COLOR_ENCODINGS)
        channels = {"mono8": 1, "mono16": 2}.get(image.encoding, len(image.encoding) - 1)
        self.assertEqual(image.step, channels * image.width)
        self.assertEqual(len(image.data), image.step * image.height)

    def check_cloud(self, cloud):
        fields = {field.name: field for field in cloud.fields}
        for name in "xyz":
            self.assertEqual((fields[name].datatype, fields[name].count), (side.FLOAT32, 1))
        self.assertIn("rgb", fields)
        self.assertFalse(cloud.is_bigendian)
        self.assertEqual(cloud.row_step, cloud.point_step * cloud.width)
        self.assertEqual(len(cloud.data), cloud.row_step * cloud.height)
        self.assertTrue(np.isfinite(side.positions(cloud)).all())

    def test_no_launch_file_is_forgotten(self):
        names = {os.path.basename(path) for path in glob.glob(os.path.join(FOLDER, "*.launch"))}
        self.assertEqual(names - {"depth_image_proc.launch"}, set(CONSUMERS))  # which is run by a test of its own

    def test_voxblox(self):
        """tsdf_server.cc, transformer.cc: clouds wait in a queue for a transform with their stamp."""
        voxblox = self.consumers["voxblox.launch"]
        self.assertFalse(voxblox.parameter("~use_tf_transforms", True))
        tolerance_ns = 1e9 * voxblox.parameter("~timestamp_tolerance_sec", 0.001)
        transforms, clouds, integrated = [], [], []
        for topic, message in self.received(voxblox, "pointcloud", "transform"):
            if topic == voxblox.topic("transform"):
                self.assertEqual(message.header.frame_id, voxblox.parameter("~world_frame", "world"))
                transforms.append(message)
                continue
            self.check_cloud(message)
            clouds.append(message)
            while clouds:
                pose = next((t for t in transforms if abs(stamp(t) - stamp(clouds[0])) < tolerance_ns), None)
                if pose is None:
                    break
                del transforms[:transforms.index(pose)]
                integrated.append((clouds.pop(0), pose.transform))
        self.assertEqual(len(integrated), KEYFRAMES, "clouds are left without a pose")
        self.assert_on_surface(np.concatenate([
            side.transformed(side.matrix(pose.translation, pose.rotation), side.positions(cloud))
            for cloud, pose in integrated]))
        rgb = np.concatenate([side.cloud_fields(cloud)["rgb"].view("<u4") for cloud, _ in integrated])
        self.assertGreater(len(np.unique(rgb)), 100, "points have colours")

    def test_voxblox_by_tf(self):
        voxblox = load("voxblox.launch", "tf:=true")
        self.assertTrue(voxblox.parameter("~use_tf_transforms", True))
        self.assertEqual([node.type for node in voxblox.config.nodes], ["tsdf_server"])
        for _, cloud in self.received(voxblox, "pointcloud"):
            pose = self.tf.lookup(voxblox.parameter("~world_frame", "world"), cloud.header.frame_id, stamp(cloud))
            self.assertIsNotNone(pose)
            self.assert_on_surface(side.transformed(pose, side.positions(cloud)))

    def test_nvblox(self):
        """nvblox_node.cpp, transformer.cpp, image_conversions.cu: depth and colour each with their camera by equal
        stamps; poses by the frame whose poses they are, the next one that is not earlier. The transformer's parameters
        are read beside the node."""
        nvblox = self.consumers["nvblox.launch"]
        self.assertTrue(nvblox.parameter("use_topic_transforms", False))
        self.assertTrue(nvblox.parameter("~use_depth", True) and nvblox.parameter("~use_color", True))
        poses = {stamp(message): message for _, message in self.received(nvblox, "pose")}
        for message in poses.values():
            self.assertEqual(message.header.frame_id, nvblox.parameter("~global_frame", "map"))
        points = []
        for kind in ("depth", "color"):
            image_topic, info_topic = nvblox.topic(kind + "/image"), nvblox.topic(kind + "/camera_info")
            pairs = side.exact_sync(self.received(nvblox, kind + "/image", kind + "/camera_info"), 30)
            self.assertEqual(len(pairs), KEYFRAMES)
            rate = nvblox.parameter(f"~max_{kind}_update_hz", {"depth": 10.0, "color": 5.0}[kind])
            self.assertEqual(side.passing_rate([stamp(pair[image_topic]) for pair in pairs], rate), KEYFRAMES)
            for pair in pairs:
                image = pair[image_topic]
                self.check_camera(image, pair[info_topic])
                self.assertEqual(image.header.frame_id, nvblox.parameter("~pose_frame", "base_link"))
                later = min(time for time in poses if time >= stamp(image))
                self.assertLess(later - stamp(image), 1e8)
                if kind == "color":
                    self.check_color(image)
                    continue
                self.check_depth(image)
                pose = side.matrix(poses[later].pose.position, poses[later].pose.orientation)
                points.append(side.transformed(pose, side.back_projected(image, pair[info_topic])))
        self.assert_on_surface(np.concatenate(points), 0.75)  # no other view has to confirm them

    def test_rtabmap(self):
        """CommonDataSubscriber.cpp, CoreWrapper.cpp, MsgConversion.cpp: image, depth and camera by equal stamps, and tf
        at that stamp from odom_frame_id to frame_id and from there to the image."""
        rtabmap = self.consumers["rtabmap_keyframes.launch"]
        self.assertTrue(rtabmap.parameter("~subscribe_depth", True))
        self.assertFalse(rtabmap.parameter("~approx_sync", True))
        rgb, depth, info = (rtabmap.topic(name) for name in ("rgb/image", "depth/image", "rgb/camera_info"))
        frames = side.exact_sync(self.received(rtabmap, "rgb/image", "depth/image", "rgb/camera_info"), 10)
        self.assertEqual(len(frames), KEYFRAMES)
        rate = float(rtabmap.parameter("~Rtabmap/DetectionRate", 1))
        self.assertEqual(side.passing_rate([stamp(frame[rgb]) for frame in frames], rate), KEYFRAMES)
        base = rtabmap.parameter("~frame_id", "base_link")
        points = []
        for frame in frames:
            self.check_color(frame[rgb])
            self.check_depth(frame[depth])
            self.check_camera(frame[rgb], frame[info])
            self.check_camera(frame[depth], frame[info])
            base_pose = self.tf.lookup(rtabmap.parameter("~odom_frame_id", ""), base, stamp(frame[rgb]))
            camera = self.tf.lookup(base, frame[depth].header.frame_id, stamp(frame[depth]))
            self.assertIsNotNone(base_pose)
            self.assertIsNotNone(camera)
            points.append(side.transformed(base_pose @ camera, side.back_projected(frame[depth], frame[info])))
        self.assert_on_surface(np.concatenate(points), 0.75)  # no other view has to confirm them

    def test_costmap(self):
        """observation_buffer.cpp, costmap_2d_ros.cpp: a cloud and its sensor's place are brought to the global frame by
        tf at the cloud's stamp; points within the heights mark, and rays to points clear."""
        consumer = self.consumers["costmap_2d.launch"]
        self.assertIn({"name": "points_layer", "type": "costmap_2d::VoxelLayer"},
                      consumer.parameter("~costmap/plugins"))
        frame = consumer.parameter("~costmap/global_frame")
        self.assertIsNotNone(self.tf.lookup(frame, consumer.parameter("~costmap/robot_base_frame"), max(self.poses)),
                             "costmap_2d waits for the robot's pose")
        sources = consumer.observation_sources().values()
        self.assertTrue(any(source["clearing"] for source in sources))
        for source in sources:
            self.assertEqual(source["topic"], "/acmp/points")
            self.assertEqual(source["data_type"], "PointCloud2")
            self.assertEqual(source["expected_update_rate"], 0, "keyframes come irregularly")
            self.assertEqual(source["observation_persistence"], 0, "keyframes come late: they would be dropped")
            if source["marking"]:
                self.assertEqual((source["min_obstacle_height"], source["max_obstacle_height"]), (LOWEST, HIGHEST))
        is_surface = side.Near(as_map_sees(self.surface), 0.075)
        marking = 0
        for _, cloud in self.recorder.of("/acmp/points"):
            self.check_cloud(cloud)
            transform = self.tf.lookup(frame, cloud.header.frame_id, stamp(cloud))
            self.assertIsNotNone(transform, "tf knows no way from the cloud to the costmap at its stamp")
            points = side.transformed(transform, side.positions(cloud))
            self.assertGreater(is_surface(points).mean(), 0.9)
            marking += ((points[:, 2] >= LOWEST) & (points[:, 2] <= HIGHEST)).sum()
        self.assertGreater(marking, 500)

    def test_costmap_of_move_base(self):
        alone = self.consumers["costmap_2d.launch"]
        path, arguments = os.path.join(FOLDER, "costmap_2d.launch"), CONSUMERS["costmap_2d.launch"][1]
        config = roslaunch.config.ROSLaunchConfig()
        roslaunch.xmlloader.XmlLoader().load(path, config, verbose=False,
                                             argv=[*arguments, "costmap:=/move_base/local_costmap"])
        self.assertEqual(config.nodes, [])
        prefix = alone.resolve("~costmap") + "/points_layer/"
        layer = {name[len(prefix):]: param.value for name, param in alone.config.params.items()
                 if name.startswith(prefix)}
        self.assertEqual({name: param.value for name, param in config.params.items()},
                         {"/move_base/local_costmap/points_layer/" + name: value for name, value in layer.items()})


def flush():
    return rospy.ServiceProxy("/acmp/dense_mapper/flush", Trigger)().success


if __name__ == "__main__":
    rospy.init_node("consumers_rostest")
    rostest.rosrun("acmp_mapping", "consumers_rostest", ConsumersTest, sys.argv)
