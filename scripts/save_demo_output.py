#!/usr/bin/python3
"""Plays a bag through demo.launch, under a ROS master of its own, and saves what the mapper publishes: depth maps (PFM),
pictures (PNG), the map and its mesh (PLY). Files are numbered by the position of their image in the bag. Exits with 1 when the
mapper gave no map."""
import argparse
import collections
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import PIL.Image
import rosbag
import rospy
from acmp_mapping.srv import SaveMap, SaveMapRequest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from nodelet_session import TOPICS, end_all, start_master, wait_for

OUTPUTS = {"depth/image_rect": ("depth", "depth/%06d.pfm"), "depth_fast/image_rect": ("depth_fast", "depth_fast/%06d.pfm"),
           "rgb/image_rect_color": ("image pictures", "pictures/%06d_image.png"),
           "depth/image_vis": ("depth pictures", "pictures/%06d_depth.png"),
           "normal/image_vis": ("normals pictures", "pictures/%06d_normals.png"),
           "confidence/image_vis": ("confidence pictures", "pictures/%06d_confidence.png")}
PATIENCE_S = 120  # without an image or a map: those that are still missing were lost


class Saver:
    """Writes each message as it comes."""

    def __init__(self, bag, folder):
        with rosbag.Bag(bag) as recorded:
            stamps = [message.header.stamp for _, message, _ in recorded.read_messages(["/camera/image_raw"])]
        self.numbers = {stamp: number for number, stamp in enumerate(stamps)}
        self.counts, self.last, self.status = collections.Counter(), time.monotonic(), {}
        rospy.Subscriber("/diagnostics", DiagnosticArray, self.note)
        for topic, (kind, name) in OUTPUTS.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            rospy.Subscriber(f"/acmp/{topic}", Image, self.save, (kind, str(path)))

    def save(self, image, where):
        kind, path = where
        path %= self.numbers[image.header.stamp]
        if path.endswith(".pfm"):  # little endian, bottom row first
            rows = np.frombuffer(image.data, "<f4").reshape(image.height, image.width)[::-1]
            Path(path).write_bytes(b"Pf\n%d %d\n-1.0\n" % (image.width, image.height) + rows.tobytes())
        else:
            PIL.Image.frombytes("RGB", (image.width, image.height), image.data).save(path)
        self.counts[kind] += 1
        self.last = time.monotonic()

    def note(self, message):
        before = self.status.get("images")
        self.status.update({value.key: value.value for part in message.status if part.name.endswith(("mapping", "matching"))
                            for value in part.values})
        if self.status.get("images") != before:
            self.last = time.monotonic()

    def has_all_images(self):
        account = self.status.get("images", "0 received")
        received = int(account.split()[0])
        if 0 < received < len(self.numbers) and time.monotonic() > self.last + PATIENCE_S:
            raise RuntimeError(f"of {len(self.numbers)} images the mapper has {account}; nothing has come for {PATIENCE_S} s")
        # The pose of the last one may be on its way, or there is none.
        is_settled = self.status.get("images waiting for a pose") == "0" or time.monotonic() > self.last + 5
        return received >= len(self.numbers) and is_settled


def call(name, kind, *arguments):
    rospy.wait_for_service(f"/acmp/{name}")
    answer = rospy.ServiceProxy(f"/acmp/{name}", kind)(*arguments)
    if not answer.success:
        raise RuntimeError(f"/acmp/{name}: {answer.message}")
    return answer


def save_all(bag, folder, timeout_s):
    rospy.init_node("save_demo_output", argv=[], disable_rostime=True)  # the player's clock stops at the end of the bag
    saver = Saver(bag, folder)
    wait_for(saver.has_all_images, "all images", timeout_s)
    call("dense_mapper/flush", Trigger)
    wait_for(lambda: time.monotonic() > saver.last + 1.5, "the last messages")  # diagnostics come once a second
    saved = call("map_server/save_map", SaveMap, f"{folder}/map.ply", SaveMapRequest.PLY, True)
    print(f"matched on {saver.status.get('device')} at {saver.status.get('matched size [px]')} px; the last keyframe:")
    print(*(f"  {key} {value}" for key, value in sorted(saver.status.items()) if key.endswith("[ms]")), sep="\n")
    received = ", ".join(f"{count} {kind}" for kind, count in sorted(saver.counts.items()))
    print(f"{len(saver.numbers)} images played; received: {received}")
    print(f"map: {saved.points} points of {saved.keyframes} keyframes in {folder}/map.ply")
    try:
        call("map_server/save_map", SaveMap, f"{folder}/mesh.ply", SaveMapRequest.MESH_PLY, True)
    except RuntimeError as error:
        print(f"no mesh: {error}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag", type=Path)
    parser.add_argument("folder", type=Path, help="also of roslaunch.log")
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT:=VALUE", help="of demo.launch")
    parser.add_argument("--timeout", type=int, default=1800, help="seconds for everything")
    options = parser.parse_intermixed_args()
    bag, folder, shows = options.bag.absolute(), options.folder.absolute(), "rviz:=true" in options.arguments

    def give_up(number, _):
        raise RuntimeError("roslaunch has ended" if number == signal.SIGCHLD else f"not done after {options.timeout} s")
    topics = " ".join(TOPICS.values())
    processes = [start_master()]
    for number in (signal.SIGALRM, signal.SIGCHLD):
        signal.signal(number, give_up)
    signal.alarm(options.timeout)
    try:
        (folder / "roslaunch.log").write_text("")
        with open(folder / "roslaunch.log", "a") as log:  # nodes of Debian 13 open it anew: each line goes to its end
            processes.append(subprocess.Popen(
                ["roslaunch", "acmp_mapping", "demo.launch", f"bag:={bag}", f"save_folder:={folder}", *options.arguments,
                 # Alive, as a player that ends at once takes with it what has not been sent by then.
                 f"play_args:=--wait-for-subscribers --keep-alive --quiet --topics {topics}"], stdin=subprocess.DEVNULL,
                stdout=log, stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"}))  # in the order of what happened
        save_all(bag, folder, options.timeout)
        signal.alarm(0)
        if shows and sys.stdin.isatty():
            input("rviz shows the map; press Enter to go on ")
    except (OSError, RuntimeError, rosbag.ROSBagException, rospy.ROSException, rospy.ServiceException) as error:
        print(*(folder / "roslaunch.log").read_text().splitlines()[-30:], sep="\n", file=sys.stderr)
        sys.exit(f"save_demo_output: {error}")
    finally:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        end_all(processes)


if __name__ == "__main__":
    main()
