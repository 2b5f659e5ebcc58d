#!/usr/bin/python3
"""Saves what the mapper publishes while a bag is played to it: depth maps (PFM), pictures (PNG), the map and its mesh (PLY).

usage: save_demo_output.py BAG OUT_FOLDER [--image TOPIC] [--namespace NS] [--timeout SECONDS]

Files are numbered by the position of their image in the bag. Waits for the bag's player to end, has the mapper finish
(~flush) and save its map (~save_map), which says why where there is no mesh. Needs nothing but
PIL, rospy and rosbag. Exits with 1 when the mapper gave no map."""
import argparse
import os
import sys
import threading
import time

import PIL.Image
import rosbag
import rosgraph
import rospy
from acmp_mapping.srv import SaveMap, SaveMapRequest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

PICTURES = {"image": "rgb/image_rect_color", "depth": "depth/image_vis", "normals": "normal/image_vis",
            "confidence": "confidence/image_vis"}
DEPTHS = {"depth": "depth/image_rect", "depth_fast": "depth_fast/image_rect"}


def write_pfm(path, image):
    """32FC1 to PFM: little endian, bottom row first."""
    if image.encoding != "32FC1" or image.is_bigendian:
        raise ValueError("encoding %s: must be 32FC1, little endian" % image.encoding)
    rows = [image.data[row * image.step:row * image.step + 4 * image.width] for row in range(image.height)]
    with open(path, "wb") as file:
        file.write(b"Pf\n%d %d\n-1.0\n" % (image.width, image.height))
        file.writelines(reversed(rows))


def write_png(path, image):
    if image.encoding != "rgb8":
        raise ValueError("encoding %s: must be rgb8" % image.encoding)
    PIL.Image.frombuffer("RGB", (image.width, image.height), image.data, "raw", "RGB", image.step, 1).save(path)


class Saver:
    """Writes each message as it comes; knows the number of every stamp."""

    def __init__(self, stamps, folder, namespace):
        self.numbers = {stamp.to_nsec(): number for number, stamp in enumerate(stamps)}
        self.counts = {}
        self.last_progress = time.monotonic()
        self.status = {}  # the mapper's last diagnostics by key
        self.lock = threading.Lock()
        self.subscribers = [rospy.Subscriber("/diagnostics", DiagnosticArray, self.note_status)]
        for kind, topic in DEPTHS.items():
            self.subscribe(namespace + "/" + topic, os.path.join(folder, kind), "%06d.pfm", write_pfm, kind)
        for kind, topic in PICTURES.items():
            self.subscribe(namespace + "/" + topic, os.path.join(folder, "pictures"), "%06d_" + kind + ".png", write_png,
                           kind + " pictures")

    def subscribe(self, topic, folder, name, write, kind):
        os.makedirs(folder, exist_ok=True)

        def save(image):
            number = self.numbers.get(image.header.stamp.to_nsec())
            if number is None:
                rospy.logerr("%s: stamp %s is no image of the bag", topic, image.header.stamp)
                return
            write(os.path.join(folder, name % number), image)
            with self.lock:
                self.counts[kind] = self.counts.get(kind, 0) + 1
                self.last_progress = time.monotonic()

        self.subscribers.append(rospy.Subscriber(topic, Image, save))

    def note_status(self, message):
        status = {value.key: value.value for part in message.status if part.name.endswith("mapping")
                  for value in part.values}
        if not status:  # the map server's
            return
        with self.lock:
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


def is_running(node):
    try:
        rosgraph.Master("/save_demo_output").lookupNode(node)
        return True
    except rosgraph.MasterException:
        return False


def call(name, kind, deadline, *arguments):
    rospy.wait_for_service(name, max(0.1, deadline - time.monotonic()))
    answer = rospy.ServiceProxy(name, kind)(*arguments)
    if not answer.success:
        raise RuntimeError("%s: %s" % (name, answer.message))
    return answer


def rounded(value):
    """A number without decimals; text, as latencies have it, as it is."""
    try:
        return "%.0f" % float(value)
    except ValueError:
        return value


def run(arguments):
    deadline = time.monotonic() + arguments.timeout
    with rosbag.Bag(arguments.bag) as bag:
        stamps = [message.header.stamp for _, message, _ in bag.read_messages(topics=[arguments.image])]
    wait_for("ROS master", rosgraph.is_master_online, deadline)
    rospy.init_node("save_demo_output", disable_rostime=True)  # the player's clock stops at the end of the bag
    saver = Saver(stamps, arguments.folder, arguments.namespace)
    wait_for("player of the bag", lambda: is_running(arguments.player), deadline)
    wait_for("end of the bag", lambda: not is_running(arguments.player), deadline)
    # Most of the bag now waits in the mapper's queues, which ~flush does not know. Images that never become keyframes
    # (no pose, passed over by the gate) are given up after a while without progress.
    wait_for("end of the keyframes", lambda: saver.keyframes() >= len(stamps) or saver.idle(arguments.patience), deadline)
    mapper = arguments.namespace + "/dense_mapper"
    call(mapper + "/flush", Trigger, deadline)
    wait_for("last messages", lambda: saver.idle(1.5), deadline)  # and diagnostics come at 1 Hz
    save_map = arguments.namespace + "/map_server/save_map"
    map_path, mesh_path = (os.path.join(os.path.abspath(arguments.folder), name) for name in ("map.ply", "mesh.ply"))
    saved = call(save_map, SaveMap, deadline, map_path, SaveMapRequest.PLY, True)
    print("matched on %s at %s px; the last keyframe:" % (saver.status.get("device"), saver.status.get("matched size [px]")))
    for key, value in sorted(saver.status.items()):
        if key.endswith("[ms]"):
            print("  %s %s" % (key, rounded(value)))
    print("%d images played; received: %s" % (len(stamps), ", ".join(
        "%d %s" % (count, kind) for kind, count in sorted(saver.counts.items()))))
    print("map: %d points of %d keyframes in %s" % (saved.points, saved.keyframes, map_path))
    try:
        call(save_map, SaveMap, deadline, mesh_path, SaveMapRequest.MESH_PLY, True)
    except RuntimeError as error:
        print("no mesh: %s" % error)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag")
    parser.add_argument("folder")
    parser.add_argument("--image", default="/camera/image_raw", help="image topic in the bag")
    parser.add_argument("--namespace", default="/acmp", help="of the mapper's topics")
    parser.add_argument("--player", default="/player", help="node that plays the bag")
    parser.add_argument("--patience", type=float, default=60, help="seconds without a new keyframe that mean the end")
    parser.add_argument("--timeout", type=float, default=1800, help="seconds for everything")
    try:
        run(parser.parse_args(rospy.myargv()[1:]))
    except (OSError, RuntimeError, ValueError, rosbag.ROSBagException, rospy.ROSException,
            rospy.ServiceException) as error:
        print("save_demo_output: %s" % error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
