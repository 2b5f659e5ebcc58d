#!/usr/bin/env python3
"""Plays recordings to the nodelets as launched for their frontends. One table: what came in and out, after how long, and the
GPU's and the host's memory and threads over time. gpu_nodelets.sh brings it to a GPU machine.

    source scripts/ros_environment.sh build; scripts/gpu_nodelets.py --device cpu ov2slam.bag    # for ov2slam.launch
"""
import argparse
import shutil
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

import replay_report
import soak

SHOWN = 6  # values of a series in the table


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bags", type=Path, nargs="+", help="recordings with compressed images, named as launch files")
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--presets", nargs="+", default=["balanced"])
    parser.add_argument("--rates", type=float, nargs="+", default=[1], help="times real time")
    parser.add_argument("--cameras", type=int, nargs="+", default=[1], help="mappers at once, each with all images, one map")
    parser.add_argument("--seconds", type=float, default=0, help="plays the recording again and again for so long")
    parser.add_argument("--set", nargs="*", default=[], metavar="ARGUMENT:=VALUE", help="arguments of the launch file")
    return parser.parse_args()


def gpu_mib():
    """Memory in use on all GPUs."""
    if not shutil.which("nvidia-smi"):
        return 0
    query = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    return sum(map(int, subprocess.run(query, check=True, stdout=subprocess.PIPE, text=True).stdout.split()))


class Mapper:
    """A frontend's launch file, and when images and maps of each stamp came here. Times that start again begin a run."""

    def __init__(self, bag, number, arguments, preset, log):
        self.namespace = f"/acmp_{number}"
        self.run, self.newest, self.images, self.fast, self.refined, self.values = 0, 0, {}, {}, {}, {}
        with rosbag.Bag(str(bag)) as reader:
            topics = {info.msg_type: topic for topic, info in reader.get_type_and_topic_info().topics.items()}
        others = [] if number == 1 else ["map:=false", "keyframe_points:=/acmp_1/keyframe_points"]
        camera_info, image = (topics[f"sensor_msgs/{kind}"] for kind in ("CameraInfo", "CompressedImage"))
        self.subscribers = [
            rospy.Subscriber(camera_info, CameraInfo, self.on_image),
            rospy.Subscriber(f"{self.namespace}/depth_fast/camera_info", CameraInfo, self.on_map, self.fast),
            rospy.Subscriber(f"{self.namespace}/depth/camera_info", CameraInfo, self.on_map, self.refined),
            rospy.Subscriber("/diagnostics", DiagnosticArray, self.on_diagnostics)]
        self.launch = subprocess.Popen(
            ["roslaunch", "acmp_mapping", f"{bag.stem}.launch", f"namespace:={self.namespace[1:]}", f"preset:={preset}",
             f"device:={arguments.device}", f"image:={image[:-len('/compressed')]}", "image_transport:=compressed",
             f"camera_info:={camera_info}", *others, *arguments.set], stdout=log, stderr=subprocess.STDOUT)

    def key(self, message):
        return self.run, message.header.stamp.to_nsec()

    def on_image(self, message):
        self.run += message.header.stamp.to_nsec() < self.newest
        self.newest = message.header.stamp.to_nsec()
        self.images[self.key(message)] = time.monotonic()

    def on_map(self, message, times):
        times.setdefault(self.key(message), time.monotonic())

    def on_diagnostics(self, message):
        for status in message.status:
            if self.namespace[1:] in status.name:
                self.values.update((value.key, value.value) for value in status.values)

    def wait_until_ready(self):
        replay_report.wait_for(lambda: self.values.get("device") or self.launch.poll() is not None, "the device")
        self.lookahead = rospy.get_param(f"{self.namespace}/dense_mapper/lookahead")
        manager = rosgraph.Master("/gpu_nodelets").lookupNode(f"{self.namespace}/manager")
        self.pid = ServerProxy(manager).getPid("/gpu_nodelets")[2]

    def latencies_ms(self):
        """Of first maps after their image, and of refined ones after the last image that they wait for."""
        fast = [self.fast[key] - self.images[key] for key in self.fast if key in self.images]
        keyframes = sorted(key for key in self.fast if key in self.images)
        refined = [self.refined[key] - self.images[last] for key, last in zip(keyframes, keyframes[self.lookahead:])
                   if key in self.refined and key[0] == last[0]]
        return [1e3 * value for value in fast], [1e3 * max(0, value) for value in refined]

    def stop(self):
        for subscriber in self.subscribers:
            subscriber.unregister()
        self.launch.send_signal(signal.SIGINT)
        self.launch.wait(60)


