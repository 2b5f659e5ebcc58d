#!/usr/bin/python3
"""Loads every launch file and rviz config of the package and compares the names in them with the interface in the code.

usage: shipped_files_test.py SOURCE_FOLDER"""
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
from pathlib import Path

import catkin_pkg.package
import geometry_msgs.msg
import roslaunch.arg_dump
import roslaunch.config
import roslaunch.xmlloader
import yaml

SOURCE = Path(sys.argv.pop(1)).absolute()
LAUNCH = SOURCE / "launch"
NAMESPACE = "/acmp/"
FRONTENDS = [f"frontends/{name}.launch" for name in (
    "kimera_vio", "okvis", "openvins", "orb_slam3_ros", "orb_slam3_ros_wrapper", "orb_slam_2_ros", "ov2slam", "rtabmap",
    "stella_vslam_ros", "vins_fusion", "vins_mono")]
MONO = [f"frontends/{name}.launch" for name in ("orb_slam_2_ros", "stella_vslam_ros", "vins_mono")]
CONSUMERS = [f"consumers/{name}.launch" for name in ("costmap_2d", "depth_image_proc", "nvblox", "rtabmap_keyframes", "voxblox")]
OF_MAPPER, OF_MAP = "config/acmp_mapping.yaml", "config/map_server.yaml"


def read(path):
    return (SOURCE / path).read_text()


def interface_names():
    """Topics and services of the nodelets: the strings of two headers."""
    return {name for header in ("topic_names", "pose_sources")
            for name in re.findall(r'"([\w/]+)"', read(f"include/acmp_mapping/ros/{header}.h"))}


def parameters(path):
    """Of a shipped file, with those that it leaves to the preset: "#name: value"."""
    return yaml.safe_load(re.sub(r"^#(?=\w)", "", read(path), flags=re.MULTILINE))


def load(launch, *arguments, **values):
    """With arguments "name:=value", or as keywords."""
    config = roslaunch.config.ROSLaunchConfig()
    arguments = [*arguments, *(f"{name}:={value}" for name, value in values.items())]
    roslaunch.xmlloader.XmlLoader().load(str(LAUNCH / launch), config, argv=arguments, verbose=False)
    return config


def node_of(config, name):
    return next(node for node in config.nodes if node.name == name)


def remaps_of(config, name="dense_mapper"):
    return dict(node_of(config, name).remap_args)


def node_names(config):
    return sorted(node.namespace + node.name for node in config.nodes)


def launch_arguments(launch):
    """Names and defaults of a launch file's own arguments; without a default: None."""
    return {arg.get("name"): arg.get("default")
            for arg in xml.etree.ElementTree.parse(LAUNCH / launch).getroot().findall("arg")}


def inputs():
    """Arguments of dense_mapper.launch that are topics."""
    return [name for name, value in launch_arguments("dense_mapper.launch").items() if value and value[0] == "/"]


def parameters_of(config, node="dense_mapper"):
    prefix = f"{NAMESPACE}{node}/"
    return {name[len(prefix):]: param.value for name, param in config.params.items() if name.startswith(prefix)}


