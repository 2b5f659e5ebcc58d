#!/usr/bin/python3
"""Loads every launch file and rviz config of the package and compares the names in them with the interface in the code.

usage: shipped_files_test.py SOURCE_FOLDER"""
import glob
import importlib.util
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

import catkin_pkg.package
import geometry_msgs.msg
import roslaunch.arg_dump
import roslaunch.config
import roslaunch.xmlloader
import yaml

SOURCE = os.path.abspath(sys.argv.pop(1))
NAMESPACE = "/acmp/"
FRONTENDS = ["kimera_vio.launch", "okvis.launch", "openvins.launch", "orb_slam3_ros.launch",
             "orb_slam3_ros_wrapper.launch", "orb_slam_2_ros.launch", "ov2slam.launch", "rtabmap.launch",
             "stella_vslam_ros.launch", "vins_fusion.launch", "vins_mono.launch"]
STEREO = ["kimera_vio.launch", "okvis.launch", "openvins.launch", "orb_slam3_ros.launch", "orb_slam3_ros_wrapper.launch",
          "ov2slam.launch", "rtabmap.launch", "vins_fusion.launch"]
MAPPERS = ["dense_mapper.launch"] + ["frontends/" + name for name in FRONTENDS]  # each starts mapper and map
CONSUMERS = ["costmap_2d.launch", "depth_image_proc.launch", "nvblox.launch", "rtabmap_keyframes.launch",
             "voxblox.launch"]


def interface_names():
    """Topics and services of the nodelet: the strings of topic_names.h."""
    with open(os.path.join(SOURCE, "include/acmp_mapping/ros/topic_names.h")) as file:
        return set(re.findall(r'"([^"]+)"', file.read()))


def parameters(path="config/acmp_mapping.yaml"):
    """Of a shipped file, with those that it leaves to the preset: "#name: value"."""
    with open(os.path.join(SOURCE, path)) as file:
        return yaml.safe_load(re.sub(r"^#(?=\w)", "", file.read(), flags=re.MULTILINE))


def parameter_names(path="config/acmp_mapping.yaml"):
    return set(parameters(path))


def load(launch, *arguments):
    config = roslaunch.config.ROSLaunchConfig()
    roslaunch.xmlloader.XmlLoader().load(os.path.join(SOURCE, "launch", launch), config, argv=list(arguments),
                                         verbose=False)
    return config


def node_names(config):
    return sorted(node.namespace + node.name for node in config.nodes)


def launch_arguments(launch):
    """Names and defaults of a launch file's own arguments; without a default: None."""
    return {arg.get("name"): arg.get("default")
            for arg in xml.etree.ElementTree.parse(os.path.join(SOURCE, "launch", launch)).getroot().findall("arg")}


def mapper_parameters(config):
    prefix = NAMESPACE + "dense_mapper/"
    return {name[len(prefix):]: param.value for name, param in config.params.items() if name.startswith(prefix)}


