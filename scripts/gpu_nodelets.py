#!/usr/bin/env python3
"""Plays recordings to the nodelets as launched for their frontends and prints one table. See gpu_nodelets.sh. Without a GPU:

    source scripts/ros_environment.sh build; scripts/gpu_nodelets.py ov2slam.bag --set device:=cpu    # launches ov2slam.launch
"""
import argparse
import itertools
import math
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from xmlrpc.client import ServerProxy

import rosbag
import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import CameraInfo

import nodelet_session
from nodelet_session import start_master, wait_for

COUNTS = ("keyframes", "fast depth maps", "refined depth maps", "withdrawn from the map, since poses contradict the images")
COLUMNS = ("recording", "cameras", "rate", "images", "keyframes", "first maps", "refined maps", "withdrawn",
           "image to first map: median, 95 %, most [ms]", "image to refined map, which waits for later keyframes [ms]",
           "over time: GPU memory [MiB]", "memory of the nodelets [MiB]", "their threads")


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bags", type=Path, nargs="+", help="recordings with compressed images, named as launch files")
    parser.add_argument("--rates", type=float, nargs="+", default=[1], help="times real time")
    parser.add_argument("--cameras", type=int, nargs="+", default=[1], help="mappers at once, each with all images, one map")
    parser.add_argument("--seconds", type=float, default=0, help="plays the recording again and again for so long")
    parser.add_argument("--set", nargs="*", default=[], metavar="ARGUMENT:=VALUE", help="arguments of the launch file")
    return parser.parse_args()


def gpu_mib():
    """Memory in use on all GPUs; 0 without nvidia-smi."""
    query = "nvidia-smi --query-gpu=memory.used --format=csv,noheader,nounits || true"
    return sum(map(int, subprocess.run(query, shell=True, capture_output=True, text=True, check=True).stdout.split()))


class Mapper:
    """A mapper as launched for its frontend, and how long after their image its maps came here."""

    def __init__(self, bag, number, arguments, log):
        self.name, self.images, self.fast, self.refined, self.values = f"/acmp_{number}", {}, [], [], {}
        with rosbag.Bag(str(bag)) as reader:
            topics = {info.msg_type: topic for topic, info in reader.get_type_and_topic_info().topics.items()}
        camera_info, image = (topics[f"sensor_msgs/{kind}"] for kind in ("CameraInfo", "CompressedImage"))
        self.subscribers = [rospy.Subscriber(camera_info, CameraInfo, self.on_image),
                            rospy.Subscriber(f"{self.name}/depth_fast/camera_info", CameraInfo, self.on_map, self.fast),
                            rospy.Subscriber(f"{self.name}/depth/camera_info", CameraInfo, self.on_map, self.refined),
                            rospy.Subscriber("/diagnostics", DiagnosticArray, self.on_diagnostics)]
        others = [] if number == 1 else ["map:=false", "keyframe_points:=/acmp_1/keyframe_points"]
        self.launch = subprocess.Popen(
            ["roslaunch", "acmp_mapping", f"{bag.stem}.launch", f"namespace:={self.name[1:]}", "preset:=balanced", "device:=cuda",
             f"image:={image[:-len('/compressed')]}", "image_transport:=compressed", f"camera_info:={camera_info}", *others,
             *arguments.set], stdout=log, stderr=subprocess.STDOUT)

    def on_image(self, message):
        self.images[message.header.stamp] = time.monotonic()

    def on_map(self, message, latencies_ms):
        now = time.monotonic()
        latencies_ms.append(1e3 * (now - self.images.get(message.header.stamp, now)))

    def on_diagnostics(self, message):
        for status in message.status:
            if status.name.strip("/").startswith(f"{self.name[1:]}/dense_mapper"):
                self.values.update((value.key, value.value) for value in status.values)

    def wait_until_ready(self):
        wait_for(lambda: self.values.get("device") or self.launch.poll() is not None, "the device")
        manager = rosgraph.Master("/gpu_nodelets").lookupNode(f"{self.name}/manager")
        self.pid = ServerProxy(manager).getPid("/gpu_nodelets")[2]

    def stop(self):
        for subscriber in self.subscribers:
            subscriber.unregister()
        self.launch.send_signal(signal.SIGINT)
        self.launch.wait(60)


def measure(arguments, log, bag, cameras, rate):
    """A row of the table. Samples once a second: memory of the GPU and of the managers [MiB], the managers' threads."""
    before_mib, mappers, samples = gpu_mib(), [], []

    def sample():
        of_managers = [nodelet_session.sample(mapper.pid) for mapper in mappers]
        samples.append((gpu_mib() - before_mib, sum(row[0] for row in of_managers), sum(row[2] for row in of_managers)))

    def some(values, shares):
        return ", ".join(f"{values[round(share * (len(values) - 1))]:.0f}" for share in shares) if values else "-"
    try:
        for number in range(1, cameras + 1):
            mappers.append(Mapper(bag, number, arguments, log))
            mappers[-1].wait_until_ready()  # roslaunch does not start twice at the same time
        player = subprocess.Popen(["rosbag", "play", "--quiet", "--wait-for-subscribers", "-r", str(rate), str(bag),
                                   *["--loop"] * bool(arguments.seconds)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        end = time.monotonic() + (arguments.seconds or math.inf)
        while player.poll() is None and time.monotonic() < end:
            sample()
            time.sleep(1)
        player.send_signal(signal.SIGINT)
        player.wait(20)
        count = -1
        while count != (count := sum(len(mapper.fast) + len(mapper.refined) for mapper in mappers)):
            time.sleep(3)  # also a round of diagnostics
        sample()
    finally:
        for mapper in mappers:
            mapper.stop()
    counts = [sum(int(mapper.values.get(key, 0)) for mapper in mappers) for key in COUNTS]
    latencies = [sorted(sum(lists, [])) for lists in zip(*((mapper.fast, mapper.refined) for mapper in mappers))]
    return [bag.stem, cameras, f"{rate:g}", sum(len(mapper.images) for mapper in mappers), *counts,
            *(some(values, (0.5, 0.95, 1)) for values in latencies),
            *(some(values, (0, 0.2, 0.4, 0.6, 0.8, 1)) for values in zip(*samples))]


def main():
    arguments = parse_arguments()
    master = start_master()
    try:
        rospy.init_node("gpu_nodelets", disable_signals=True)
        rows = [COLUMNS, ["---"] * len(COLUMNS)]
        with tempfile.TemporaryFile("w+") as log:
            for what in itertools.product(arguments.bags, arguments.cameras, arguments.rates):
                rows.append(measure(arguments, log, *what))
            log.seek(0)
            print(*sorted({line.strip()[:300] for line in log if "ERROR" in line or "WARN" in line or "died" in line}), sep="\n")
    finally:
        master.terminate()
        master.wait()
    for row in rows:
        print("|", " | ".join(map(str, row)), "|")


if __name__ == "__main__":
    main()
