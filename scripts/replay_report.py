#!/usr/bin/env python3
"""Plays a bag through the mapper at several rates and with each overload policy and prints what became of every image, the
latencies and the memory, as a table. Fails if an image is not accounted for.

    source scripts/ros_environment.sh build; scripts/replay_report.py build recording.bag --rates 1 5 20
    scripts/replay_report.py build recording.bag --rates 20 --policies block --loops 50     # is memory flat?
"""
import argparse
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

ACCOUNT = re.compile(r"(\d+) received = (\d+) refined \+ (\d+) dropped \+ (\d+) passed over \+ (-?\d+) under way")
LATENCY = re.compile(r"median ([\d.e+]+), 99 % ([\d.e+]+)")


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=Path, help="build folder")
    parser.add_argument("bag", type=Path)
    parser.add_argument("--rates", type=float, nargs="+", default=[1, 5, 20], help="times real time")
    parser.add_argument("--policies", nargs="+", default=["drop", "skip_if_busy", "block"])
    parser.add_argument("--loops", type=int, default=1, help="how often the bag is played to each mapper")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="parameters of the mapper")
    parser.add_argument("--remap", nargs="*", metavar="NAME:=TOPIC", default=[
        "image:=/camera/image_raw", "camera_info:=/camera/camera_info", "pose:=/slam/pose",
        "sparse_points:=/slam/sparse_points"])
    return parser.parse_args()


def start_master(port=None):
    """A ROS master of its own, by default on a free port: one that runs already is left alone."""
    if port is None:
        with socket.socket() as free:
            free.bind(("", 0))
            port = free.getsockname()[1]
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
    master = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL)
    wait_for(lambda: rosgraph.is_master_online(), "the master")
    return master


def wait_for(condition, what, timeout_s=120.0):
    end = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"waited {timeout_s:.0f} s for {what}")
        time.sleep(0.05)


class Diagnostics:
    """The latest values of the mapper's diagnostics, and how often they came."""

    def __init__(self):
        self.values = {}
        self.count = 0
        rospy.Subscriber("/diagnostics", DiagnosticArray, self.receive)

    def receive(self, message):
        for status in message.status:
            self.values.update((value.key, value.value) for value in status.values)
        self.count += 1

    def next(self):
        """Values of a whole round that began after this call."""
        seen = self.count
        wait_for(lambda: self.count >= seen + 2, "diagnostics")
        return dict(self.values)


class Mapper:
    def __init__(self, arguments, policy):
        program = arguments.build / "devel/lib/acmp_mapping/dense_mapper_node"
        parameters = [f"_{name}" for name in (setting.replace("=", ":=", 1) for setting in arguments.set)]
        subprocess.run(["rosparam", "delete", "/dense_mapper"], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        self.process = subprocess.Popen([program, "__name:=dense_mapper", f"_overload:={policy}", *parameters,
                                         *arguments.remap], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        rospy.wait_for_service("/dense_mapper/flush", 60)

    def flush(self):
        answer = rospy.ServiceProxy("/dense_mapper/flush", Trigger)()
        if not answer.success:
            sys.exit(f"flush: {answer.message}")

    def resident_mib(self):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+) kB", status).group(1)) / 1024

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        if self.process.wait(60) != 0:
            sys.exit(f"the mapper ended with {self.process.returncode}")


def play(arguments, rate):
    start = time.monotonic()
    subprocess.run(["rosbag", "play", "--quiet", "--wait-for-subscribers", "-r", str(rate), str(arguments.bag),
                    "--topics", *(remap.split(":=")[1] for remap in arguments.remap)],
                   check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    return time.monotonic() - start


def settle(diagnostics):
    """Waits until no image comes any more (with overload: block they wait in front of the mapper)."""
    account = None
    for _ in range(600):
        now = ACCOUNT.match(diagnostics.next()["images"]).groups()
        if now == account:
            return
        account = now
    sys.exit(f"images still come: {account}")


def main():
    arguments = parse_arguments()
    master = start_master()
    failed = False
    try:
        rospy.init_node("replay_report", disable_signals=True)
        diagnostics = Diagnostics()
        print("| policy | rate | played [s] | received | refined | dropped | passed over | under way | fast: median, 99 % [ms] "
              "| refined: median, 99 % [ms] | memory after each loop [MiB] |")
        print("|---|---|---|---|---|---|---|---|---|---|---|")
        for policy in arguments.policies:
            for rate in arguments.rates:
                failed |= not run(arguments, policy, rate, diagnostics)
    finally:
        master.terminate()
        master.wait()
    sys.exit("images are not accounted for" if failed else 0)


def run(arguments, policy, rate, diagnostics):
    mapper = Mapper(arguments, policy)
    played_s = 0
    memory = []
    try:
        for _ in range(arguments.loops):
            played_s += play(arguments, rate)
            settle(diagnostics)
            mapper.flush()
            memory.append(mapper.resident_mib())
        values = diagnostics.next()
    finally:
        mapper.stop()
    counts = ACCOUNT.match(values["images"]).groups()
    latencies = []
    for stage in ("fast", "refined"):
        found = LATENCY.match(values[f"latency of {stage} depth maps [ms]"])
        latencies.append(", ".join(f"{float(value):.0f}" for value in found.groups()) if found else "-")
    shown = memory if len(memory) < 8 else memory[:2] + memory[len(memory) // 2:len(memory) // 2 + 1] + memory[-2:]
    print(f"| {policy} | {rate:g} | {played_s:.1f} | {' | '.join(counts)} | {' | '.join(latencies)} "
          f"| {', '.join(f'{value:.0f}' for value in shown)} |", flush=True)
    # Images that wait for a pose that never comes stay under way: the bag has ended with them.
    return int(counts[4]) == int(values["images waiting for a pose"])


if __name__ == "__main__":
    main()
