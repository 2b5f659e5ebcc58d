#!/usr/bin/env python3
"""depth_image_proc makes a cloud of the mapper's depth maps by launch/consumers/depth_image_proc.launch: the only consumer in
Debian. Exit code 77: it is missing.

Usage: consumers_test.py FOLDER_OF_acmp_make_bag
"""
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import rospkg
import rospy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from nodelet_session import end_all, start_master, wait_for  # noqa: E402  # pylint: disable=wrong-import-position,import-error

CLOUDS = 3


def check(cloud, depth, info):
    """The cloud has each known pixel of the depth map at its place, and nothing else."""
    offsets = [field.offset for name in "xyz" for field in cloud.fields if field.name == name]
    data = np.frombuffer(cloud.data, np.uint8).reshape(cloud.height, cloud.width, cloud.point_step)
    points = np.stack([data[:, :, o:o + 4].copy().view("<f4")[:, :, 0] for o in offsets], axis=2)
    z = np.frombuffer(depth.data, "<f4").reshape(depth.height, depth.width)
    assert points.shape[:2] == z.shape, (points.shape, z.shape)
    known = np.isfinite(z)
    assert known.mean() > 0.3, f"depth of {known.mean():.0%} of the pixels"
    assert (np.isfinite(points).all(axis=2) == known).all()
    v, u = np.nonzero(known)
    k = np.reshape(info.K, (3, 3))
    expected = z[known][:, None] * np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(len(u))], axis=1)
    assert np.abs(points[known] - expected).max() < 1e-4 * z[known].max()  # both compute in float32


def main():
    try:
        rospkg.RosPack().get_path("depth_image_proc")
    except rospkg.ResourceNotFound:
        print("skipped: depth_image_proc is missing (Debian package libdepth-image-proc-dev)")
        return 77
    folder = tempfile.TemporaryDirectory()
    processes = []
    try:
        bag = folder.name + "/room.bag"
        subprocess.run([sys.argv[1] + "/acmp_make_bag", "--synthetic", bag, "--width", "96", "--height", "72", "--keyframes", "8"],
                       check=True)
        processes.append(start_master())
        rospy.init_node("consumers_test", disable_signals=True)
        received = {kind: {} for kind in (PointCloud2, Image, CameraInfo)}
        for topic, kind in (("depth_points", PointCloud2), ("depth/image_rect", Image), ("depth/camera_info", CameraInfo)):
            rospy.Subscriber("/acmp/" + topic, kind, lambda m, kind=kind: received[kind].update({m.header.stamp: m}))
        processes.append(subprocess.Popen(["roslaunch", "acmp_mapping", "depth_image_proc.launch"]))
        wait_for(lambda: "/acmp/depth_points" in dict(rospy.get_published_topics()), "depth_image_proc")
        processes.append(subprocess.Popen(["roslaunch", "acmp_mapping", "demo.launch", f"bag:={bag}", "device:=cpu", "preset:=online",
                                           "rviz:=false", f"save_folder:={folder.name}", "play_args:=--wait-for-subscribers -d 1"]))

        def whole():
            clouds, depths, infos = (set(received[kind]) for kind in (PointCloud2, Image, CameraInfo))
            return clouds & depths & infos
        wait_for(lambda: len(whole()) >= CLOUDS, f"{CLOUDS} clouds of depth_image_proc", 300)
        for stamp in whole():
            check(received[PointCloud2][stamp], received[Image][stamp], received[CameraInfo][stamp])
        print(f"{len(whole())} clouds are those of their depth maps")
    finally:
        end_all(processes)
        folder.cleanup()
    return 0


if __name__ == "__main__":
    sys.exit(main())
