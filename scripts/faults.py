#!/usr/bin/env python3
"""Puts the nodelets to faults, each in a session of its own, and prints a table: fault, what was seen, ok or not. Fails when
one is not ok. "soak" maps for an hour: memory, file handles, threads and files must not go on growing.

    source scripts/ros_environment.sh $PWD/build; scripts/faults.py                  # all, 67 minutes
    scripts/faults.py "wild messages" soak --seconds 300 --minutes 10"""
import argparse
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from io import BytesIO
from pathlib import Path
from statistics import median

import genpy
import numpy as np
import PIL.Image
import rosbag
import rospy
from acmp_mapping.msg import KeyframePoints
from dynamic_reconfigure import DynamicReconfigureCallbackException, DynamicReconfigureParameterException
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseStamped, Transform, TransformStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as RosPath
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from nodelet_session import TOPICS, Session, call, image_counts, make_bag, mapper_diagnostics, sample, save_map, save_session, wait_for

PLY_BYTES_PER_POINT = 6 * 4 + 3 + 4
CHOICE = random.Random(1)


class Fault(Exception):
    """What must not be."""


def expect(condition, text):
    if not condition:
        raise Fault(text)


def check_ply(path):
    head, _, points = path.read_bytes().partition(b"end_header\n")
    count = int(re.search(rb"element vertex (\d+)", head).group(1))
    expect(len(points) == count * PLY_BYTES_PER_POINT, f"{path.name} is broken: {len(points)} bytes of {count} points")


def check_session(path):
    with rosbag.Bag(str(path)) as bag:
        counts = {next(bag.read_messages(["/session_keyframes"])).message.data,
                  *map(bag.get_message_count, ("/keyframe_points", "/depth/image_rect"))}
        expect(len(counts) == 1, f"{path.name} is broken")


def kill_in_save(name, save, check, options):
    """The file is the one of before or the new one, and what is left over is used by the next save."""
    caught = 0
    with tempfile.TemporaryDirectory() as folder:
        bag, path = make_bag(f"{folder}/room.bag"), Path(folder, name)

        def temporary():
            return list(Path(folder).glob("*.partial"))
        for _ in range(options.runs):
            with Session(folder) as session:
                session.map_bag(bag)
                save(path)
                expect(not temporary(), "temporary files are left after a save")
                saver = threading.Thread(target=save, args=(path,))
                saver.start()
                while not temporary() and saver.is_alive():
                    time.sleep(1e-4)
                time.sleep(CHOICE.uniform(0, 2e-3))
                session.manager.kill()
                saver.join()
                caught += bool(temporary())
                check(path)
    return f"{name} whole after each of {options.runs}; {caught} times a temporary file was left, used by the next save"


def wild_number(kind, value):
    if kind in ("float32", "float64"):
        return CHOICE.choice([math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30, 1e-30, -value])
    bits, signed = int(re.search(r"\d+$", kind).group()), not kind.startswith("u")
    top = (1 << (bits - signed)) - 1
    return CHOICE.choice([0, 1, top, top - 3, top // 2 + 1, -top - 1 if signed else top // 3])


def make_wild(message, share):
    """Changes a share of the message's values, at any depth, to others of their types."""
    for name, kind in zip(message.__slots__, message._slot_types):  # pylint: disable=protected-access
        value = getattr(message, name)
        parts = value if isinstance(value, list) else [value]
        if parts and hasattr(parts[0], "_slot_types") and kind != "time":
            for part in parts:
                make_wild(part, share)
        elif CHOICE.random() > share or kind == "bool":
            continue
        elif kind == "time":
            value.secs, value.nsecs = CHOICE.choice([0, 1, 2**31, 2**32 - 1]), CHOICE.choice([0, 10**9 - 1, 2**32 - 1])
        elif kind == "string":
            setattr(message, name, CHOICE.choice(["", "/", "x" * 10000, "\n", value[:-1]]))
        elif isinstance(value, bytes):
            others = b"", value[:-1], value + b"\0", bytes(len(value)), CHOICE.randbytes(len(value))
            setattr(message, name, CHOICE.choice(others))
        elif isinstance(value, (list, tuple)):
            number = kind.split("[")[0]
            setattr(message, name, [wild_number(number, v) if CHOICE.random() < 0.2 else v for v in value])
        else:
            setattr(message, name, wild_number(kind, value))


def withstand(attack, **parameters):
    """The manager lives, takes no memory for what a message claims, and maps what follows as before. attack(session, bag)
    says what it has done. parameters: of Session."""
    with tempfile.TemporaryDirectory() as folder, Session(folder, **parameters) as session:
        rospy.init_node("faults", disable_signals=True)
        # Where poses are those of a body: it is the camera.
        body = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        body.publish(TFMessage([transform("body", "camera_optical")]))
        bag = make_bag(f"{folder}/room.bag")
        before = session.map_bag(bag)
        seen = attack(session, bag)
        expect(session.alive(), f"the manager has died after {seen}: {session.log()[-300:]}")
        peak = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{session.manager.pid}/status").read_text()).group(1)
        call("/dense_mapper/reset")
        call("/map_server/reset")
        after = session.map_bag(bag)
        expect(after == before, f"{after} points instead of {before} afterwards")
        expect(int(peak) < 1 << 20, f"the manager took {int(peak) >> 10} MiB")
    return f"{seen}; peak {int(peak) >> 10} MiB; {after} points afterwards, as before"


def transform(frame, child):
    message = TransformStamped(Header(0, genpy.Time(1), frame), child, Transform())
    message.transform.rotation.w = 1
    return message


def send_wild(session, seconds, good):
    """Changed copies of messages. good: topics with them"""
    publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10) for topic, message in dict(good).items()}
    time.sleep(2)
    sent, end = 0, time.monotonic() + seconds
    while time.monotonic() < end and session.alive():
        topic, message = CHOICE.choice(good)
        buffer = BytesIO()
        message.serialize(buffer)
        changed = type(message)().deserialize(buffer.getvalue())
        make_wild(changed, CHOICE.choice((0.02, 0.1, 0.5)))
        publishers[topic].publish(changed)
        sent += 1
        time.sleep(0.005)
    return f"{sent} messages"