class LaunchFiles(unittest.TestCase):
    def test_all_are_tested_here(self):
        names = sorted(str(path.relative_to(LAUNCH)) for path in LAUNCH.rglob("*.launch"))
        self.assertEqual(names, sorted(["demo.launch", "dense_mapper.launch", *FRONTENDS, *CONSUMERS]))

    def test_mapper_and_map_as_nodelets_and_alone(self):
        self.assertEqual(node_names(load("dense_mapper.launch")),
                         ["/acmp/dense_mapper", "/acmp/manager", "/acmp/map_server"])
        alone = load("dense_mapper.launch", standalone="true", namespace="other")
        self.assertEqual(node_names(alone), ["/other/dense_mapper", "/other/map_server"])

    def test_a_second_mapper_sends_its_points_to_the_first_ones_map(self):
        config = load("dense_mapper.launch", namespace="acmp/right", map="false", keyframe_points="/acmp/keyframe_points")
        self.assertEqual(node_names(config), ["/acmp/right/dense_mapper", "/acmp/right/manager"])
        self.assertEqual(remaps_of(config)["keyframe_points"], "/acmp/keyframe_points")
        self.assertEqual(remaps_of(load("dense_mapper.launch"), "map_server")["keyframe_points"], "keyframe_points")

    def test_networks_get_the_mappers_images(self):
        shipped = str(SOURCE / "config/networks/midas_small.yaml")
        self.assertTrue(Path(shipped).exists())
        given = {name: f"/given/{name}" for name in ("image", "prior_depth", "mask")}
        for launch in ["dense_mapper.launch", *FRONTENDS]:
            config = load(launch, depth_network="midas_small.yaml", mask_network="/my/sky.yaml", **given)
            nodes = {node.name: node for node in config.nodes if node.type == "network_node.py"}
            with self.subTest(launch):
                self.assertEqual({name: node.args for name, node in nodes.items()},
                                 {"depth_network": shipped, "mask_network": "/my/sky.yaml"})
                for name, node in nodes.items():
                    self.assertEqual((node.namespace, node.required), ("/acmp/", False))
                    self.assertLessEqual(given.items(), remaps_of(config, name).items())

    def test_what_a_mappers_networks_make_is_its_own(self):
        config = load("dense_mapper.launch", namespace="acmp/right", mask_network="sky.yaml")
        self.assertEqual([remaps_of(config, node)["mask"] for node in ("dense_mapper", "mask_network")], ["mask"] * 2)
        self.assertEqual(remaps_of(config)["labels"], "/slam/labels")

    def test_nodelets_are_loaded_without_bonds_and_a_launch_whose_nodelet_cannot_start_ends(self):
        for standalone in "true", "false":
            config = load("dense_mapper.launch", standalone=standalone)
            self.assertEqual(sorted(name.rstrip("/") for name in config.clear_params),  # values of an earlier start
                             ["/acmp/dense_mapper", "/acmp/map_server"])
            for name in "dense_mapper", "map_server":
                self.assertTrue(node_of(config, name).required)
                if standalone == "false":
                    self.assertIn("--no-bond", node_of(config, name).args)
                    self.assertIn(f'name="{node_of(config, name).args.split()[1]}"', read("nodelet_plugins.xml"))

    def test_roslaunch_calls_no_optional_argument_required(self):
        for launch in ["dense_mapper.launch", "demo.launch", *FRONTENDS]:
            with self.subTest(launch):
                shown = roslaunch.arg_dump.get_args([str(LAUNCH / launch)])
                required = {name for name, (_, default) in shown.items() if not default}
                self.assertEqual(required, set())

    def test_parameters_are_known(self):
        for launch in ["dense_mapper.launch", *FRONTENDS]:
            with self.subTest(launch):
                config = load(launch)
                of_mapper, of_map = parameters_of(config), parameters_of(config, "map_server")
                self.assertEqual(len(of_mapper) + len(of_map), len(config.params), "there are others")
                self.assertLessEqual(set(of_mapper), set(parameters(OF_MAPPER)))
                self.assertEqual(set(of_map), set(parameters(OF_MAP)))

    def test_every_parameter_has_an_argument_that_sets_it(self):
        """Over a frontend's own parameters, too."""
        others = {bool: [True, False], int: [5, 6], float: [0.75, 0.25], str: ["other"]}
        for launch in ["dense_mapper.launch", *FRONTENDS]:
            for node, path, lists in (("dense_mapper", OF_MAPPER, {"T_body_cam", "T_cam_source"}), ("map_server", OF_MAP, set())):
                defaults = parameters(path)
                self.assertGreaterEqual(len(defaults), 15)
                wanted = {name: next(value for value in others[type(default)] if value != default)
                          for name, default in defaults.items() if name not in lists}
                given = {name: str(value).lower() for name, value in wanted.items()}
                found = parameters_of(load(launch, **given, **{name: "[0, 1.5]" for name in lists}), node)
                self.assertEqual({name: (found[name], type(found[name])) for name in defaults},
                                 {name: (value, type(value)) for name, value in {**wanted, **dict.fromkeys(lists, [0, 1.5])}.items()},
                                 launch)

    def test_parameters_that_matter_are_parameters(self):
        table = read("README.md").split("| parameter | default | |\n")[1].split("\n\n")[0]
        names = {name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])}
        self.assertGreaterEqual(len(names), 10)
        self.assertLessEqual(names, {*parameters(OF_MAPPER), *parameters(OF_MAP)})

    def test_demo(self):
        config = load("demo.launch", bag="/some.bag", rviz="false", device="cpu")
        self.assertEqual(node_names(config), ["/acmp/dense_mapper", "/acmp/manager", "/acmp/map_server", "/player"])
        self.assertTrue(config.params["/use_sim_time"].value)
        self.assertLessEqual({"overload": "block", "device": "cpu"}.items(), parameters_of(config).items())
        self.assertIn("--clock", node_of(config, "player").args)
        self.assertIn("/some.bag", node_of(config, "player").args)
        self.assertEqual(node_of(config, "player").launch_prefix, None)
        config = load("demo.launch", rviz="false")
        self.assertIn("acmp_room.bag", node_of(config, "player").args)
        self.assertIn("acmp_make_bag --synthetic", node_of(config, "player").launch_prefix)
        viewer = node_of(load("demo.launch", bag="/some.bag"), "viewer")
        self.assertTrue(Path(viewer.args.split()[1]).exists(), viewer.args)

    def test_the_demo_plays_the_room_that_it_has_rendered(self):
        with tempfile.TemporaryDirectory() as folder:
            room = Path(folder) / "acmp_room.bag"
            make = Path(folder) / "make"  # its last argument is the file
            make.write_text("#!/bin/bash\necho rendered\necho room >${@: -1}\n", encoding="utf-8")
            make.chmod(0o755)
            prefix = shlex.split(node_of(load("demo.launch", rviz="false", make_bag=str(make)), "player").launch_prefix)

            def play():
                return subprocess.run([*prefix, "cat", room.name], cwd=folder, check=True, stdout=subprocess.PIPE,
                                      text=True).stdout.splitlines()
            self.assertEqual(play(), ["rendered", "room"])
            self.assertEqual(play(), ["room"])
            room.write_text("of somebody else\n", encoding="utf-8")
            self.assertEqual(play()[-2:], ["rendered", "room"])
            self.assertEqual((Path(folder) / "acmp_room.bag.other").read_text(encoding="utf-8"), "of somebody else\n")
            self.assertEqual(play(), ["room"])

    def test_z_up_is_told_to_map_and_viewer(self):
        for launch, arguments in (("dense_mapper.launch", {}), ("demo.launch", {"bag": "/some.bag"})):
            config = load(launch, "rviz:=true", **arguments)
            self.assertNotIn("/acmp/map_server/z_up", [name for name, p in config.params.items() if p.value is True])
            self.assertNotIn("--occupancy", node_of(config, "viewer").args)
            config = load(launch, "rviz:=true", "z_up:=true", **arguments)
            self.assertIs(config.params["/acmp/map_server/z_up"].value, True)
            self.assertIn("--occupancy", node_of(config, "viewer").args)

    def test_rviz_is_started_in_the_mappers_namespace_when_asked_for(self):
        for launch in ("dense_mapper.launch", "frontends/ov2slam.launch"):
            self.assertNotIn("viewer", [node.name for node in load(launch).nodes])
            self.assertEqual(node_of(load(launch, "rviz:=true", "namespace:=other"), "viewer").namespace, "/other/")