class LaunchFiles(unittest.TestCase):
    def test_all_are_tested_here(self):
        paths = glob.glob(os.path.join(SOURCE, "launch/**/*.launch"), recursive=True)
        names = sorted(os.path.relpath(path, os.path.join(SOURCE, "launch")) for path in paths)
        self.assertEqual(names, sorted(["demo.launch", "dense_mapper.launch"] +
                                       ["frontends/" + n for n in FRONTENDS] + ["consumers/" + n for n in CONSUMERS]))

    def test_mapper_and_map_as_nodelets_and_alone(self):
        for standalone in ("false", "true"):
            config = load("dense_mapper.launch", "standalone:=" + standalone, "namespace:=other")
            nodes = {node.name: node.required for node in config.nodes}
            self.assertEqual(set(nodes), {"dense_mapper", "map_server"} | ({"manager"} if standalone == "false" else set()))
            self.assertEqual({node.namespace for node in config.nodes}, {"/other/"})
            self.assertTrue(nodes["dense_mapper"] and nodes["map_server"], "the launch goes on without a node")
            self.assertEqual(sorted(name.rstrip("/") for name in config.clear_params),
                             ["/other/dense_mapper", "/other/map_server"], "values of an earlier start count")

    def test_a_second_mapper_sends_its_points_to_the_first_ones_map(self):
        config = load("dense_mapper.launch", "namespace:=acmp/right", "map:=false",
                      "keyframe_points:=/acmp/keyframe_points")
        self.assertEqual(node_names(config), ["/acmp/right/dense_mapper", "/acmp/right/manager"])
        mapper = [node for node in config.nodes if node.name == "dense_mapper"][0]
        self.assertEqual(dict(mapper.remap_args)["keyframe_points"], "/acmp/keyframe_points")
        own = [node for node in load("dense_mapper.launch").nodes if node.name == "map_server"][0]
        self.assertEqual(dict(own.remap_args)["keyframe_points"], "keyframe_points")

    def test_networks_get_the_mappers_images(self):
        shipped = os.path.join(SOURCE, "config/networks/midas_small.yaml")
        self.assertTrue(os.path.exists(shipped))
        given = {name: "/given/" + name for name in ("image", "prior_depth", "mask")}
        for launch in MAPPERS:
            config = load(launch, "depth_network:=midas_small.yaml", "mask_network:=/my/sky.yaml",
                          *["%s:=%s" % item for item in given.items()])
            nodes = {node.name: node for node in config.nodes if node.type == "network_node.py"}
            with self.subTest(launch):
                self.assertEqual({name: node.args for name, node in nodes.items()},
                                 {"depth_network": shipped, "mask_network": "/my/sky.yaml"})
                for node in nodes.values():
                    self.assertEqual((node.namespace, node.required), ("/acmp/", False))
                    self.assertEqual({name: dict(node.remap_args)[name] for name in given}, given)

    def test_nodelets_are_loaded_without_bonds(self):
        with open(os.path.join(SOURCE, "nodelet_plugins.xml")) as file:
            plugins = file.read()
        for nodelet in [node for node in load("dense_mapper.launch").nodes if node.name != "manager"]:
            self.assertIn("--no-bond", nodelet.args)
            self.assertIn('name="%s"' % nodelet.args.split()[1], plugins)

    def test_remaps_are_inputs(self):
        inputs = [name for name, value in launch_arguments("dense_mapper.launch").items() if value and value[0] == "/"]
        self.assertIn("image", inputs)
        self.assertLessEqual(set(inputs), interface_names())
        alone = ["namespace:=other", "standalone:=true", "map:=false"]
        for launch, arguments in [("dense_mapper.launch", [])] + [(launch, alone) for launch in MAPPERS]:
            config = load(launch, *arguments, *["%s:=/given/%s" % (name, name) for name in inputs])
            if arguments:
                self.assertEqual(node_names(config), ["/other/dense_mapper"])
            for node in [node for node in config.nodes if node.name != "manager"]:
                remaps = dict(node.remap_args)
                with self.subTest(launch=launch, node=node.name):
                    self.assertEqual({name: remaps[name] for name in inputs}, {name: "/given/" + name for name in inputs})

    def test_parameters_are_known(self):
        overrides = {"device": "cpu", "image_transport": "compressed", "pose_is": "T_cam_world",
                     "pose_child": "camera_flu", "overload": "block", "preset": "online"}
        config = load("dense_mapper.launch", *["%s:=%s" % item for item in overrides.items()])
        values = mapper_parameters(config)
        map_prefix = NAMESPACE + "map_server/"
        of_map = {name[len(map_prefix):] for name in config.params if name.startswith(map_prefix)}
        self.assertEqual(len(values) + len(of_map), len(config.params), "there are others")
        self.assertLessEqual(set(values), parameter_names())
        self.assertEqual(of_map, parameter_names("config/map_server.yaml"))
        for name, value in overrides.items():
            self.assertEqual(values[name], value)

    def test_roslaunch_calls_no_optional_argument_required(self):
        for launch in MAPPERS + ["demo.launch"]:
            with self.subTest(launch):
                shown = roslaunch.arg_dump.get_args([os.path.join(SOURCE, "launch", launch)])
                required = {name for name, (_, default) in shown.items() if not default}
                self.assertEqual(required, {"bag"} if launch == "demo.launch" else set())

    def test_every_argument_that_names_a_parameter_sets_it(self):
        arguments = set(launch_arguments("dense_mapper.launch"))
        for node, path, least in (("dense_mapper", "config/acmp_mapping.yaml", {"preset", "max_image_size", "lookahead"}),
                                  ("map_server", "config/map_server.yaml", {"max_keyframes", "voxel_size"})):
            defaults = parameters(path)
            names = arguments & set(defaults)
            self.assertGreaterEqual(names, least)
            other = {bool: True, int: 5, float: 0.75, str: "other"}
            wanted = {name: other[type(defaults[name])] for name in names - {"T_body_cam", "T_cam_source"}}
            for launch in MAPPERS:
                params = load(launch, *["%s:=%s" % item for item in wanted.items()]).params
                for name, value in wanted.items():
                    with self.subTest(launch=launch, name=name):
                        self.assertNotEqual(value, defaults[name])
                        found = params[NAMESPACE + node + "/" + name].value
                        self.assertEqual((found, type(found)), (value, type(defaults[name])))

    def test_parameters_that_matter_are_arguments(self):
        with open(os.path.join(SOURCE, "README.md")) as file:
            table = file.read().split("| parameter | default | |\n")[1].split("\n\n")[0]
        names = {name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])}
        self.assertGreaterEqual(len(names), 10)
        self.assertLessEqual(names, set(launch_arguments("dense_mapper.launch")))

    def test_demo(self):
        config = load("demo.launch", "bag:=/some.bag", "device:=cpu")
        nodes = {node.name: node for node in config.nodes}
        self.assertEqual(set(nodes), {"dense_mapper", "manager", "map_server", "player", "rviz"})
        self.assertNotIn("/rviz", node_names(load("demo.launch", "bag:=/some.bag", "rviz:=false")))
        self.assertTrue(config.params["/use_sim_time"].value)
        self.assertEqual(config.params["/acmp/dense_mapper/overload"].value, "block")
        self.assertEqual(config.params["/acmp/dense_mapper/device"].value, "cpu")
        self.assertIn("--clock", nodes["player"].args)
        self.assertIn("/some.bag", nodes["player"].args)
        self.assertTrue(os.path.exists(nodes["rviz"].args.split()[-1]), nodes["rviz"].args)

    def test_rviz_has_the_frame_of_the_frontends_poses(self):
        for launch, frame, arguments in (("frontends/stella_vslam_ros.launch", "map", ()), ("frontends/ov2slam.launch", "world", ()),
                                         ("frontends/openvins.launch", "global", ()), ("frontends/rtabmap.launch", "odom", ()),
                                         ("dense_mapper.launch", "earth", ("world_frame:=earth",))):
            self.assertNotIn("rviz", [node.name for node in load(launch, *arguments).nodes])
            rviz = [node for node in load(launch, "rviz:=true", *arguments).nodes if node.name == "rviz"][0]
            self.assertIn("-f %s " % frame, rviz.args)