def shares(values):
    """Median, 95 % and greatest."""
    values = sorted(values)
    return " / ".join(f"{values[min(len(values) - 1, int(q * len(values)))]:.0f}" for q in (0.5, 0.95, 1)) if values else "-"


def series(values):
    steps = sorted({round(i * (len(values) - 1) / (SHOWN - 1)) for i in range(SHOWN)})
    return ", ".join(f"{values[i]:.0f}" for i in steps)


def play(bag, rate, mappers, seconds, before_mib):
    """Samples once a second: memory of the GPU and of the managers [MiB], and the managers' threads."""
    samples = []

    def sample():
        of_managers = [soak.sample(mapper.pid) for mapper in mappers]
        samples.append((gpu_mib() - before_mib, sum(row[0] for row in of_managers), sum(row[2] for row in of_managers)))
    begin = time.monotonic()
    player = subprocess.Popen(["rosbag", "play", "--quiet", "--wait-for-subscribers", "-r", str(rate), *["--loop"] * bool(seconds),
                               str(bag)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    while player.poll() is None and (not seconds or time.monotonic() < begin + seconds):
        sample()
        time.sleep(1)
    if player.poll() is None:
        player.send_signal(signal.SIGINT)
        player.wait(20)
    count = -1
    while count != (count := sum(len(mapper.fast) + len(mapper.refined) for mapper in mappers)):
        time.sleep(3)
    sample()
    return list(zip(*samples))


def measure(arguments, bag, preset, rate, cameras, log):
    before_mib = gpu_mib()
    mappers = []
    try:
        for number in range(1, cameras + 1):
            mappers.append(Mapper(bag, number, arguments, preset, log))
        for mapper in mappers:
            mapper.wait_until_ready()
        gpu, memory, threads = play(bag, rate, mappers, arguments.seconds, before_mib)
        time.sleep(2.5)  # a round of diagnostics
    finally:
        for mapper in mappers:
            mapper.stop()

    def total(key):
        return sum(int(mapper.values.get(key, 0)) for mapper in mappers)
    fast, refined = (sum(lists, []) for lists in zip(*(mapper.latencies_ms() for mapper in mappers)))
    print(f"| {bag.stem} | {preset} | {rate:g} | {cameras} | {sum(len(mapper.images) for mapper in mappers)} | {total('keyframes')} "
          f"| {total('fast depth maps')} | {total('refined depth maps')} "
          f"| {total('withdrawn from the map, since poses contradict the images')} | {shares(fast)} | {shares(refined)} "
          f"| {series(gpu)} | {series(memory)} | {series(threads)} |", flush=True)


def main():
    arguments = parse_arguments()
    master = replay_report.start_master()
    try:
        rospy.init_node("gpu_nodelets", disable_signals=True)
        print("| recording | preset | rate | cameras | images | keyframes | first maps | refined maps | withdrawn | first map after "
              "its image: median / 95 % / most [ms] | refined map after the last image that it waits for [ms] | GPU memory over "
              "time [MiB] | memory of the nodelets [MiB] | threads |\n|" + "---|" * 14)
        with tempfile.TemporaryFile("w+") as log:
            for bag in arguments.bags:
                for preset in arguments.presets:
                    for cameras in arguments.cameras:
                        for rate in arguments.rates:
                            measure(arguments, bag, preset, rate, cameras, log)
            log.seek(0)
            print(*sorted({line.strip()[:300] for line in log if "ERROR" in line or "WARN" in line or "died" in line}), sep="\n")
    finally:
        master.terminate()
        master.wait()


if __name__ == "__main__":
    main()