class Frontends(unittest.TestCase):
    def test_its_parameters_are_loaded_over_the_others(self):
        self.assertEqual({path.stem for path in (SOURCE / "config/frontends").glob("*.yaml")},
                         {Path(launch).stem for launch in FRONTENDS})
        plain = parameters_of(load("dense_mapper.launch"))
        for launch in FRONTENDS:
            with self.subTest(launch), tempfile.NamedTemporaryFile("w", suffix=".yaml") as of_user:
                own = yaml.safe_load(read(f"config/frontends/{Path(launch).stem}.yaml"))
                self.assertLessEqual(set(own), set(parameters(OF_MAPPER)))
                loaded = parameters_of(load(launch))
                self.assertLessEqual(own.items(), loaded.items())
                self.assertEqual(set(loaded), set(plain))
                of_user.write("sync_tolerance: 0.25\n")
                of_user.flush()
                self.assertEqual(parameters_of(load(launch, frontend_config=of_user.name)), {**plain, "sync_tolerance": 0.25})

    def test_its_topics_reach_the_mapper(self):
        for launch in FRONTENDS:
            with self.subTest(launch):
                topics = {name: value.replace("$(arg node)", "orb_slam2_mono")
                          for name, value in launch_arguments(launch).items()
                          if value and value.startswith("/") and name in interface_names()}
                self.assertGreaterEqual(len(topics), 3)
                self.assertLessEqual(topics.items(), remaps_of(load(launch)).items())

    def test_stereo_adds_the_right_camera(self):
        for launch in sorted(set(FRONTENDS).difference(MONO)):
            with self.subTest(launch):
                pair = load(launch, stereo="true")
                self.assertEqual(parameters_of(pair), {**parameters_of(load(launch)), "source_cameras": 1})
                remaps = remaps_of(pair)
                for left, right in (("image", "source_image"), ("camera_info", "source_camera_info")):
                    names = re.sub("cam0", "cam1", re.sub("left", "right", remaps[left])).replace("_color", "")
                    self.assertEqual(remaps[right], names)
                    self.assertNotEqual(remaps[right], remaps[left])

    def test_other_arguments_of_the_mapper_reach_it(self):
        self.assertIn("image", inputs())
        self.assertLessEqual(set(inputs()), interface_names())
        given = {name: f"/given/{name}" for name in inputs()}
        for launch in ["dense_mapper.launch", *FRONTENDS]:
            with self.subTest(launch):
                self.assertLessEqual(given.items(), remaps_of(load(launch, **given), "map_server").items())
                alone = load(launch, namespace="other", standalone="true", map="false", **given)
                self.assertEqual(node_names(alone), ["/other/dense_mapper"])
                self.assertLessEqual(given.items(), remaps_of(alone).items())


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
                config = load(f"consumers/{launch}", *arguments)
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
        self.package = catkin_pkg.package.parse_package(str(SOURCE / "package.xml"))
        self.package.evaluate_conditions(environment)
        self.package.validate()

    def names(self, *kinds):
        return {item.name for kind in kinds for item in getattr(self.package, kind + "_depends")
                if item.evaluated_condition}

    def test_catkin_packages(self):
        components = re.search(r"ACMP_CATKIN_COMPONENTS ([^)]*)\)", read("src/cmake/AcmpRos.cmake")).group(1).split()
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
        paths = [SOURCE / "CMakeLists.txt", *(SOURCE / "src/cmake").glob("*.cmake")]
        paths += [path for folder in ("src", "test", "cuda") for path in (SOURCE / folder).rglob("CMakeLists.txt")]
        found = {name for path in paths for name in re.findall(r"find_package\(([\w-]+)", path.read_text())}
        self.assertEqual(found - others - set(keys), set(), "has no key here")
        self.assertLessEqual({keys[name] for name in found - others}, self.names("build", "test"))

    def test_nodes_of_launch_files(self):
        nodes = load("dense_mapper.launch").nodes + load("demo.launch", bag="/some.bag").nodes
        nodes += [node for node in load("consumers/voxblox.launch").nodes if node.package != "voxblox_ros"]
        packages = {node.package for node in nodes} - {"acmp_mapping"}
        self.assertGreaterEqual(packages, {"nodelet", "rosbag", "topic_tools"})
        self.assertLessEqual(packages, self.names("exec"))

    def test_ubuntu_20_04_is_asked_for_nothing_that_rosdep_lacks_there(self):
        self.package.evaluate_conditions({"ROS_DISTRO": "noetic"})
        self.assertEqual(self.names("build") & {"cli11", "libnanoflann-dev"}, set())