class Frontends(unittest.TestCase):
    def test_each_has_parameters(self):
        paths = glob.glob(os.path.join(SOURCE, "config/frontends/*.yaml"))
        self.assertEqual(sorted(os.path.basename(path) for path in paths),
                         [name.replace(".launch", ".yaml") for name in FRONTENDS])

    def test_its_parameters_are_loaded_over_the_others(self):
        for launch in FRONTENDS:
            with self.subTest(launch):
                with open(os.path.join(SOURCE, "config/frontends", launch.replace(".launch", ".yaml"))) as file:
                    own = yaml.safe_load(file)
                self.assertLessEqual(set(own), parameter_names())
                loaded = mapper_parameters(load("frontends/" + launch))
                self.assertEqual({name: loaded[name] for name in own}, own)
                self.assertEqual(set(loaded), set(mapper_parameters(load("dense_mapper.launch"))))

    def test_its_topics_reach_the_mapper(self):
        for launch in FRONTENDS:
            with self.subTest(launch):
                mapper = [n for n in load("frontends/" + launch).nodes if n.name == "dense_mapper"][0]
                remaps = dict(mapper.remap_args)
                topics = {name: value.replace("$(arg node)", "orb_slam2_mono")
                          for name, value in launch_arguments("frontends/" + launch).items()
                          if value and value.startswith("/") and name in interface_names()}
                self.assertGreaterEqual(len(topics), 3)
                self.assertEqual({name: remaps[name] for name in topics}, topics)

    def test_stereo_adds_the_right_camera(self):
        for launch in STEREO:
            with self.subTest(launch):
                alone = load("frontends/" + launch)
                pair = load("frontends/" + launch, "stereo:=true")
                self.assertEqual(mapper_parameters(pair), dict(mapper_parameters(alone), source_cameras=1))
                remaps = dict([node for node in pair.nodes if node.name == "dense_mapper"][0].remap_args)
                for left, right in (("image", "source_image"), ("camera_info", "source_camera_info")):
                    names = re.sub("cam0", "cam1", re.sub("left", "right", remaps[left])).replace("_color", "")
                    self.assertEqual(remaps[right], names)
                    self.assertNotEqual(remaps[right], remaps[left])

    def test_a_file_of_the_users_takes_the_place_of_its_own(self):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            file.write("sync_tolerance: 0.25\n")
            file.flush()
            for launch in FRONTENDS:
                with self.subTest(launch):
                    values = mapper_parameters(load("frontends/" + launch, "frontend_config:=" + file.name))
                    plain = mapper_parameters(load("dense_mapper.launch"))
                    self.assertEqual(values, dict(plain, sync_tolerance=0.25))


