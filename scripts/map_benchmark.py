#!/usr/bin/env python3
"""Time and memory of a large map: keyframes that see a wavy wall are sent to a map_server, and its services are called.

    source scripts/ros_environment.sh build; scripts/map_benchmark.py --keyframes 500 --points 100000
"""
import argparse
import math
import re
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rospy
from acmp_mapping.msg import KeyframePoints
from acmp_mapping.srv import LoadSession, SaveMap, SaveSession
from sensor_msgs.msg import PointField

from nodelet_session import Session, call
from replay_report import wait_for

WIDTH, HEIGHT, DISTANCE = 4.0, 3.0, 4.0  # metres: what a keyframe sees of the wall
STEP = WIDTH / 2                         # from one keyframe to the next
FIELDS = "x y z rgb normal_x normal_y normal_z confidence".split()


def keyframe(number, count, points):
    message = KeyframePoints(mapper="benchmark", count=number + 1, run=1, id=number + 1)
    message.header.stamp = rospy.Time(1000 + number)
    message.header.frame_id = "world"
    message.T_world_cam = [1, 0, 0, number * STEP, 0, 1, 0, 0, 0, 0, 1, 0]
    info = message.camera_info
    info.header, info.width, info.height, info.distortion_model = message.header, 640, 480, "plumb_bob"
    info.K = [640, 0, 0, 0, 640, 0, 0, 0, 1]
    info.P = [640, 0, 0, 0, 0, 640, 0, 0, 0, 0, 1, 0]
    info.R = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    noise = np.random.default_rng(number).uniform(-0.2, 0.2, (count, 5)).astype(np.float32)  # for files are compressed
    columns = int(math.sqrt(count * WIDTH / HEIGHT))
    x = (np.arange(count) % columns + 0.5) * WIDTH / columns
    y = (np.arange(count) // columns + 0.5) * WIDTH / columns
    packed = np.zeros((count, len(FIELDS)), np.float32)
    packed[:, :3] = np.stack([x, y, DISTANCE + 0.1 * np.sin(3 * (x + number * STEP) + 2 * y)], 1)
    packed[:, 3] = ((128 + 100 * noise[:, 0]).astype(np.uint32) * 0x10101).view(np.float32)
    packed[:, 4:6] = noise[:, 1:3]
    packed[:, 6] = -np.sqrt(1 - (noise[:, 1:3]**2).sum(1))
    packed[:, 7] = 0.75 + noise[:, 3]
    cloud = message.points
    cloud.header, cloud.height, cloud.width, cloud.is_dense = message.header, 1, count, True
    cloud.fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(FIELDS)]
    cloud.point_step, cloud.row_step, cloud.data = 32, 32 * count, packed.tobytes()
    points.publish(message)


def gigabytes(pid, name):
    return int(re.search(name + r":\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text()).group(1)) * 1024e-9


def measure(session, name, step):
    Path(f"/proc/{session.manager.pid}/clear_refs").write_text("5")  # the peak starts from here
    start = time.monotonic()
    answer = step()
    seconds = time.monotonic() - start
    if answer and not answer.success:
        sys.exit(f"{name}: {answer.message}")
    pid = session.manager.pid
    print(f"| {name} | {seconds:.2f} | {gigabytes(pid, 'VmHWM'):.2f} | {gigabytes(pid, 'VmRSS'):.2f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keyframes", type=int, default=500)
    parser.add_argument("--points", type=int, default=100000, help="of a keyframe")
    parser.add_argument("--voxel-size", type=float, default=0.01, help="metres")
    options = parser.parse_args()
    parameters = {"max_keyframes": options.keyframes, "voxel_size": options.voxel_size}
    with tempfile.TemporaryDirectory() as folder, Session(folder, parameters) as session:
        rospy.init_node("map_benchmark", disable_signals=True)
        points = rospy.Publisher("/keyframe_points", KeyframePoints, queue_size=options.keyframes)
        wait_for(lambda: points.get_num_connections() > 0, "the map server")

        def save(file, map_format):
            return rospy.ServiceProxy("/map_server/save_map", SaveMap)(f"{folder}/{file}", map_format, True)

        def add():
            for number in range(options.keyframes):
                keyframe(number, options.points, points)
            wait_for(lambda: save("first.ply", 0).keyframes == options.keyframes, "all keyframes in the map", 3600)

        bag = f"{folder}/map.bag"
        print("| step | s | peak GB | GB afterwards |\n|---|---|---|---|")
        measure(session, "make, send and add keyframes; save", add)
        for file, map_format in ("map.ply", 0), ("map.pcd", 1), ("mesh.ply", 2), ("map.bt", 4):
            measure(session, "save " + file, lambda f=file, k=map_format: save(f, k))
        measure(session, "save the session", lambda: rospy.ServiceProxy("/map_server/save_session", SaveSession)(bag))
        call("/map_server/reset")
        measure(session, "load it into an empty map",
                lambda: rospy.ServiceProxy("/map_server/load_session", LoadSession)(path=bag))


if __name__ == "__main__":
    main()