class Scripts(unittest.TestCase):
    def test_cuda_is_looked_for_again_and_a_compiler_that_fails_is_told_with_its_reason(self):
        with tempfile.TemporaryDirectory() as folder:
            compiler = Path(folder, "nvcc")
            compiler.write_text("#!/bin/sh\necho call >>%s/calls\necho 'host_config.h:9: error: unsupported GNU version' >&2\n"
                                "exit 1\n" % folder)
            compiler.chmod(0o755)
            Path(folder, "CMakeLists.txt").write_text(
                "cmake_minimum_required(VERSION 3.16)\nproject(probe LANGUAGES CXX)\nset(ACMP_CUDA AUTO)\n"
                "list(APPEND CMAKE_MODULE_PATH %s/src/cmake)\ninclude(AcmpModule)\ninclude(AcmpCuda)\n" % SOURCE)

            def configure():
                result = subprocess.run(["cmake", "-S", folder, "-B", folder + "/build"], capture_output=True, text=True,
                                        check=True, env={**os.environ, "CUDACXX": str(compiler)})
                self.assertIn("unsupported GNU version", result.stdout)
                return len(Path(folder, "calls").read_text().split())
            first = configure()
            self.assertGreaterEqual(configure(), 2 * first, "the second time the compiler is tried as often")

    def test_a_bundle_names_launch_files_that_are_there(self):
        for argument, words in (("stella_vslam=x.bag", "stella_vslam_ros"), ("vins_mono=/none.bag", "no such bag")):
            result = subprocess.run([SOURCE / "scripts/gpu_nodelets.sh", "bundle", "/nowhere", argument],
                                    capture_output=True, text=True, check=False)
            self.assertEqual(result.returncode, 2)
            self.assertIn(words, result.stderr)