IMAGE, CAMERA_INFO, CLOUD, POSE = "sensor_msgs/Image", "sensor_msgs/CameraInfo", "sensor_msgs/PointCloud2", "geometry_msgs/PoseStamped"
OUTPUTS = {"depth/image_rect": IMAGE, "depth/camera_info": CAMERA_INFO, "rgb/image_rect_color": IMAGE,
           "rgb/camera_info": CAMERA_INFO, "points": CLOUD, "keyframe_pose": POSE,
           "keyframe_transform": "geometry_msgs/TransformStamped"}  # the last by a node of voxblox.launch

# By launch file: type of its node, arguments, what the node reads by its sources, and the parameters with which it waits for
# nothing that does not come and passes over no keyframe.
READERS = {
    "depth_image_proc.launch": ("nodelet", [], {
        "rgb/image_rect_color": IMAGE, "rgb/camera_info": CAMERA_INFO, "depth_registered/image_rect": IMAGE},
                                {"depth_points/exact_sync": True}),
    "nvblox.launch": ("nvblox_node", ["camera_frame:=cam", "world_frame:=slam"], {
        "depth/image": IMAGE, "depth/camera_info": CAMERA_INFO, "color/image": IMAGE, "color/camera_info": CAMERA_INFO,
        "pose": POSE}, {"use_tf_transforms": False, "use_topic_transforms": True, "nvblox/pose_frame": "cam",
                        "nvblox/global_frame": "slam", "nvblox/max_depth_update_hz": 0, "nvblox/max_color_update_hz": 0}),
    "rtabmap_keyframes.launch": ("rtabmap", ["camera_frame:=cam", "world_frame:=slam"], {
        "rgb/image": IMAGE, "depth/image": IMAGE, "rgb/camera_info": CAMERA_INFO},
                                 {"rtabmap/approx_sync": False, "rtabmap/subscribe_depth": True, "rtabmap/frame_id": "cam",
                                  "rtabmap/odom_frame_id": "slam", "rtabmap/Rtabmap/DetectionRate": "0"}),
    "voxblox.launch": ("tsdf_server", ["world_frame:=slam"], {
        "pointcloud": CLOUD, "transform": "geometry_msgs/TransformStamped"},
                       {"voxblox/use_tf_transforms": False, "voxblox/world_frame": "slam"}),
}


