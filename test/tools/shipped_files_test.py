#!/usr/bin/python3
"""Loads every launch file and rviz config of the package and compares the names in them with the interface in the code.

usage: shipped_files_test.py SOURCE_FOLDER"""
import glob
import os
import re
import sys
import unittest

import roslaunch.config
import roslaunch.xmlloader
import yaml

SOURCE = os.path.abspath(sys.argv.pop(1))
NAMESPACE = "/acmp/"


def interface_names():
    """Topics and services of the nodelet: the strings of topic_names.h."""
    with open(os.path.join(SOURCE, "include/acmp_mapping/ros/topic_names.h")) as file:
        return set(re.findall(r'constexpr char k\w+\[\] = "([^"]+)";', file.read()))


def parameter_names():
    """Of the shipped file, with those that it leaves to the preset: "#name: value"."""
    with open(os.path.join(SOURCE, "config/acmp_mapping.yaml")) as file:
        return set(yaml.safe_load(re.sub(r"^#(?=\w)", "", file.read(), flags=re.MULTILINE)))


def load(launch, *arguments):
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(os.path.join(SOURCE, "launch", launch), config, argv=list(arguments),
                                         verbose=False)
    return config


def node_names(config):
    return sorted(node.namespace + node.name for node in config.nodes)


class LaunchFiles(unittest.TestCase):
    def test_all_are_tested_here(self):
        names = sorted(os.path.basename(path) for path in glob.glob(os.path.join(SOURCE, "launch/*.launch")))
        self.assertEqual(names, ["demo.launch", "dense_mapper.launch"])

    def test_mapper_as_nodelet_and_alone(self):
        self.assertEqual(node_names(load("dense_mapper.launch")), ["/acmp/dense_mapper", "/acmp/manager"])
        alone = load("dense_mapper.launch", "standalone:=true", "namespace:=other")
        self.assertEqual(node_names(alone), ["/other/dense_mapper"])

    def test_nodelet_is_loaded_without_bonds(self):
        mapper = [node for node in load("dense_mapper.launch").nodes if node.name == "dense_mapper"][0]
        self.assertIn("--no-bond", mapper.args)
        with open(os.path.join(SOURCE, "nodelet_plugins.xml")) as file:
            self.assertIn('name="%s"' % mapper.args.split()[1], file.read())

    def test_remaps_are_inputs(self):
        arguments = ["image:=/a", "camera_info:=/b", "pose:=/c", "sparse_points:=/d"]
        mapper = [node for node in load("dense_mapper.launch", *arguments).nodes if node.name == "dense_mapper"][0]
        remaps = dict(mapper.remap_args)
        self.assertEqual(set(remaps.values()), {"/a", "/b", "/c", "/d"})
        self.assertLessEqual(set(remaps), interface_names())

    def test_parameters_are_known(self):
        overrides = {"device": "cpu", "image_transport": "compressed", "pose_is": "T_cam_world",
                     "pose_child": "camera_flu", "overload": "block", "preset": "online"}
        config = load("dense_mapper.launch", *["%s:=%s" % item for item in overrides.items()])
        prefix = NAMESPACE + "dense_mapper/"
        values = {name[len(prefix):]: param.value for name, param in config.params.items()}
        self.assertTrue(all(name.startswith(prefix) for name in config.params))
        self.assertLessEqual(set(values), parameter_names())
        for name, value in overrides.items():
            self.assertEqual(values[name], value)

    def test_values_of_an_earlier_start_are_forgotten(self):
        for standalone in ("true", "false"):
            config = load("dense_mapper.launch", "standalone:=" + standalone)
            self.assertEqual([name.rstrip("/") for name in config.clear_params], ["/acmp/dense_mapper"])

    def test_demo(self):
        config = load("demo.launch", "bag:=/some.bag", "rviz:=false", "device:=cpu")
        self.assertEqual(node_names(config), ["/acmp/dense_mapper", "/acmp/manager", "/player"])
        self.assertTrue(config.params["/use_sim_time"].value)
        self.assertEqual(config.params["/acmp/dense_mapper/overload"].value, "block")
        self.assertEqual(config.params["/acmp/dense_mapper/device"].value, "cpu")
        player = [node for node in config.nodes if node.name == "player"][0]
        self.assertIn("--clock", player.args)
        self.assertIn("/some.bag", player.args)

    def test_demo_shows_the_config_that_is_shipped(self):
        rviz = [node for node in load("demo.launch", "bag:=/some.bag").nodes if node.name == "rviz"][0]
        self.assertTrue(os.path.exists(rviz.args.split()[-1]), rviz.args)

    def test_demo_needs_a_bag(self):
        with self.assertRaises(Exception):
            load("demo.launch")


class RvizConfig(unittest.TestCase):
    def setUp(self):
        with open(os.path.join(SOURCE, "config/acmp_mapping.rviz")) as file:
            self.manager = yaml.safe_load(file)["Visualization Manager"]

    def topics(self):
        keys = ("Topic", "Image Topic")
        return {display["Name"]: display[key] for display in self.manager["Displays"] for key in keys if key in display}

    def test_topics_are_outputs(self):
        for name, topic in self.topics().items():
            self.assertTrue(topic.startswith(NAMESPACE), name)
            self.assertIn(topic[len(NAMESPACE):], interface_names(), name)

    def test_shows_all_there_is_to_see(self):
        wanted = {"map_points", "points", "keyframe_path", "rgb/image_rect_color", "depth/image_vis",
                  "confidence/image_vis", "normal/image_vis"}
        self.assertEqual(set(self.topics().values()), {NAMESPACE + topic for topic in wanted})

    def test_fixed_frame_is_that_of_recorded_bags(self):
        with open(os.path.join(SOURCE, "src/tools/bag_recording.h")) as file:
            frame = re.search(r'world_frame = "(\w+)"', file.read()).group(1)
        self.assertEqual(self.manager["Global Options"]["Fixed Frame"], frame)


if __name__ == "__main__":
    unittest.main(verbosity=2)