def wild_messages(options):
    def attack(session, bag):
        points = []
        rospy.Subscriber("/keyframe_points", KeyframePoints, points.append, queue_size=100)
        session.map_bag(bag)
        wait_for(lambda: points, "keyframe_points")
        good = [(topic, message) for topic, message, _ in rosbag.Bag(bag).read_messages(topics=list(TOPICS.values()))]
        image, info = (dict(good)[TOPICS[name]] for name in ("image", "camera_info"))
        poses = [message for topic, message in good if topic == TOPICS["pose"]]
        pixels = image.height * image.width
        mask = Image(image.header, image.height, image.width, "mono8", 0, image.width, bytes(pixels))
        depth = Image(image.header, image.height, image.width, "16UC1", 0, 2 * image.width, bytes(2 * pixels))
        good += [("/prior_depth", depth), ("/keyframe_points", points[0]), ("/mask", mask), ("/source_image", image),
                 ("/source_camera_info", info), ("/optimized_path", RosPath(PoseStamped().header, poses))]
        return send_wild(session, options.seconds, good)
    source = {"source_cameras": 1, "T_cam_source": [1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
    return withstand(attack, mapper_parameters=source)


def tf(options):
    """Frames that are used and others, with stamps of another century and transforms of no meaning."""
    good = [("/tf", TFMessage([transform(*frames)])) for frames in
            (("body", "camera_optical"), ("world", "body"), ("world", "camera_optical"), ("x", "body"))]
    return withstand(lambda session, _: send_wild(session, options.seconds, good),
                     mapper_parameters={"pose_child": "body", "body_frame": "body"})


def clock(options):
    good = [("/clock", Clock(genpy.Time(1600000000)))]
    return withstand(lambda session, _: send_wild(session, options.seconds, good),
                     global_parameters={"use_sim_time": True})


def parameters(options):
    """By dynamic_reconfigure."""
    def attack(session, bag):
        before = rospy.get_param("/dense_mapper")
        client, changes, end = Client("/dense_mapper", timeout=60), 0, time.monotonic() + options.seconds
        while time.monotonic() < end and session.alive():
            name, value = CHOICE.choice([item for item in client.get_configuration().items() if item[0] != "groups"])
            try:
                client.update_configuration({name: wild_number("int32" if isinstance(value, int) else "float64", value)})
            except (DynamicReconfigureParameterException, DynamicReconfigureCallbackException, rospy.ServiceException):
                pass
            changes += 1
        client.update_configuration({name: value for name, value in before.items() if name in client.get_configuration()})
        return f"{changes} changes"
    return withstand(attack)


NO_PICTURES = {
    "EPS": b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 20 20\n%%EndComments\nshowpage\n%%EOF\n",
    "DDS": b"DDS " + bytes(124),
    "SPIDER": np.array([1, 48, 48, 0, 1] + [0] * 17 + [48] * 5, ">f4").tobytes() + bytes(9216),
    "PDF": b"%PDF-1.4\n1 0 obj<<>>endobj\n", "SVG": b"<svg xmlns='http://www.w3.org/2000/svg'><image href='/etc/passwd'/></svg>",
    "GIF": b"GIF89a" + bytes(800), "TIFF": b"II*\0" + bytes(100), "a JPEG's start": b"\xff\xd8\xff\xe0" + bytes(60), "nothing": b"",
    "a PNG of 3.6 Gpx": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x08\x02\0\0\0" + bytes(40)}

# height, width, encoding, is_bigendian, step, data; good ones are 48, 64, "mono8" or "16UC1".
NO_RAW_IMAGES = [(48, 64, "32SC7", 0, 256, bytes(256 * 48)), (48, 64, "", 0, 64, bytes(64 * 48)),
                 (48, 64, "x" * 10000, 0, 64, bytes(64 * 48)), (48, 64, "jpeg", 0, 64, NO_PICTURES["EPS"]),
                 (48, 64, "mono8", 0, 64, bytes(63)), (48, 64, "16UC1", 0, 128, b""), (0, 0, "16UC1", 0, 0, b""),
                 (2**32 - 1, 2**32 - 1, "16UC1", 0, 2**32 - 2, bytes(64)), (2**16, 2**16, "mono8", 0, 0, bytes(64))]


def trap(folder):
    """A folder for PATH, in which programs that picture libraries start leave a file."""
    for name in ("gs", "gswin32c", "convert", "rsvg-convert"):
        path = Path(folder, name)
        path.write_text(f"#!/bin/sh\ntouch {folder}/started\n")
        path.chmod(0o755)


def png(array):
    picture = BytesIO()
    PIL.Image.fromarray(array).save(picture, "PNG")
    return picture.getvalue()


def pair_frames(folder):
    """The room as a pair sees it: for each moment topics with their messages."""
    bag, frames = f"{folder}/pair.bag", {}
    subprocess.run(["acmp_make_bag", "--synthetic", "--stereo-baseline", "0.11", bag, "--width", "64", "--height", "48"],
                   check=True, stdout=subprocess.DEVNULL)
    names = {**{topic: topic for topic in TOPICS.values()}, "/camera_right/image_raw": "/source_image",
             "/camera_right/camera_info": "/source_camera_info"}
    with rosbag.Bag(bag) as recorded:
        for topic, message, _ in recorded.read_messages(topics=list(names)):
            frames.setdefault(message.header.stamp, {})[names[topic]] = message
    return [frame for _, frame in sorted(frames.items())]


class FrameSender:
    """Publishes what belongs to a moment, images last, with another stamp [s]."""

    def __init__(self, frame):
        self.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=100) for topic, message in frame.items()}
        wait_for(lambda: all(p.get_num_connections() > 0 for p in self.publishers.values()), "the mapper")

    def __call__(self, frame, stamp):
        for topic in sorted(frame, key=lambda topic: "image" in topic):
            frame[topic].header.stamp = genpy.Time.from_sec(stamp)
            self.publishers[topic].publish(frame[topic])


def foreign_pictures(_):
    """Pictures that are none, as keyframes of their own between good ones and as images of a source camera; and raw images
    that are none as masks and depth of good ones."""
    with tempfile.TemporaryDirectory() as folder:
        trap(folder)
        os.environ["PATH"] = f"{folder}:{os.environ['PATH']}"
        frames = pair_frames(folder)
        image, source = (f"{topic}/compressed" for topic in (TOPICS["image"], "/source_image"))
        for frame in frames:
            for topic in (image, source):
                message = frame.pop(topic.replace("/compressed", ""))
                pixels = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, -1)
                frame[topic] = CompressedImage(message.header, "png", png(pixels))
        parameters = {"image_transport": "compressed", "source_cameras": 1, "keyframe_mode": "every_pose"}
        with Session(folder, mapper_parameters=parameters) as session:
            rospy.init_node("faults", disable_signals=True)
            send = FrameSender(frames[0])
            raw = FrameSender({topic: Image() for topic in ("/mask", "/prior_depth")})
            pictures = list(NO_PICTURES.values())
            for i, frame in enumerate(frames):
                if i < len(pictures):
                    bad = CompressedImage(Header(), "jpeg", pictures[i])
                    send({**frame, image: bad}, 1.9 + 0.2 * i)
                    if i % 2:
                        frame = {**frame, source: CompressedImage(Header(), "jpeg", pictures[i])}
                if i < len(NO_RAW_IMAGES):
                    raw({topic: Image(Header(), *NO_RAW_IMAGES[i]) for topic in raw.publishers}, 2 + 0.2 * i)
                send(frame, 2 + 0.2 * i)
            wait_for(lambda: image_counts() == (len(frames) + len(pictures), 0), "all images")
            answer = call("/dense_mapper/flush")
            expect(f" {len(frames)} refined" in answer, answer)
            points = save_map(f"{folder}/map.ply")[0]
            expect(points > 0, "no map")
            refused = {key[9:]: told.split()[0] for key, told in mapper_diagnostics().items() if key.startswith("dropped: bad_")}
            counts = {"bad_image": len(pictures), "bad_source_image": len(pictures) // 2, "bad_mask": len(NO_RAW_IMAGES),
                      "bad_prior_depth": len(NO_RAW_IMAGES)}
            expect(refused == {name: str(count) for name, count in counts.items()}, f"told: {refused}")
            peak = int(re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{session.manager.pid}/status").read_text()).group(1))
            expect(peak < 1 << 19, f"the manager took {peak >> 10} MiB")
        expect(not Path(folder, "started").exists(), "a program was started on the sender's bytes")
    return f"told: {refused}; {len(frames)} good keyframes mapped, {points} points; peak {peak >> 10} MiB"


def soak(options):
    """A pair goes to and fro, stamps rise, somebody listens to occupancy and mesh, maps and sessions are saved. Compares the
    medians of the first and the last third of the loops, after a quarter of the time."""
    # The map is full after one loop of 26 keyframes: what is kept is then the same after each. One arena, as each of glibc's
    # (8 for each processor) grows for an hour to what it has held once. An image lost in each loop (64 x 48 px in colour,
    # grey, planes and cost) would be 0.2 MiB a loop, of 65 in an hour.
    os.environ["MALLOC_ARENA_MAX"] = "1"
    bounds, samples, grids = {"memory [MiB]": 3.0, "handles": 0, "threads": 2, "disk [MiB]": 1.0}, [], []
    meshes = deque(maxlen=1)
    with tempfile.TemporaryDirectory() as folder, \
            Session(folder, {"max_keyframes": 20}, {"source_cameras": 1}) as session:
        rospy.init_node("faults", disable_signals=True)
        rospy.Subscriber("/occupancy", OccupancyGrid, lambda _: grids.append(1))
        rospy.Subscriber("/mesh", MarkerArray, meshes.append)
        frames = pair_frames(folder)
        frames += frames[-2:0:-1]
        send, sent, end = FrameSender(frames[0]), 0, time.monotonic() + 60 * options.minutes
        while time.monotonic() < end:
            for frame in frames:
                send(frame, 2000 + 0.2 * sent)
                sent += 1
                time.sleep(2)
                if sent % 6 == 0:
                    answer = save_session(f"{folder}/session.bag")
                    expect(sent < 20 or "success: True" in answer, answer)
            mapped = "success: True" in call("/dense_mapper/flush") and save_map(f"{folder}/map.ply")[0]
            expect(mapped, f"loop {len(samples)}: no map: {session.log()[-300:]}")
            disk = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file()) / 2**20
            samples.append([*sample(session.manager.pid), disk - Path(folder, "log").stat().st_size / 2**20])
    warm = samples[len(samples) // 4:]
    third = len(warm) // 3
    expect(third >= 3, f"only {len(samples)} loops in {options.minutes:g} minutes: too few to see a trend")
    expect(grids and meshes, "no occupancy, or no mesh")
    seen = []
    for (name, bound), values in zip(bounds.items(), zip(*warm)):
        first, last = median(values[:third]), median(values[-third:])
        seen.append(f"{name} {first:.1f}, then {last:.1f}")
        expect(last - first <= bound, f"{len(samples)} loops: {'; '.join(seen)}: must not grow by more than {bound:g}")
    return f"{len(samples)} loops, {sent} images, {len(grids)} grids: {'; '.join(seen)}"


FAULTS = {"kill -9 in save_map": partial(kill_in_save, "map.ply", save_map, check_ply),
          "kill -9 in save_session": partial(kill_in_save, "session.bag", save_session, check_session),
          "wild messages": wild_messages, "tf": tf, "clock": clock, "parameters": parameters,
          "foreign pictures": foreign_pictures, "soak": soak}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("faults", nargs="*", choices=[[], *FAULTS], metavar="FAULT", help=", ".join(FAULTS))
    parser.add_argument("--runs", type=int, default=5, help="of each kill -9")
    parser.add_argument("--seconds", type=float, default=30, help="of each wild one")
    parser.add_argument("--minutes", type=float, default=60, help="of soak; in less than 10 threads may still be starting")
    options = parser.parse_args()
    rows, failed = [], False
    for name in options.faults or FAULTS:
        print(f"== {name}", flush=True)
        try:
            with ProcessPoolExecutor(1) as pool:  # rospy knows one master in a process
                seen, verdict = pool.submit(FAULTS[name], options).result(), "ok"
        except (Fault, SystemExit, subprocess.SubprocessError, OSError) as error:
            seen, verdict, failed = str(error).replace("\n", " "), "NOT OK", True
        rows.append(f"| {name} | {seen} | {verdict} |")
    print("\n| fault | seen | |\n|---|---|---|", *rows, sep="\n")
    sys.exit(failed)


if __name__ == "__main__":
    main()