class Consumers(unittest.TestCase):
    """Launch files for packages that Debian does not have: their nodes get all that their sources say they read."""

    def test_they_get_what_they_read(self):
        for launch, (kind, arguments, reads, parameters_of_node) in READERS.items():
            with self.subTest(launch):
                config = load("consumers/" + launch, *arguments)
                node = [node for node in config.nodes if node.type == kind][-1]
                remaps = dict(node.remap_args)
                self.assertEqual({name: OUTPUTS.get(remaps.get(name, name)) for name in reads}, reads)
                found = {name: config.params[NAMESPACE + name].value for name in parameters_of_node}
                self.assertEqual(found, parameters_of_node)
                self.assertEqual({node.namespace for node in config.nodes}, {NAMESPACE})
        self.assertLessEqual(set(OUTPUTS) - {"keyframe_transform", "rgb/camera_info"}, interface_names())

    def test_voxblox_gets_the_mappers_poses_or_tf(self):
        node = [node for node in load("consumers/voxblox.launch").nodes if node.package == "topic_tools"][0]
        source, target, kind, expression = shlex.split(node.args)[:4]
        self.assertEqual((source, target, kind), ("keyframe_pose", "keyframe_transform", OUTPUTS["keyframe_transform"]))
        pose = geometry_msgs.msg.PoseStamped()
        pose.header.frame_id, pose.pose.position.y, pose.pose.orientation.z = "slam", 2, 1
        transform = eval(expression, {"geometry_msgs": geometry_msgs, "m": pose})  # pylint: disable=eval-used
        self.assertEqual((transform.header.frame_id, transform.transform.translation.y, transform.transform.rotation.z),
                         ("slam", 2, 1))
        by_tf = load("consumers/voxblox.launch", "tf:=true")
        self.assertEqual([node.type for node in by_tf.nodes], ["tsdf_server"])
        self.assertTrue(by_tf.params[NAMESPACE + "voxblox/use_tf_transforms"].value)

    def test_costmaps_mark_and_clear_by_the_points(self):
        arguments = ["min_height:=0.12", "max_height:=1.8"]
        prefix = NAMESPACE + "costmap_node/costmap/points_layer/"
        alone = {name[len(prefix):]: param.value for name, param in load("consumers/costmap_2d.launch", *arguments).params.items()
                 if name.startswith(prefix)}
        for source, marks in (("obstacles", True), ("free_space", False)):
            self.assertIn(source, alone["observation_sources"].split())
            expected = {"topic": NAMESPACE + "points", "data_type": "PointCloud2", "marking": marks, "clearing": not marks,
                        "expected_update_rate": 0, "observation_persistence": 0}  # keyframes come irregularly, and late
            if marks:
                expected.update(min_obstacle_height=0.12, max_obstacle_height=1.8)
            self.assertEqual({name: alone[source + "/" + name] for name in expected}, expected)
        of_move_base = load("consumers/costmap_2d.launch", *arguments, "costmap:=/move_base/local_costmap")
        self.assertEqual(of_move_base.nodes, [])
        self.assertEqual({name: param.value for name, param in of_move_base.params.items()},
                         {"/move_base/local_costmap/points_layer/" + name: value for name, value in alone.items()})


class PackageXml(unittest.TestCase):
    """What the build looks for has a dependency, so that rosdep installs it."""

    def setUp(self):
        environment = {"ROS_DISTRO": "debian", "ROS_PYTHON_VERSION": "3", "ROS_VERSION": "1"}
        self.package = catkin_pkg.package.parse_package(os.path.join(SOURCE, "package.xml"))
        self.package.evaluate_conditions(environment)
        self.package.validate()

    def names(self, *kinds):
        return {item.name for kind in kinds for item in getattr(self.package, kind + "_depends")
                if item.evaluated_condition}

    def test_catkin_packages(self):
        with open(os.path.join(SOURCE, "src/cmake/AcmpRos.cmake")) as file:
            text = file.read()
        components = re.search(r"ACMP_CATKIN_COMPONENTS ([^)]*)\)", text).group(1).split()
        self.assertGreater(len(components), 15)
        self.assertLessEqual(set(components), self.names("build"))

    def test_libraries_that_cmake_finds(self):
        keys = {"CGAL": "cgal", "CLI11": "cli11", "Ceres": "libceres-dev", "Eigen3": "eigen", "GTest": "gtest",
                "octomap": "octomap", "OpenCV": "libopencv-dev", "PCL": "libpcl-all-dev", "PNG": "libpng-dev", "TBB": "tbb",
                "ZLIB": "zlib", "yaml-cpp": "yaml-cpp",
                "nanoflann": "libnanoflann-dev", "nlohmann_json": "nlohmann-json-dev",
                "pcl_conversions": "pcl_conversions", "Python": "python3-dev", "pybind11": "pybind11-dev",
                "rosbag_storage": "rosbag", "rostest": "rostest"}
        others = {"CUDAToolkit", "Threads", "catkin"}
        found = set()
        paths = glob.glob(os.path.join(SOURCE, "**/CMakeLists.txt"), recursive=True)
        for path in paths + glob.glob(os.path.join(SOURCE, "src/cmake/*.cmake")):
            if os.path.relpath(path, SOURCE).split(os.sep)[0] in ("src", "test", "cuda", "CMakeLists.txt"):
                with open(path) as file:
                    found |= set(re.findall(r"find_package\(([\w-]+)", file.read()))
        self.assertEqual(found - others - set(keys), set(), "has no key here")
        self.assertLessEqual({keys[name] for name in found - others}, self.names("build", "test"))

    def test_nodes_of_launch_files(self):
        nodes = [node for launch in ["dense_mapper.launch"] for node in load(launch).nodes]
        nodes += load("demo.launch", "bag:=/some.bag").nodes
        nodes += [node for node in load("consumers/voxblox.launch").nodes if node.package != "voxblox_ros"]
        packages = {node.package for node in nodes} - {"acmp_mapping"}
        self.assertGreaterEqual(packages, {"nodelet", "rosbag", "rviz", "topic_tools"})
        self.assertLessEqual(packages, self.names("exec"))

    def test_ubuntu_20_04_is_asked_for_nothing_that_rosdep_lacks_there(self):
        self.package.evaluate_conditions({"ROS_DISTRO": "noetic"})
        self.assertEqual(self.names("build") & {"cli11", "libnanoflann-dev"}, set())


