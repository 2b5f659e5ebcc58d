#!/usr/bin/python3
"""Saves what the mapper of demo.launch publishes while a bag is played to it: depth maps (PFM), pictures (PNG), the map and
its mesh (PLY). Files are numbered by the position of their image in the bag. Exits with 1 when the mapper gave no map."""
import argparse
import collections
import os
import sys
import time

import PIL.Image
import rosbag
import rosgraph
import rospy
from acmp_mapping.srv import SaveMap, SaveMapRequest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

NAMESPACE = "/acmp"
PICTURES = {"image": "rgb/image_rect_color", "depth": "depth/image_vis", "normals": "normal/image_vis",
            "confidence": "confidence/image_vis"}
DEPTHS = {"depth": "depth/image_rect", "depth_fast": "depth_fast/image_rect"}


def write_pfm(path, image):
    """32FC1, little endian, to PFM: bottom row first."""
    rows = [image.data[row * image.step:row * image.step + 4 * image.width] for row in range(image.height)]
    with open(path, "wb") as file:
        file.write(b"Pf\n%d %d\n-1.0\n" % (image.width, image.height))
        file.writelines(reversed(rows))


def write_png(path, image):
    PIL.Image.frombuffer("RGB", (image.width, image.height), image.data, "raw", "RGB", image.step, 1).save(path)


class Saver:
    """Writes each message as it comes; knows the number of every stamp."""

    def __init__(self, stamps, folder):
        self.numbers = {stamp.to_nsec(): number for number, stamp in enumerate(stamps)}
        self.counts = collections.Counter()
        self.last_progress = time.monotonic()
        self.status = {}  # the mapper's last diagnostics by key
        rospy.Subscriber("/diagnostics", DiagnosticArray, self.note_status)
        for kind, topic in DEPTHS.items():
            self.subscribe(topic, os.path.join(folder, kind), "%06d.pfm", write_pfm, kind)
        for kind, topic in PICTURES.items():
            self.subscribe(topic, os.path.join(folder, "pictures"), "%06d_" + kind + ".png", write_png, kind + " pictures")

    def subscribe(self, topic, folder, name, write, kind):
        os.makedirs(folder, exist_ok=True)

        def save(image):
            write(os.path.join(folder, name % self.numbers[image.header.stamp.to_nsec()]), image)
            self.counts[kind] += 1
            self.last_progress = time.monotonic()

        rospy.Subscriber(NAMESPACE + "/" + topic, Image, save)

    def note_status(self, message):
        status = {value.key: value.value for part in message.status if part.name.endswith("mapping")
                  for value in part.values}
        if not status:  # the map server's
            return
        if status.get("keyframes") != self.status.get("keyframes"):
            self.last_progress = time.monotonic()
        self.status = status

    def keyframes(self):
        return int(self.status.get("keyframes", 0))

    def idle(self, seconds):
        return time.monotonic() - self.last_progress > seconds


def wait_for(what, condition, deadline):
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("no %s in time" % what)
        time.sleep(0.1)


def is_played():
    try:
        rosgraph.Master("/save_demo_output").lookupNode("/player")
        return True
    except rosgraph.MasterException:
        return False


def call(name, kind, deadline, *arguments):
    name = NAMESPACE + "/" + name
    rospy.wait_for_service(name, max(0.1, deadline - time.monotonic()))
    answer = rospy.ServiceProxy(name, kind)(*arguments)
    if not answer.success:
        raise RuntimeError("%s: %s" % (name, answer.message))
    return answer


def run(arguments):
    deadline = time.monotonic() + arguments.timeout
    with rosbag.Bag(arguments.bag) as bag:
        stamps = [message.header.stamp for _, message, _ in bag.read_messages(topics=["/camera/image_raw"])]
    wait_for("ROS master", rosgraph.is_master_online, deadline)
    rospy.init_node("save_demo_output", disable_rostime=True)  # the player's clock stops at the end of the bag
    saver = Saver(stamps, arguments.folder)
    wait_for("player of the bag", is_played, deadline)
    wait_for("end of the bag", lambda: not is_played(), deadline)
    # Most of the bag now waits in the mapper's queues, which ~flush does not know. Images that never become keyframes
    # (no pose, passed over by the gate) are given up after a while without progress.
    wait_for("end of the keyframes", lambda: saver.keyframes() >= len(stamps) or saver.idle(arguments.patience), deadline)
    call("dense_mapper/flush", Trigger, deadline)
    wait_for("last messages", lambda: saver.idle(1.5), deadline)  # and diagnostics come at 1 Hz
    map_path, mesh_path = (os.path.join(os.path.abspath(arguments.folder), name) for name in ("map.ply", "mesh.ply"))
    saved = call("map_server/save_map", SaveMap, deadline, map_path, SaveMapRequest.PLY, True)
    print("matched on %s at %s px; the last keyframe:" % (saver.status.get("device"), saver.status.get("matched size [px]")))
    for key, value in sorted(saver.status.items()):
        if key.endswith("[ms]"):
            print("  %s %s" % (key, value))
    print("%d images played; received: %s" % (len(stamps), ", ".join(
        "%d %s" % (count, kind) for kind, count in sorted(saver.counts.items()))))
    print("map: %d points of %d keyframes in %s" % (saved.points, saved.keyframes, map_path))
    try:
        call("map_server/save_map", SaveMap, deadline, mesh_path, SaveMapRequest.MESH_PLY, True)
    except RuntimeError as error:
        print("no mesh: %s" % error)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag")
    parser.add_argument("folder")
    parser.add_argument("--patience", type=float, default=60, help="seconds without a new keyframe that mean the end")
    parser.add_argument("--timeout", type=float, default=1800, help="seconds for everything")
    try:
        run(parser.parse_args(rospy.myargv()[1:]))
    except (OSError, RuntimeError, rosbag.ROSBagException, rospy.ROSException, rospy.ServiceException) as error:
        print("save_demo_output: %s" % error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
