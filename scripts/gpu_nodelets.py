#!/usr/bin/env python3
"""Plays recordings to the nodelets as launched for their frontends and prints a table of their diagnostics. See gpu_nodelets.sh.
Without a GPU:

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

# Of the diagnostics of a mapper.
VALUES = ("images", "keyframes", "fast depth maps", "withdrawn from the map, since poses contradict the images",
          "latency of fast depth maps [ms]", "latency of refined depth maps [ms]")
COLUMNS = ("recording", "rate", "mapper", *VALUES, "of all mappers, over time: GPU memory [MiB]", "memory [MiB]", "threads")


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
    """A mapper as launched for its frontend, and what its diagnostics say."""

    def __init__(self, bag, number, arguments, log):
        self.name, self.values = f"/acmp_{number}", {}
        with rosbag.Bag(str(bag)) as reader:
            topics = {info.msg_type: topic for topic, info in reader.get_type_and_topic_info().topics.items()}
        camera_info, image = (topics[f"sensor_msgs/{kind}"] for kind in ("CameraInfo", "CompressedImage"))
        maps = [f"{self.name}/{maps}/camera_info" for maps in ("depth_fast", "depth")]  # published for subscribers only
        self.subscribers = [*(rospy.Subscriber(topic, CameraInfo, lambda _: None) for topic in maps),
                            rospy.Subscriber("/diagnostics", DiagnosticArray, self.on_diagnostics)]
        others = [] if number == 1 else ["map:=false", "keyframe_points:=/acmp_1/keyframe_points"]
        self.launch = subprocess.Popen(
            ["roslaunch", "acmp_mapping", f"{bag.stem}.launch", f"namespace:={self.name[1:]}", "preset:=balanced", "device:=cuda",
             f"image:={image[:-len('/compressed')]}", "image_transport:=compressed", f"camera_info:={camera_info}", *others,
             *arguments.set], stdout=log, stderr=subprocess.STDOUT)

    def wait_until_ready(self):
        wait_for(lambda: self.values.get("device") or self.launch.poll() is not None, "the device")
        manager = rosgraph.Master("/gpu_nodelets").lookupNode(f"{self.name}/manager")
        self.pid = ServerProxy(manager).getPid("/gpu_nodelets")[2]

    def on_diagnostics(self, message):
        for status in message.status:
            if status.name.strip("/").startswith(f"{self.name[1:]}/dense_mapper"):
                self.values.update((value.key, value.value) for value in status.values)

    def stop(self):
        for subscriber in self.subscribers:
            subscriber.unregister()
        self.launch.send_signal(signal.SIGINT)
        self.launch.wait(60)


def measure(arguments, log, bag, cameras, rate):
    """Rows of the table. Samples once a second: memory of the GPU and of the managers [MiB], the managers' threads."""
    before_mib, mappers, samples = gpu_mib(), [], []

    def sample():
        of_managers = [nodelet_session.sample(mapper.pid) for mapper in mappers]
        samples.append((gpu_mib() - before_mib, sum(row[0] for row in of_managers), sum(row[2] for row in of_managers)))
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
        accounts = None
        while accounts != (accounts := [mapper.values.get("images") for mapper in mappers]):
            time.sleep(3)  # also a round of diagnostics
        sample()
    finally:
        for mapper in mappers:
            mapper.stop()
    over_time = [", ".join(f"{column[round(share * (len(column) - 1))]:.0f}" for share in (0, 0.2, 0.4, 0.6, 0.8, 1))
                 for column in zip(*samples)]
    return [[bag.stem, f"{rate:g}", mapper.name, *(mapper.values.get(key, "-") for key in VALUES), *over_time] for mapper in mappers]


def main():
    arguments = parse_arguments()
    master = start_master()
    try:
        rospy.init_node("gpu_nodelets", disable_signals=True)
        rows = [COLUMNS, ["---"] * len(COLUMNS)]
        with tempfile.TemporaryFile("w+") as log:
            for what in itertools.product(arguments.bags, arguments.cameras, arguments.rates):
                rows += measure(arguments, log, *what)
            log.seek(0)
            print(*sorted({line.strip()[:300] for line in log if "ERROR" in line or "WARN" in line or "died" in line}), sep="\n")
    finally:
        master.terminate()
        master.wait()
    for row in rows:
        print("|", " | ".join(map(str, row)), "|")


if __name__ == "__main__":
    main()