class Viewers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.rviz = yaml.safe_load(read("config/acmp_mapping.rviz"))["Visualization Manager"]
        cls.foxglove = json.loads(read("config/foxglove_layout.json"))

    def test_topics_are_outputs(self):
        of_rviz = [display[key] for display in self.rviz["Displays"] for key in ("Topic", "Image Topic", "Marker Topic")
                   if key in display]
        of_foxglove = [topic for panel in self.foxglove["configById"].values() for topic in
                       [*panel.get("topics", {}), *panel.get("imageMode", {}).values()]]
        of_rerun = [NAMESPACE + topic for topic in re.findall(r'"([\w/]+)": \(\w+, \w+\)', read("scripts/rerun_bridge.py"))]
        for topics, least in ((of_rviz, 1), (of_foxglove, 10), (of_rerun, 7)):
            self.assertGreaterEqual(len(topics), least)
            of_viewer = set(re.findall(r'Publisher\("(viewer/\w+)"', read("scripts/map_viewer.py")))
            self.assertLessEqual(set(topics), {NAMESPACE + name for name in interface_names() | of_viewer})

    def test_rvizs_clouds_have_the_channels_that_colour_them(self):
        clouds = [display for display in self.rviz["Displays"] if display["Class"] == "rviz/PointCloud2"]
        of_file = {"/acmp/map_points": "output_conversion", "/acmp/distance_slice": "occupancy_output"}
        channels = {display["Topic"]: display.get("Channel Name") for display in clouds
                    if display["Color Transformer"] == "Intensity"}
        self.assertEqual(channels, {"/acmp/map_points": "confidence", "/acmp/distance_slice": "distance"})
        for topic, channel in channels.items():
            self.assertIn(channel, re.findall(r'"(\w+)", 1, kFloat', read(f"src/ros/{of_file[topic]}.cpp")))

    def test_every_panel_of_foxglove_has_a_place(self):
        def places(part):
            return [part] if isinstance(part, str) else places(part["first"]) + places(part["second"])
        self.assertEqual(sorted(places(self.foxglove["layout"])), sorted(self.foxglove["configById"]))

    @unittest.skipIf(importlib.util.find_spec("rerun"), "Rerun is installed")
    def test_reruns_bridge_says_what_to_install(self):
        run = subprocess.run([sys.executable, SOURCE / "scripts/rerun_bridge.py"], stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, text=True, check=False)
        self.assertEqual(run.returncode, 1)
        self.assertIn("Rerun is missing (pip install rerun-sdk)", run.stdout)


class Documents(unittest.TestCase):
    def test_links_lead_somewhere(self):
        """Names of headings are made as GitHub makes them."""
        texts = {path: path.read_text() for path in [SOURCE / "README.md", *(SOURCE / "docs").glob("*.md")]}
        headings = {path: {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
                           for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE)} for path, text in texts.items()}
        for path, text in texts.items():
            for link in set(re.findall(r"\]\((?!http)([^)]+)\)", text)):
                with self.subTest(link, document=path.name):
                    name, _, heading = link.partition("#")
                    target = (path.parent / name).resolve() if name else path
                    self.assertTrue(target.exists())
                    self.assertTrue(not heading or heading in headings[target])


if __name__ == "__main__":
    unittest.main(verbosity=2)
