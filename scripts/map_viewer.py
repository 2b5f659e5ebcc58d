#!/usr/bin/env python3
"""Starts rviz when the map has its first points, with a view that fits them whatever the unit of the poses, and moves the view
with the newest keyframe. rviz:=true of dense_mapper.launch runs it in the mapper's namespace.

A SLAM frontend with one camera has a unit and a world frame that nobody knows beforehand. So the sizes in rviz's settings
are multiples of the typical depth of the first keyframes; and where z of the world does not point up, rviz gets a fixed frame
whose z points up by the cameras. Occupancy, which is made of heights above the floor, is shown where --occupancy says that
z of the world points up from a floor at 0.

Publishes viewer/keyframes (the keyframes' frusta) and, for rviz' Camera display, viewer/image and viewer/camera_info: the newest
keyframe in the tf frame acmp_camera (of the namespace /acmp), since a frontend need not put its camera's pose into tf.

Exit code: that of rviz.
"""
import argparse
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np
import rospy
import yaml
from geometry_msgs.msg import Point, PoseStamped, Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker

FIRST_KEYFRAMES = 3  # with points, before rviz starts; a map that is there already is enough, too


def frame_name(namespace, name):
    """A tf frame of this node, which other mappers' viewers do not use: acmp_camera in /acmp/."""
    return f"{namespace.strip('/').replace('/', '_')}_{name}".lstrip("_")


def rotation(q):
    """3x4 array to q of a geometry_msgs/Quaternion: the 3x3 matrix."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def position(pose):
    return np.array([pose.position.x, pose.position.y, pose.position.z])


def fields_of(cloud, *names):
    """N x number of names, of a PointCloud2 whose fields are all float32."""
    values = np.frombuffer(cloud.data, "<f4").reshape(-1, cloud.point_step // 4)
    return values[:, [next(field.offset for field in cloud.fields if field.name == name) // 4 for name in names]]


def transform(header, child, translation, quaternion):
    return TransformStamped(header, child, Transform(Vector3(*translation), quaternion))


def quaternion(r):
    """geometry_msgs/Quaternion of a rotation matrix (the eigenvector of Bar-Itzhack, 2000)."""
    k = np.array([[r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
                  [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
                  [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
                  [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)]])
    return Quaternion(*np.linalg.eigh(k)[1][:, 3])


def upward(rotations):
    """The world's upward direction by cameras (N x 3 x 3, T_world_cam) that are tilted up or down, but not to a side: at right
    angles to their x axes; where these do not differ, the cameras' own upward direction."""
    x, up = rotations[:, :, 0], np.mean(-rotations[:, :, 1], axis=0)
    direction = np.linalg.eigh(x.T @ x / len(x) - 0.02 * np.outer(up, up))[1][:, 0]
    return direction if direction @ up > 0 else -direction


def z_points_up(rotations):
    """Whether z of the world points up, by cameras that stand upright or look down: the rule by which the map server publishes
    occupancy (ZPointsUp in map/occupancy_map.h)."""
    sideways, up, backwards = np.mean(rotations[:, 2, 0] ** 2), *np.mean(-rotations[:, 2, 1:], axis=0)
    return bool(sideways < 0.25 and (up > 0.5 or (backwards > 0.5 and up > -0.2)))


def frame_of(x, z):
    """Rotation matrix of the frame whose z is `z` (unit vector), with x as close to `x` as can be."""
    y = np.cross(z, x)
    y = y / np.linalg.norm(y) if np.linalg.norm(y) > 1e-3 else frame_of(np.eye(3)[np.argmin(np.abs(z))], z)[:, 1]
    return np.stack([np.cross(y, z), y, z], axis=1)


def fit(settings, depth, frame, namespace, occupancy):
    """Makes rviz's settings (a dict, changed) those of a map with this typical depth in the unit of its poses."""
    manager = settings["Visualization Manager"]
    manager["Global Options"]["Fixed Frame"] = frame
    for display in manager["Displays"]:
        for key in ("Topic", "Image Topic", "Marker Topic"):
            if key in display:
                display[key] = display[key].replace("/acmp/", namespace)
        if display["Class"] == "rviz/Axes":
            display.update(Length=0.1 * depth, Radius=0.006 * depth)
        elif display["Class"] == "rviz/Path":
            display["Line Width"] = 0.004 * depth
        elif display["Class"] == "rviz/Map":
            display.update(Enabled=occupancy, Value=occupancy)
    manager["Views"]["Current"].update({
        "Target Frame": frame_name(namespace, "view"), "Distance": 2 * depth, "Near Clip Distance": 0.002 * depth,
        "Focal Point": {"X": 0, "Y": 0, "Z": 0}, "Focal Shape Size": 0.02 * depth, "Pitch": 0.5,
        "Yaw": np.pi})  # from behind the camera