class Viewers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with open(os.path.join(SOURCE, "config/acmp_mapping.rviz")) as file:
            cls.rviz = yaml.safe_load(file)["Visualization Manager"]
        with open(os.path.join(SOURCE, "config/foxglove_layout.json")) as file:
            cls.foxglove = json.load(file)
        cls.bridge = os.path.join(SOURCE, "scripts/rerun_bridge.py")

    def test_topics_are_outputs(self):
        of_rviz = [display[key] for display in self.rviz["Displays"] for key in ("Topic", "Image Topic") if key in display]
        of_foxglove = [topic for panel in self.foxglove["configById"].values() for topic in
                       [*panel.get("topics", {}), *panel.get("imageMode", {}).values()]]
        with open(self.bridge) as file:
            of_rerun = [NAMESPACE + topic for topic in re.findall(r'"([\w/]+)": \(\w+, \w+\)', file.read())]
        for topics, least in ((of_rviz, 1), (of_foxglove, 10), (of_rerun, 7)):
            self.assertGreaterEqual(len(topics), least)
            self.assertLessEqual(set(topics), {NAMESPACE + name for name in interface_names()})

    def test_rvizs_clouds_have_the_channels_that_colour_them_and_its_frame_is_that_of_recorded_bags(self):
        clouds = [display for display in self.rviz["Displays"] if display["Class"] == "rviz/PointCloud2"]
        with open(os.path.join(SOURCE, "src/ros/output_conversion.cpp")) as file:
            fields = re.findall(r'"(\w+)", 1, kFloat', file.read())
        channels = {display.get("Channel Name") for display in clouds if display["Color Transformer"] == "Intensity"}
        self.assertEqual(channels, {"confidence"})
        self.assertLessEqual(channels, set(fields))
        with open(os.path.join(SOURCE, "include/acmp_mapping/bags/bag_recording.h")) as file:
            frame = re.search(r'kWorldFrame\[\] = "(\w+)"', file.read()).group(1)
        self.assertEqual(self.rviz["Global Options"]["Fixed Frame"], frame)

    def test_every_panel_of_foxglove_has_a_place(self):
        def places(part):
            return [part] if isinstance(part, str) else places(part["first"]) + places(part["second"])
        self.assertEqual(sorted(places(self.foxglove["layout"])), sorted(self.foxglove["configById"]))

    @unittest.skipIf(importlib.util.find_spec("rerun"), "Rerun is installed")
    def test_reruns_bridge_says_what_to_install(self):
        run = subprocess.run([sys.executable, self.bridge], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertEqual(run.returncode, 1)
        self.assertIn("Rerun is missing (pip install rerun-sdk)", run.stdout)


if __name__ == "__main__":
    unittest.main(verbosity=2)
