#!/usr/bin/env python3
"""What map_viewer.py makes of the keyframes' poses and of the settings of rviz. Argument: the source folder."""
import copy
import sys
import unittest
from pathlib import Path

import numpy as np
import yaml
from sensor_msgs import point_cloud2

SOURCE = Path(sys.argv.pop(1))
sys.path.insert(0, str(SOURCE / "scripts"))
import map_viewer  # noqa: E402  # pylint: disable=wrong-import-position,import-error

SETTINGS = yaml.safe_load((SOURCE / "config/acmp_mapping.rviz").read_text(encoding="utf-8"))
OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0.0]])  # of a camera in a world whose x is forward and z up


def about(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    r = np.eye(3)
    r[i, i], r[j, j], r[i, j], r[j, i] = c, c, -s, s
    return r


def cameras(world, yaws, pitches):
    return np.array([world @ about("z", yaw) @ about("y", pitch) @ OPTICAL for yaw, pitch in zip(yaws, pitches)])


def degrees_between(a, b):
    return np.degrees(np.arccos(np.clip(a @ b, -1, 1)))


class Directions(unittest.TestCase):
    def test_quaternion_is_the_inverse_of_rotation(self):
        for yaw in np.linspace(-3.1, 3.1, 9):
            r = about("x", 0.3) @ about("z", yaw) @ about("y", 2 * yaw)
            np.testing.assert_allclose(map_viewer.rotation(map_viewer.quaternion(r)), r, atol=1e-9)

    def test_up_of_cameras_that_look_around_and_down(self):
        world = about("x", 1.9) @ about("y", 0.7)  # any
        turning = cameras(world, np.linspace(0, 2, 20), 0.6 + 0.2 * np.sin(np.arange(20)))
        self.assertLess(degrees_between(map_viewer.upward(turning), world[:, 2]), 2)  # their own is off by 34

    def test_up_of_cameras_that_do_not_turn_is_their_own(self):
        still = cameras(np.eye(3), np.zeros(5), np.full(5, 0.3))
        np.testing.assert_allclose(map_viewer.upward(still), -still[0][:, 1], atol=1e-6)

    def test_z_points_up_where_cameras_stand_upright_or_look_down_and_not_in_the_first_cameras_frame(self):
        yaws = np.linspace(0, 1, 8)
        self.assertTrue(map_viewer.z_points_up(cameras(np.eye(3), yaws, 0.2 * yaws)))
        self.assertTrue(map_viewer.z_points_up(cameras(np.eye(3), yaws, np.full(8, np.pi / 2))))
        self.assertFalse(map_viewer.z_points_up(cameras(OPTICAL.T, yaws, 0.2 * yaws)))
        self.assertFalse(map_viewer.z_points_up(cameras(np.eye(3), yaws, np.full(8, -1.2))))  # as the map server has it

    def test_a_frame_has_its_z_also_where_x_is_along_it(self):
        z = np.array([0.6, 0, 0.8])
        for x in (np.array([1.0, 0, 0]), z, -z):
            r = map_viewer.frame_of(x, z)
            np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-9)
            self.assertAlmostEqual(np.linalg.det(r), 1)
            np.testing.assert_allclose(r[:, 2], z, atol=1e-9)
        self.assertGreater(map_viewer.frame_of(np.array([1.0, 0, 0]), z)[:, 0] @ [1, 0, 0], 0.7)


class Starts(unittest.TestCase):
    def viewer(self):
        viewer = map_viewer.Viewer.__new__(map_viewer.Viewer)
        viewer.newest = viewer.rviz = viewer.info = viewer.map = None
        viewer.rotations, viewer.depths, viewer.started = [], [], []
        viewer.start = lambda: viewer.started.append(viewer.depths[0])
        return viewer

    def test_with_a_map_after_the_last_keyframe(self):
        """A recording has ended: what is latched comes, in any order."""
        pose = map_viewer.PoseStamped()
        pose.pose.position.z, pose.pose.orientation.w = 10, 1  # it looks along z
        path = map_viewer.PathMessage(poses=[pose])
        cloud = point_cloud2.create_cloud_xyz32(path.header, [(0, 0, 5), (0, 0, 12), (1, 0, 13), (0, 1, 14)])
        for first, second in (("on_map", "on_path"), ("on_path", "on_map")):
            viewer = self.viewer()
            for callback in (first, second):
                self.assertEqual(viewer.started, [])
                getattr(viewer, callback)(cloud if callback == "on_map" else path)
            self.assertEqual(viewer.started, [3], "the median of what lies before the camera")
        viewer = self.viewer()
        viewer.on_path(path)
        viewer.on_map(point_cloud2.create_cloud_xyz32(path.header, []))
        self.assertEqual(viewer.started, [])


class Settings(unittest.TestCase):
    def fitted(self, depth, frame="world", namespace="/acmp/", occupancy=True):
        settings = copy.deepcopy(SETTINGS)
        map_viewer.fit(settings, depth, frame, namespace, occupancy)
        return yaml.safe_load(yaml.safe_dump(settings))["Visualization Manager"]

    def test_lengths_have_the_unit_of_the_poses(self):
        metres, millimetres = self.fitted(2.5), self.fitted(2500)
        for name in ("Distance", "Near Clip Distance", "Focal Shape Size"):
            view = [settings["Views"]["Current"][name] for settings in (metres, millimetres)]
            self.assertAlmostEqual(view[1] / view[0], 1000)
        for name, length in (("World", "Length"), ("Camera path", "Line Width")):
            sizes = [next(d for d in settings["Displays"] if d["Name"] == name)[length] for settings in (metres, millimetres)]
            self.assertAlmostEqual(sizes[1] / sizes[0], 1000)

    def test_occupancy_is_shown_only_where_asked_for(self):
        for shown in (True, False):
            occupancy = next(d for d in self.fitted(1, occupancy=shown)["Displays"] if d["Class"] == "rviz/Map")
            self.assertEqual((occupancy["Enabled"], occupancy["Value"]), (shown, shown))

    def test_topics_and_frame_are_those_of_the_mapper(self):
        settings = self.fitted(1, frame="odom", namespace="/robot_2/")
        self.assertEqual(settings["Global Options"]["Fixed Frame"], "odom")
        topics = [display[key] for display in settings["Displays"] for key in ("Topic", "Image Topic", "Marker Topic") if key in display]
        self.assertGreaterEqual(len(topics), 8)
        self.assertTrue(all(topic.startswith("/robot_2/") for topic in topics), topics)
        self.assertEqual(settings["Views"]["Current"]["Target Frame"], "robot_2_view")


if __name__ == "__main__":
    unittest.main()
