#!/usr/bin/env python3
"""Plays recordings to the nodelets as launched for their frontends and prints a table: of their diagnostics, and when maps came after
the image that they wait for (first maps: their own; refined ones: LOOKAHEAD keyframes later). See gpu_nodelets.sh.
Without a GPU:

    source scripts/ros_environment.sh build; scripts/gpu_nodelets.py ov2slam.bag --set device:=cpu    # launches ov2slam.launch
"""
import argparse
import itertools
import math
import os
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
COLUMNS = ("recording", "rate", "mapper", *VALUES, "first, refined maps", "after their image: median / 95 % / greatest [ms]: first",
           "refined", "of all mappers: cores", "over time: GPU [%]", "GPU memory [MiB]", "memory [MiB]", "threads")
LOOKAHEAD = 2  # its default


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bags", type=Path, nargs="+", help="recordings with compressed images, named as launch files")
    parser.add_argument("--rates", type=float, nargs="+", default=[1], help="times real time")
    parser.add_argument("--cameras", type=int, nargs="+", default=[1], help="mappers at once, each with all images, one map")
    parser.add_argument("--seconds", type=float, default=0, help="plays the recording again and again for so long")
    parser.add_argument("--set", nargs="*", default=[], metavar="ARGUMENT:=VALUE", help="arguments of the launch file")
    return parser.parse_args()


def gpu_use():
    """Kernels [% of the time], memory in use [MiB], summed over all GPUs; 0 without nvidia-smi."""
    query = "nvidia-smi --query-gpu=utilization.gpu,memory.used --format=csv,noheader,nounits || true"
    rows = subprocess.run(query, shell=True, capture_output=True, text=True, check=True).stdout.splitlines()
    return [sum(column) for column in zip(*([int(value) for value in row.split(",")] for row in rows))] or [0, 0]


def cpu_seconds(pid):
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def quantiles(times):
    """Of seconds, as text in ms."""
    ordered = sorted(times)
    return " / ".join(f"{1e3 * ordered[round(share * (len(ordered) - 1))]:.0f}" for share in (0.5, 0.95, 1)) if ordered else "-"


class Mapper:
    """A mapper as launched for its frontend, and what its diagnostics say."""

    def __init__(self, bag, number, arguments, log):
        self.name, self.values, self.images, self.first, self.refined = f"/acmp_{number}", {}, {}, {}, {}
        with rosbag.Bag(str(bag)) as reader:
            topics = {info.msg_type: topic for topic, info in reader.get_type_and_topic_info().topics.items()}
        camera_info, image = (topics[f"sensor_msgs/{kind}"] for kind in ("CameraInfo", "CompressedImage"))
        comes = {camera_info: self.images, f"{self.name}/depth_fast/camera_info": self.first, f"{self.name}/depth/camera_info": self.refined}
        self.subscribers = [*(rospy.Subscriber(topic, CameraInfo, self.note, times, tcp_nodelay=True) for topic, times in comes.items()),
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

    @staticmethod
    def note(message, times):
        times.setdefault(message.header.stamp.to_nsec(), time.monotonic())

    def latencies(self):
        """Text: maps, and after which time they came."""
        keyframes = sorted({*self.first, *self.refined})
        awaited = dict(zip(keyframes, [*keyframes[LOOKAHEAD:], *keyframes[-1:] * LOOKAHEAD]))
        first = [come - self.images[stamp] for stamp, come in self.first.items() if stamp in self.images]
        refined = [come - self.images[awaited[stamp]] for stamp, come in self.refined.items() if awaited[stamp] in self.images]
        return f"{len(self.first)}, {len(self.refined)}", quantiles(first), quantiles(refined)

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
    """Rows of the table. Samples: use and memory of the GPU [%, MiB], the managers' memory [MiB] and threads."""
    (_, before_mib), mappers, samples = gpu_use(), [], []

    def sample():
        of_managers = [nodelet_session.sample(mapper.pid) for mapper in mappers]
        percent, mib = gpu_use()
        samples.append((percent, mib - before_mib, sum(row[0] for row in of_managers), sum(row[2] for row in of_managers)))

    def spent():
        return time.monotonic(), sum(cpu_seconds(mapper.pid) for mapper in mappers)
    try:
        for number in range(1, cameras + 1):
            mappers.append(Mapper(bag, number, arguments, log))
            mappers[-1].wait_until_ready()  # roslaunch does not start twice at the same time
        before = spent()
        player = subprocess.Popen(["rosbag", "play", "--quiet", "--wait-for-subscribers", "-r", str(rate), str(bag),
                                   *["--loop"] * bool(arguments.seconds)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        end = time.monotonic() + (arguments.seconds or math.inf)
        while player.poll() is None and time.monotonic() < end:
            sample()
            time.sleep(0.5)
        cores = (lambda now: (now[1] - before[1]) / (now[0] - before[0]))(spent())
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
    return [[bag.stem, f"{rate:g}", mapper.name, *(mapper.values.get(key, "-") for key in VALUES), *mapper.latencies(), f"{cores:.1f}",
             *over_time] for mapper in mappers]


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