class Viewer:
    def __init__(self, options):
        self.options, self.lock = options, threading.Lock()
        self.newest, self.rotations, self.depths, self.up = None, deque(maxlen=100), deque(maxlen=5), None
        self.info = self.picture = self.rviz = self.map = None
        self.camera, self.target, self.upright = (frame_name(rospy.get_namespace(), name)
                                                  for name in ("camera", "view", "upright"))
        self.tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self.static_tf = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        self.frusta = rospy.Publisher("viewer/keyframes", Marker, queue_size=1, latch=True)
        self.image = rospy.Publisher("viewer/image", Image, queue_size=2, latch=True)
        self.camera_info = rospy.Publisher("viewer/camera_info", CameraInfo, queue_size=2, latch=True)
        for topic, kind, callback in (("keyframe_pose", PoseStamped, self.on_pose), ("points", PointCloud2, self.on_points),
                                      ("map_points", PointCloud2, self.on_map), ("keyframe_path", PathMessage, self.on_path),
                                      ("rgb/camera_info", CameraInfo, self.on_info), ("rgb/image_rect_color", Image, self.on_image)):
            rospy.Subscriber(topic, kind, self.locked(callback), queue_size=5)

    def locked(self, callback):
        def call(message):
            with self.lock:
                callback(message)
        return call

    def on_pose(self, message):
        r, t = rotation(message.pose.orientation), position(message.pose)
        self.newest = message
        self.rotations.append(r)
        frames = [transform(message.header, self.camera, t, message.pose.orientation)]
        if self.up is not None:  # the view looks at what is in the middle of the newest image
            frames.append(transform(message.header, self.target, t + r[:, 2] * np.median(self.depths),
                                    quaternion(frame_of(r[:, 2], self.up))))
        self.tf.publish(frames)

    def on_points(self, message):
        if message.width * message.height == 0 or self.newest is None:
            return
        self.depths.append(float(np.median(fields_of(message, "z"))))
        if not self.rviz and len(self.depths) >= FIRST_KEYFRAMES:
            self.start()

    def on_map(self, message):
        """Starts with a map that is there already, also where no more keyframes come, as after a recording."""
        self.map = message
        if self.rviz or self.newest is None or not message.width * message.height:
            return
        if not self.depths and message.header.frame_id == self.newest.header.frame_id:
            depths = (fields_of(message, "x", "y", "z") - position(self.newest.pose)) @ rotation(self.newest.pose.orientation)[:, 2]
            self.depths.extend([float(np.median(depths[depths > 0]))] if np.any(depths > 0) else [])
        if self.depths:
            self.start()

    def on_info(self, message):
        self.info = message
        self.show_image()

    def on_image(self, message):
        self.picture = message
        self.show_image()

    def show_image(self):
        if self.info and self.picture and self.info.header.stamp == self.picture.header.stamp:
            self.info.header.frame_id = self.picture.header.frame_id = self.camera
            self.camera_info.publish(self.info)
            self.image.publish(self.picture)

    def on_path(self, message):
        if self.newest is None and message.poses:  # of a map that was there before; its points are latched, too
            self.rotations.extend(rotation(stamped.pose.orientation) for stamped in message.poses)
            self.newest = PoseStamped(message.header, message.poses[-1].pose)
            self.on_map(self.map or PointCloud2())
        if not self.depths or not self.info:
            return
        size = 0.05 * np.median(self.depths)
        k = np.reshape(self.info.K, (3, 3))
        corners = [size * np.array([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], 1])
                   for x, y in ((0, 0), (self.info.width, 0), (self.info.width, self.info.height), (0, self.info.height))]
        marker = Marker(header=message.header, ns="keyframes", type=Marker.LINE_LIST)
        marker.scale.x = 0.04 * size
        marker.color.r, marker.color.g, marker.color.a = 1.0, 0.6, 1.0
        marker.pose.orientation.w = 1.0
        for stamped in message.poses:
            r, t = rotation(stamped.pose.orientation), position(stamped.pose)
            ends = [Point(*(r @ corner + t)) for corner in corners]
            for i, end in enumerate(ends):
                marker.points += [Point(*t), end, end, ends[(i + 1) % 4]]
        self.frusta.publish(marker)

    def start(self):
        world, depth, rotations = self.newest.header.frame_id, float(np.median(self.depths)), np.array(self.rotations)
        z_is_up = self.options.occupancy or z_points_up(rotations)
        self.up = np.array([0, 0, 1.0]) if z_is_up else upward(rotations)
        if not z_is_up:
            r = frame_of(rotations[-1][:, 2], self.up)
            self.static_tf.publish([transform(self.newest.header, self.upright, np.zeros(3), quaternion(r))])
            rospy.loginfo("z of frame \"%s\" does not point up, by the cameras: the view stands upright in frame %s", world,
                          self.upright)
        settings = yaml.safe_load(Path(self.options.config).read_text(encoding="utf-8"))
        fit(settings, depth, world if z_is_up else self.upright, rospy.get_namespace(),
            self.options.occupancy)
        self.file = tempfile.NamedTemporaryFile("w", suffix=".rviz")
        yaml.safe_dump(settings, self.file)
        self.file.flush()
        self.on_pose(self.newest)
        rospy.loginfo("rviz starts; typical depth: %.3g (unit of the poses)", depth)
        self.rviz = subprocess.Popen([*self.options.rviz.split(), "-d", self.file.name])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default=Path(__file__).resolve().parent.parent / "config/acmp_mapping.rviz",
                        help="settings of rviz, for a map whose typical depth is about 1")
    parser.add_argument("--occupancy", action="store_true", help="show it: z of the world points up from a floor at 0")
    parser.add_argument("--rviz", default="rosrun rviz rviz", help="the command")
    options = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("viewer")
    viewer = Viewer(options)
    rospy.loginfo("rviz starts with the first points of the map")
    while not rospy.is_shutdown():
        if viewer.rviz and viewer.rviz.poll() is not None:
            return viewer.rviz.returncode
        time.sleep(0.2)  # not of the bag's time
    if viewer.rviz:
        viewer.rviz.terminate()
        viewer.rviz.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
