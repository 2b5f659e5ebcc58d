"""A nodelet manager with mapper and map under a ROS master of its own, for scripts and tests that put it to the test."""
import json
import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import rosbag
import rosgraph
import roslib.packages

TOPICS = {"image": "/camera/image_raw", "camera_info": "/camera/camera_info", "pose": "/slam/pose",
          "sparse_points": "/slam/sparse_points"}


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


def end_all(processes):
    """Ends them, the last first."""
    for process in reversed(processes):
        process.terminate()
        process.wait(60)


def call(service, *arguments):
    """The answer as text; empty while the service cannot be found or has failed."""
    result = subprocess.run(["rosservice", "call", service, *arguments], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, text=True, check=False)
    return result.stdout if result.returncode == 0 else ""


def save_map(path):
    """Points in the saved map; 0 and why when it is not saved."""
    answer = call("/map_server/save_map", f"{{path: {path}, format: 0, binary: true}}")
    return int(answer.split("points:")[1].split()[0]) if "success: True" in answer else 0, answer


def save_session(path):
    return call("/map_server/save_session", f"{{path: {path}}}")


def make_bag(path):
    subprocess.run(["acmp_make_bag", "--synthetic", path, "--width", "64", "--height", "48"], check=True,
                   stdout=subprocess.DEVNULL)
    return path


def sample(pid):
    """Memory [MiB], file handles and threads of a process."""
    status = Path(f"/proc/{pid}/status").read_text()
    resident, threads = (int(re.search(name + r":\s+(\d+)", status).group(1)) for name in ("VmRSS", "Threads"))
    return resident / 1024, len(os.listdir(f"/proc/{pid}/fd")), threads


def play_command(bag, *options, rate=20):
    return ["rosbag", "play", "--quiet", "--wait-for-subscribers", "-r", str(rate), *options, bag, "--topics",
            *TOPICS.values()]


def mapper_diagnostics():
    """Its next ones: key and value, of long ones the first line."""
    values = {}
    while "images" not in values:  # others publish theirs there, too
        echo = ["rostopic", "echo", "-n", "3", "/diagnostics"]
        told = subprocess.run(echo, stdout=subprocess.PIPE, text=True, check=True).stdout
        values = dict(re.findall(r'key: "(.*)"\s+value: "([^"\n]*)', told))
    return values


def image_counts():
    """How many images the mapper has received, and how many of them wait for their pose or cloud."""
    values = mapper_diagnostics()
    return int(values["images"].split()[0]), int(values["images waiting for a pose"])


class Session:
    """master, manager and both nodelets; the manager's output is folder/log, maps are saved below the folder."""

    def __init__(self, folder, map_parameters=(), mapper_parameters=(), global_parameters=()):
        self.folder, self.manager, self.master = Path(folder), None, start_master()
        try:
            parameters = {"/dense_mapper": {"device": "cpu", "overload": "block", "preset": "online", "sparse_wait": 10.0,
                                            **dict(mapper_parameters)},
                          "/map_server": {"save_folder": str(folder), **dict(map_parameters)}, "": dict(global_parameters)}
            for node, values in parameters.items():
                for name, value in values.items():
                    rosgraph.Master("/nodelet_session").setParam(f"{node}/{name}", value)
            with open(self.folder / "log", "w") as log:
                program = roslib.packages.find_node("nodelet", "nodelet")[0]  # under rosrun it would have another id
                self.manager = subprocess.Popen([program, "manager", "__name:=manager"], stdout=log,
                                                stderr=subprocess.STDOUT)
            for name, nodelet in (("/map_server", "MapServerNodelet"), ("/dense_mapper", "DenseMapperNodelet")):
                request = json.dumps({"name": name, "type": f"acmp_mapping/{nodelet}", "remap_target_args": list(TOPICS.values()),
                                      "remap_source_args": [f"/{topic}" for topic in TOPICS]})
                wait_for(lambda request=request: "success: True" in call("/manager/load_nodelet", request), name)
            wait_for(lambda: call("/dense_mapper/flush"), "the mapper")
        except BaseException:
            self.__exit__()
            raise

    def log(self):
        return (self.folder / "log").read_text()

    def map_bag(self, bag, *more_topics):
        """Plays the bag and returns the points of the map afterwards. more_topics: beside TOPICS; and "FROM:=TO"."""
        with rosbag.Bag(bag) as recorded:
            count = recorded.get_message_count(TOPICS["image"])
        before, waited = image_counts()

        def has_all():
            received, waiting = image_counts()
            return received >= before + count and waiting <= waited
        # A player that ends at once takes with it what has not been sent by then, on a busy machine.
        player = subprocess.Popen([*play_command(bag, "--keep-alive"), *more_topics], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            wait_for(has_all, "all images and their poses")
        finally:
            player.terminate()
            player.wait(60)
        path = self.folder / "map.ply"
        wait_for(lambda: "success: True" in call("/dense_mapper/flush") and save_map(path)[0] > 0, "a map")
        return save_map(path)[0]

    def alive(self):
        return self.manager.poll() is None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        end_all([process for process in (self.master, self.manager) if process])
